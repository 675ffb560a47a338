"""The flags of every command that reads a plan."""

from dataclasses import dataclass
from pathlib import Path

from planfit.floorplan import PlanOptions
from planfit.floorplan.units import Unit


@dataclass(frozen=True)
class PlanFlags:
    """How to read the plan."""

    unit: Unit = "auto"
    """Unit of the plan's coordinates; `auto` takes what the file says, `unknown` leaves the scale to the
    alignment."""
    scale: float | None = None
    """Metres of one unit of the file (a pixel, a point); overrules --unit."""
    storey: str = ""
    """Name or number (from 0) of the storey to read where a file holds several."""
    layer: tuple[str, ...] = ()
    """Layers that hold the walls (`*` stands for anything); without, a guess from names and line work."""
    page: int = 1
    """Page of a PDF."""
    cut_height_m: float = 1.2
    """Height above the storey's floor at which models (IFC, meshes) are cut."""
    wall_mask: Path | None = None
    """Picture of the size of the plan, white where there is wall; takes the place of planfit's
    interpretation of the picture."""
    mirror: bool = False
    """Swap left and right of the plan: for one that was drawn or exported mirrored."""

    @property
    def options(self) -> PlanOptions:
        """The same as options of the readers.

        Raises:
            OptionError: a value cannot work.
        """
        return PlanOptions(
            self.unit,
            self.scale,
            self.storey,
            self.layer,
            self.page,
            self.cut_height_m,
            self.wall_mask,
            self.mirror,
        )
