"""Where in a plan one can stand, and its rooms: what walls enclose."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from planfit.geometry import segments
from planfit.synth.plan_walls import PlanWalls

CELL_M = 0.1
_INSIDE_CELL_M = 0.2
_N_RAYS = 16
_ON_WALL_M = 1e-6
"""What lies so near to a wall lies on it, and meets it in every direction."""
_INSIDE_SHARE = 0.7
"""Of the rays of a point inside, so many end on the free side of a wall. In front of a building half of
them do, in a courtyard all: that is as good as inside."""
_ROOM_CLEARANCE_M = 0.55
"""Rooms are what doors part: the free space that lies further from walls than half a door."""


@dataclass(frozen=True)
class PlanRoom:
    """A room of a plan: a patch of free cells."""

    cells: Bool[np.ndarray, "nx ny"]
    low: Float[np.ndarray, "2"]
    """Centre of the first cell, m."""

    @property
    def area(self) -> float:
        """Of the floor, m2, but for a hair along the walls."""
        return float(self.cells.sum() * CELL_M**2)

    def contains(self, xy: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
        """Which of the points lie inside."""
        return look_up(self.cells, self.low, xy, False)


@dataclass(frozen=True)
class Cells:
    """A plan as square cells of `CELL_M`, x first."""

    low: Float[np.ndarray, "2"]
    """Centre of the first, m, plan frame."""
    clearance: Float[np.ndarray, "nx ny"]
    """Distance of the centre to what stands in the way, m; 0 where it is not inside."""
    room: Int[np.ndarray, "nx ny"]
    """Index of the room; -1 for none."""

    @property
    def xy(self) -> Float[np.ndarray, "n 2"]:
        """Centres, in the order of `clearance.ravel()`."""
        index = np.indices(self.clearance.shape).reshape(2, -1).T
        return self.low + CELL_M * index


def look_up(
    image: np.ndarray,
    low: Float[np.ndarray, "2"],
    xy: Float[np.ndarray, "n 2"],
    outside: float | bool,
) -> np.ndarray:
    """Value of the cell that each point lies in, and `outside` beyond all."""
    at = np.rint((xy - low) / CELL_M).astype(int)
    is_in = np.all((at >= 0) & (at < image.shape), axis=1)
    at = np.where(is_in[:, None], at, 0)
    return np.where(is_in, image[at[:, 0], at[:, 1]], outside)


def make_cells(walls: PlanWalls) -> Cells:
    """Free space and rooms between walls."""
    points = walls.ends.reshape(-1, 2)
    low = points.min(axis=0) + CELL_M / 2
    n_x, n_y = np.ceil(np.ptp(points, axis=0) / CELL_M).astype(int)
    empty = Cells(low, np.zeros((n_x, n_y)), np.full((n_x, n_y), -1))
    distance = walls.distance(empty.xy).reshape(n_x, n_y)
    clearance = np.where(_is_inside(walls, empty), distance, 0.0)
    return Cells(low, clearance, _rooms(clearance))


def _is_inside(walls: PlanWalls, cells: Cells) -> Bool[np.ndarray, "nx ny"]:
    """Whether most rays from a cell, all around, meet the free side of a wall.

    Cast from the middles of blocks of cells: what lies nearer to a wall than a block is of no use to a walk.
    """
    every = round(_INSIDE_CELL_M / CELL_M)
    n_x, n_y = (-(-n // every) for n in cells.clearance.shape)
    blocks = np.stack(np.meshgrid(np.arange(n_x), np.arange(n_y), indexing="ij"), -1).reshape(-1, 2)
    xy = cells.low + CELL_M * (every * blocks + (every - 1) / 2)
    angles = 2 * np.pi * (np.arange(_N_RAYS) + 0.5) / _N_RAYS
    # Openings are in the way, too.
    ends = np.concatenate([walls.ends, walls.lintels])
    has_side = np.concatenate([walls.is_oriented, np.zeros(len(walls.lintels), dtype=bool)])
    left = segments.left_normals(ends)
    fronts = np.zeros(len(xy))
    for direction in np.column_stack([np.cos(angles), np.sin(angles)]):
        hit = _first_ahead(xy, direction, ends)
        is_front = (left[hit] @ direction < 0) | ~has_side[hit]
        fronts += (hit >= 0) & is_front
    # Single rays escape through gaps: neighbours are heard, too.
    share = ndimage.uniform_filter(fronts.reshape(n_x, n_y) / _N_RAYS, size=3, mode="nearest")
    inside = share >= _INSIDE_SHARE
    shape = cells.clearance.shape
    return inside.repeat(every, axis=0).repeat(every, axis=1)[: shape[0], : shape[1]]


def _first_ahead(
    xy: Float[np.ndarray, "n 2"],
    direction: Float[np.ndarray, "2"],
    ends: Float[np.ndarray, "k 2 2"],
) -> Int[np.ndarray, " n"]:
    """Index of the first segment ahead of each point in one direction; -1 for none."""
    across_and_ahead = np.column_stack([[-direction[1], direction[0]], direction])
    across, ahead = (xy @ across_and_ahead).T
    order = np.argsort(across)
    across, ahead = across[order], ahead[order]
    # From the left to the right end of each segment.
    turned = ends @ across_and_ahead
    turned = np.take_along_axis(turned, np.argsort(turned[..., :1], axis=1), axis=1)
    first = np.searchsorted(across, turned[:, 0, 0], "left")
    last = np.searchsorted(across, turned[:, 1, 0], "right")
    nearest, hit = np.full(len(xy), np.inf), np.full(len(xy), -1)
    for k in np.flatnonzero((first < last) & (turned[:, 0, 0] < turned[:, 1, 0])):
        beside = slice(first[k], last[k])
        distance = np.interp(across[beside], *turned[k].T) - ahead[beside]
        is_nearer = (distance > -_ON_WALL_M) & (distance < nearest[beside])
        nearest[beside][is_nearer] = distance[is_nearer]
        hit[beside][is_nearer] = k
    unsorted = np.zeros_like(hit)
    unsorted[order] = hit
    return unsorted


def _rooms(clearance: Float[np.ndarray, "nx ny"]) -> Int[np.ndarray, "nx ny"]:
    """Parts of what is further than half a door from walls, grown back to the walls."""
    room, _ = ndimage.label(clearance > _ROOM_CLEARANCE_M)
    # Less than half a cell from a wall, growth would pass through it.
    is_free = clearance > CELL_M / 2
    for _ in range(round(_ROOM_CLEARANCE_M / CELL_M) + 1):
        grown = ndimage.maximum_filter(room, size=3)
        room = np.where((room == 0) & is_free, grown, room)
    return room - 1
