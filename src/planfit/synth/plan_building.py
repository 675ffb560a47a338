"""A storey built after a plan: what `Building` is for a plan that was made up."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from planfit.errors import OptionError
from planfit.floorplan import Floorplan
from planfit.geometry import segments
from planfit.synth.furniture import Piece
from planfit.synth.lookalikes import Poster, place_posters
from planfit.synth.options import BuildingOptions
from planfit.synth.plan_doors import hang_doors
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
from planfit.synth.rect import Rect

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
    furniture: tuple[Piece, ...] = ()
    """Doors that stand open."""
    posters: tuple[Poster, ...] = ()

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

    @cached_property
    def faces_of_rooms(self) -> tuple[Float[np.ndarray, "n 2 2"], Int[np.ndarray, " n"]]:
        """Faces of the plan that look into free space, the free side on the left, and the room of each."""
        ends = self.walls.ends[: self.walls.n_drawn]
        ends = ends[segments.lengths(ends) > 0.5]
        front = ends.mean(axis=1) + 0.3 * segments.left_normals(ends)
        is_seen = self.clearance(front) > 0
        return ends[is_seen], look_up(self.cells.room, self.cells.low, front[is_seen], -1)

    def clearance(self, xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        """Distances, m, from points to walls and open doors; 0 in walls and outside the building."""
        is_inside = look_up(self.cells.clearance > 0, self.cells.low, xy, False)
        distance = self.walls.distance(xy)
        for piece in self.furniture:
            distance = np.minimum(distance, piece.footprint.distance(xy))
        return np.where(is_inside, distance, 0.0)

    def inwards(self, xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Directions in which walls recede."""
        slope = np.gradient(self.cells.clearance, CELL_M)
        return np.column_stack([look_up(s, self.cells.low, xy, 0.0) for s in slope])


def make_plan_building(
    floorplan: Floorplan,
    options: BuildingOptions,
    rng: np.random.Generator,
    walked: Float[np.ndarray, "k 2"] | None = None,
    reach_m: float = 0.0,
) -> PlanBuilding:
    """Build the walls of a plan.

    Args:
        floorplan: in metres.
        options: heights and what hangs on walls are used; rooms and doors are the plan's.
        rng: source of the places of posters.
        walked: points, m, plan frame, of a way that is known to be free.
        reach_m: walls are not built within this distance of it.

    Raises:
        OptionError: the plan is not in metres, or has no place for the posters; equal rooms are asked for.
    """
    if not floorplan.is_metric:
        raise OptionError(
            f"{floorplan.name}: expected a plan in metres, to build it in its true size, found one of "
            "unknown unit; give --scale (metres of one unit: a pixel, a point) or --unit"
        )
    if options.same_rooms:
        raise OptionError(
            "same_rooms: expected a building that is made up, found a plan, whose rooms are as they are; "
            "leave one of them out"
        )
    walls = plan_walls(floorplan, options.single_wall_m, walked, reach_m)
    building = PlanBuilding(options, floorplan, walls, make_cells(walls))
    if options.same_doors:
        leaves = hang_doors(walls, building.clearance, options.door_height_m - 0.02, rng)
        building = replace(building, furniture=_off_the_way(leaves, walked, reach_m))
        clearance = building.clearance(building.cells.xy).reshape(building.cells.clearance.shape)
        building = replace(building, cells=replace(building.cells, clearance=clearance))
    posters = place_posters(options.same_posters, *building.faces_of_rooms, building.clearance, rng)
    return replace(building, posters=posters)


def _off_the_way(
    leaves: tuple[Piece, ...], walked: Float[np.ndarray, "k 2"] | None, reach_m: float
) -> tuple[Piece, ...]:
    """Doors that do not stand in the way that is walked."""
    if walked is None:
        return leaves
    _, at = np.unique(np.rint(walked / 0.05), axis=0, return_index=True)
    return tuple(leaf for leaf in leaves if leaf.footprint.distance(walked[at]).min() > reach_m)
