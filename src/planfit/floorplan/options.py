"""Everything that can be chosen about reading a plan."""

from dataclasses import dataclass, replace
from pathlib import Path

from planfit.errors import OptionError, require_positive
from planfit.floorplan.units import Unit
from planfit.runtime import Changeable, require_kinds


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

        Args:
            metres_on_paper: length of one unit of the file on paper.
        """
        if self.paper_scale is None:
            return self
        return replace(self, metres_per_unit=self.paper_scale * metres_on_paper, paper_scale=None)
