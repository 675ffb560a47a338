"""Units of plans: their lengths, and which one a plan is in: the user's word goes before the file's."""

from dataclasses import dataclass
from typing import Literal

from planfit.priors import BUILDING_SIZE_M

Unit = Literal["auto", "m", "cm", "mm", "in", "ft", "unknown"]
"""What a user may say of a plan's unit."""

METRES_PER_UNIT = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
"""Units that a plan may be drawn in."""
METRES_PER_FILE_UNIT = {**METRES_PER_UNIT, "dm": 0.1, "yd": 0.9144, "US survey ft": 1200 / 3937}
"""Those, and what only the headers of files name."""

MIN_SIZE_M, MAX_SIZE_M = BUILDING_SIZE_M.both
"""Outside, the unit is another one."""


@dataclass(frozen=True)
class PlanUnit:
    """The unit of a file's coordinates."""

    name: str
    """A name of `METRES_PER_UNIT`, "0.02 m" for a scale that was given, "unknown"."""
    known_from: str
    """What told it; empty where it is unknown."""
    metres: float | None
    """Metres of one unit; None where it is unknown."""


def choose_unit(
    unit: Unit, metres_per_unit: float | None, file_unit: str | None = None, told_by: str = ""
) -> PlanUnit:
    """Unit of a plan.

    Args:
        unit: the user's; goes before the file's, unless it is "auto".
        metres_per_unit: the user's; goes before `unit`.
        file_unit: a name of `METRES_PER_UNIT`, or None where the file does not tell.
        told_by: what in the file told it.
    """
    if metres_per_unit is not None:
        return PlanUnit(f"{metres_per_unit:g} m", "--scale", metres_per_unit)
    if unit == "unknown":
        return PlanUnit("unknown", "", None)
    if unit != "auto":
        return PlanUnit(unit, "--unit", METRES_PER_UNIT[unit])
    if file_unit is None:
        return PlanUnit("unknown", "", None)
    return PlanUnit(file_unit, told_by, METRES_PER_UNIT[file_unit])


def name_of_unit(metres: float) -> str:
    """Name of the unit of so many metres; "0.02 m" where it has none."""
    named = (name for name, m in METRES_PER_FILE_UNIT.items() if abs(metres / m - 1) < 1e-6)
    return next(named, f"{metres:g} m")


def units_that_fit(size: float) -> str:
    """In which units a plan of a size, in its own numbers, would be a building, as a sentence's end."""
    fitting = [
        f"{size * metres:.3g} m with --unit {name}"
        for name, metres in METRES_PER_UNIT.items()
        if MIN_SIZE_M <= size * metres <= MAX_SIZE_M
    ]
    return f"it would be {', '.join(fitting)}" if fitting else "no unit makes it one: give --scale"
