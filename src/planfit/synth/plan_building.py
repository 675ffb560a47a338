"""A storey built after a plan: what `Building` is for a plan that was made up."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from planfit.errors import OptionError
from planfit.floorplan import Floorplan
from planfit.floorplan.gaps import gaps_in_line
from planfit.geometry import segments
from planfit.priors import DOOR_LEAF_USUAL_WIDTH_M, DOOR_OPENING_M
from planfit.synth.furniture import Piece
from planfit.synth.lookalikes import LEAF_THICKNESS_M, Clearance, Poster, door_leaf, place_posters
from planfit.synth.options import BuildingOptions
from planfit.synth.plan_walls import (
    CELL_M,
    MAX_WALL_M,
    Cells,
    PlanRoom,
    PlanWalls,
    look_up,
    make_cells,
    plan_walls,
)
from planfit.synth.quads import Rect

LARGE_ROOM_M2 = 5.0
"""A walk calls at rooms of this area or more; cupboards and shafts are left out."""
_DOOR_M = DOOR_OPENING_M.both
"""Narrowest and widest gap that is a door."""
_LEAF_M = DOOR_LEAF_USUAL_WIDTH_M.value
"""All leaves have one width, so that they look alike."""


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
        room = self.cells.room
        counts = np.bincount(room[room >= 0], minlength=1)
        order = np.argsort(-counts, kind="stable")
        large = order[counts[order] * CELL_M**2 >= LARGE_ROOM_M2]
        return tuple(PlanRoom(room == number, self.cells.low) for number in large)

    @cached_property
    def bounds(self) -> Rect:
        """Around all walls."""
        x, y = self.cells.low - CELL_M / 2
        width, depth = CELL_M * np.array(self.cells.clearance.shape)
        return Rect(float(x), float(y), float(x + width), float(y + depth))

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
        leaves = _hang_doors(walls, building.clearance, options.door_height_m - 0.02, rng)
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


def _find_doors(walls: PlanWalls, clearance: Clearance) -> Float[np.ndarray, "n 2 2"]:
    """Ends of the gaps, m, along one face of their wall, whose free side is on the left.

    A gap is a door where both faces beside it lie on one line and look the same way, or where the plan marks
    an opening, and where there is free space on both sides.
    """
    faces = walls.ends[: walls.n_drawn]
    faces = faces[segments.lengths(faces) > 0.1]
    before, after = gaps_in_line(faces, _DOOR_M)
    gaps = np.stack([faces[before, 1], faces[after, 0]], axis=1)
    width = segments.lengths(walls.lintels)
    marked = walls.lintels[(width > _DOOR_M[0]) & (width < _DOOR_M[1])]
    candidates = np.concatenate([gaps, marked, marked[:, ::-1]])
    doors: list[Float[np.ndarray, "2 2"]] = []
    for door in candidates:
        middle, normal = door.mean(axis=0), segments.left_normals(door[None])[0]
        depths = np.array([0.0, 0.4, -0.3, -0.3 - MAX_WALL_M])
        is_free = (clearance(middle + depths[:, None] * normal) > 0.25).all()
        is_new = all(np.linalg.norm(middle - d.mean(axis=0)) > MAX_WALL_M for d in doors)
        if is_free and is_new:
            doors.append(door)
    return np.array(doors).reshape(-1, 2, 2)


def _hang_doors(
    walls: PlanWalls, clearance: Clearance, height_m: float, rng: np.random.Generator
) -> tuple[Piece, ...]:
    """The same leaf, open, at every door of the plan where it has room on one side."""
    seed = int(rng.integers(2**63))
    leaves = []
    for door in _find_doors(walls, clearance):
        along, into = segments.directions(door[None])[0], segments.left_normals(door[None])[0]
        for hinge, aside in ((door[0], -along), (door[1], along)):
            at = hinge + LEAF_THICKNESS_M * aside + 0.02 * into
            points = at + np.linspace(0.1, _LEAF_M, 8)[:, None] * into
            if (clearance(points) > 0.05).all():
                leaves.append(door_leaf(at, into, _LEAF_M, height_m, -1, seed))
                break
    return tuple(leaves)
