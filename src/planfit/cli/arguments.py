"""Groups of flags that several commands take: how to read the plan, what is known of the alignment."""

import math
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from planfit.errors import OptionError
from planfit.floorplan import PlanOptions
from planfit.floorplan.units import Unit

if TYPE_CHECKING:
    from planfit.pipeline.options import RefineOptions


@dataclass(frozen=True)
class PlanFlags:
    """How to read the plan."""

    unit: Unit = "auto"
    """Unit of the plan's coordinates; `auto` takes what the file says, `unknown` leaves the scale to the
    alignment."""
    scale: Annotated[str | None, tyro.conf.arg(metavar="METRES|1:N")] = None
    """Metres of one unit of the file (a pixel, a point), or the scale on paper as 1:100 (PDF, SVG, pictures
    with dpi); overrules --unit."""
    storey: str = ""
    """Name or number (from 0) of the storey to read where a file holds several."""
    layer: Annotated[
        tyro.conf.UseAppendAction[tuple[tuple[str, ...], ...]], tyro.conf.arg(metavar="NAME ...")
    ] = ()
    """Layers that hold the walls (`*` stands for anything), `--layer A B` or `--layer A --layer B`; without,
    a guess from names and line work."""
    page: int = 1
    """Page of a PDF."""
    cut_height_m: float = 1.2
    """Height above the storey's floor at which models (IFC, meshes) are cut."""
    wall_mask: Path | None = None
    """Picture of the size of the plan, white where there is wall; takes the place of planfit's
    interpretation of the picture."""
    plan_edits: Path | None = None
    """JSON file of corrections of the plan as read, written by `planfit plan` (its flag write-edits)."""
    mirror: bool = False
    """Swap left and right of the plan: for one that was drawn or exported mirrored."""

    @property
    def options(self) -> PlanOptions:
        """The same as options of the readers.

        Raises:
            OptionError: a value cannot work.
        """
        metres, paper = parse_scale(self.scale)
        return PlanOptions(
            unit=self.unit,
            metres_per_unit=metres,
            paper_scale=paper,
            storey=self.storey,
            layers=tuple(name for names in self.layer for name in names),
            page=self.page,
            cut_height_m=self.cut_height_m,
            wall_mask=self.wall_mask,
            edits=self.plan_edits,
            mirror=self.mirror,
        )


def parse_scale(text: str | None) -> tuple[float | None, float | None]:
    """Metres of one unit, or N of a scale on paper 1:N.

    Raises:
        OptionError: it is neither.
    """
    if text is None:
        return None, None
    ratio = re.fullmatch(r"\s*1\s*[:/]\s*(\d+(?:\.\d+)?)\s*", text)
    try:
        number = float(ratio[1] if ratio else text)
    except ValueError:
        number = math.nan
    if not (math.isfinite(number) and number > 0):
        raise OptionError(
            f"--scale: expected metres of one unit of the file, as 0.02, or a scale as 1:100, found {text!r}"
        )
    return (None, number) if ratio else (number, None)


@dataclass(frozen=True)
class AlignmentFlags:
    """What is known of the alignment."""

    candidate: int = 1
    """Which of the alignment hypotheses is taken, 1 the best, as numbered by `planfit align`."""
    pin: Annotated[
        tyro.conf.UseAppendAction[tuple[tuple[str, ...], ...]],
        tyro.conf.arg(metavar="X,Y,Z=X,Y ..."),
    ] = ()
    """Known pairs "x,y,z=X,Y": a point of the scan in its own axes (m) and the same point on the plan, in the
    coordinates at the rim of `planfit plan PLAN -o plan.png`; "x,y,z=file:X,Y" in the file's own."""

    def added_to(self, options: "RefineOptions") -> "RefineOptions":
        """Options with these in place of `align.candidate`, and beside `align.control_points`."""
        points = tuple(point for points in self.pin for point in points)
        chosen = replace(
            options.align,
            candidate=self.candidate if self.candidate != 1 else options.align.candidate,
            control_points=options.align.control_points + points,
        )
        return replace(options, align=chosen)
