"""Which unit a plan is in: what the user says goes before what the file says."""

from dataclasses import dataclass

from planfit.floorplan.options import METRES_PER_UNIT, PlanOptions

MIN_SIZE_M, MAX_SIZE_M = 1.5, 2000.0
"""A building is larger than a cupboard and smaller than a town: outside, the unit is another one."""


@dataclass(frozen=True)
class PlanUnit:
    """The unit of a file's coordinates."""

    name: str
    """A name of `METRES_PER_UNIT`, "0.02 m" for a scale that was given, "unknown"."""
    known_from: str
    """What told it; empty where it is unknown."""
    metres: float | None
    """Metres of one unit; None where it is unknown."""


def choose_unit(options: PlanOptions, file_unit: str | None, told_by: str) -> PlanUnit:
    """Unit of a plan.

    Args:
        options: `metres_per_unit` goes before `unit`, and both go before the file.
        file_unit: a name of `METRES_PER_UNIT`, or None where the file does not tell.
        told_by: what in the file told it.
    """
    if options.metres_per_unit is not None:
        return PlanUnit(f"{options.metres_per_unit:g} m", "--scale", options.metres_per_unit)
    if options.unit == "unknown":
        return PlanUnit("unknown", "", None)
    if options.unit != "auto":
        return PlanUnit(options.unit, "--unit", METRES_PER_UNIT[options.unit])
    if file_unit is None:
        return PlanUnit("unknown", "", None)
    return PlanUnit(file_unit, told_by, METRES_PER_UNIT[file_unit])
