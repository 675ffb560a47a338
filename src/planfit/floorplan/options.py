"""Everything that can be chosen about reading a plan, and the units that lengths may be in."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from planfit.errors import OptionError, require_positive
from planfit.priors import BUILDING_SIZE_M
from planfit.runtime import Changeable, require_kinds
from planfit.units import FOOT_M, INCH_M

Unit = Literal["auto", "m", "cm", "mm", "in", "ft", "unknown"]
"""What a user may say of a plan's unit."""

METRES_PER_UNIT = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": INCH_M, "ft": FOOT_M}
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
    warnings: tuple[str, ...] = ()

    @property
    def scale(self) -> float:
        """From the file's coordinates to those of the plan: metres where the unit is known, else the same."""
        return 1.0 if self.metres is None else self.metres


@dataclass(frozen=True)
class PlanOptions(Changeable):
    """What the reader of a plan cannot know, or shall not guess."""

    unit: Unit = "auto"
    """Unit of the coordinates in the file; `auto` takes what the file says, `unknown` leaves the scale
    to the alignment."""
    metres_per_unit: float | None = None
    """Metres of one unit of the file (a pixel, a point); overrides `unit`."""
    paper_scale: float | None = None
    """100 for a plan drawn at 1:100, of a file that has a size on paper (PDF, SVG, a picture with dpi);
    overrides `unit`."""
    storey: str = ""
    """Name or number (from 0, lowest or first) of the storey to read where a file holds several."""
    layers: tuple[str, ...] = ()
    """Layers that hold the walls (`*` stands for anything); empty: a guess from names and line work."""
    page: int = 1
    """Page of a PDF."""
    cut_height_m: float = 1.2
    """Height above the storey's floor at which models (IFC, meshes) are cut."""
    wall_mask: Path | None = None
    """Picture of the size of the plan, white where there is wall, from a segmentation of your own; it
    takes the place of planfit's interpretation of the picture."""
    edits: Path | None = None
    """JSON file of corrections: faces left out, regions kept, walls added (`planfit help formats`)."""
    keep_regions: tuple[tuple[tuple[float, float], ...], ...] = ()
    """Corners of regions, in the coordinates at the rim, beside those of `edits`: what lies outside of all of
    them is left out. A picture is read as though it were blank there."""
    mirror: bool = False
    """Swap left and right: for a plan that was drawn or exported mirrored."""

    def __post_init__(self) -> None:
        require_kinds(self)
        require_positive(self, "page", "cut_height_m")
        if self.paper_scale is not None and not self.paper_scale > 0:
            raise OptionError(f"paper_scale: expected a number above 0, found {self.paper_scale}")
        if self.metres_per_unit is not None and not self.metres_per_unit > 0:
            raise OptionError(
                f"metres_per_unit: expected a number above 0, found {self.metres_per_unit}"
            )

    def on_paper(self, metres_on_paper: float) -> "PlanOptions":
        """The same with `metres_per_unit` for a `paper_scale`.

        `metres_on_paper`: length of one unit of the file on paper.
        """
        if self.paper_scale is None:
            return self
        return replace(self, metres_per_unit=self.paper_scale * metres_on_paper, paper_scale=None)


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
