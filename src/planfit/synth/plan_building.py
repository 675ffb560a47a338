"""A storey built after a plan: what `Building` is for a plan that was made up."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from planfit.errors import OptionError
from planfit.floorplan import Floorplan
from planfit.synth.layout import Rect
from planfit.synth.options import BuildingOptions
from planfit.synth.plan_space import (
    CELL_M,
    Cells,
    PlanRoom,
    bounds_of,
    look_up,
    make_cells,
    rooms_of,
)
from planfit.synth.plan_walls import PlanWalls, plan_walls

LARGE_ROOM_M2 = 5.0
"""A walk calls at rooms of this area or more; cupboards and shafts are left out."""


@dataclass(frozen=True)
class PlanBuilding:
    """One storey with the walls of a plan, in the plan frame: z up, floor at z = 0, m. Its rooms are bare
    but for what hangs on the walls."""

    options: BuildingOptions
    floorplan: Floorplan
    """The true plan, as it was given."""
    walls: PlanWalls
    cells: Cells

    @property
    def plan_from_building(self) -> Float[np.ndarray, "4 4"]:
        """They are the same."""
        return np.eye(4)

    @cached_property
    def rooms(self) -> tuple[PlanRoom, ...]:
        """Large ones, the largest first."""
        return tuple(rooms_of(self.cells, LARGE_ROOM_M2))

    @cached_property
    def bounds(self) -> Rect:
        """Around all walls."""
        return bounds_of(self.cells)

    def clearance(self, xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        """Distances, m, from points to walls; 0 in walls and outside the building."""
        is_inside = look_up(self.cells.clearance > 0, self.cells.low, xy, False)
        return np.where(is_inside, self.walls.distance(xy), 0.0)

    def inwards(self, xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Directions in which walls recede."""
        slope = np.gradient(self.cells.clearance, CELL_M)
        return np.column_stack([look_up(s, self.cells.low, xy, 0.0) for s in slope])


def make_plan_building(
    floorplan: Floorplan,
    options: BuildingOptions,
    walked: Float[np.ndarray, "k 2"] | None = None,
    reach_m: float = 0.0,
) -> PlanBuilding:
    """Build the walls of a plan.

    Args:
        floorplan: in metres.
        options: heights and what hangs on walls are used; rooms and doors are the plan's.
        walked: points, m, plan frame, of a way that is known to be free.
        reach_m: walls are not built within this distance of it.

    Raises:
        OptionError: the plan is not in metres.
    """
    if not floorplan.is_metric:
        raise OptionError(
            f"{floorplan.name}: expected a plan in metres, to build it in its true size, found one of "
            "unknown unit; give --scale (metres of one unit: a pixel, a point) or --unit"
        )
    walls = plan_walls(floorplan, options.single_wall_m, walked, reach_m)
    return PlanBuilding(options, floorplan, walls, make_cells(walls))
