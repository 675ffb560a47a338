"""Walls as solid bodies, seen from above, from the faces of any plan."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from planfit.floorplan import Floorplan
from planfit.floorplan.faces import Partners, find_partners, line_strings
from planfit.geometry import segments
from planfit.priors import DRAWING_ROUNDING_M, WALL_FACES_APART_M

MIN_WALL_M, MAX_WALL_M = WALL_FACES_APART_M.both
"""Faces that look away from each other are of one wall when they are so far apart."""
_SAME_M = DRAWING_ROUNDING_M.value
"""What lies nearer to a face than this, and along it, is that face drawn again."""


@dataclass(frozen=True)
class PlanWalls:
    """What stands in the way, plan frame, m. Walls are solid: their ends are closed."""

    ends: Float[np.ndarray, "n 2 2"]
    """Faces of the plan that are built, the free side on the left of the way from the first end to the
    second where it is known; then ends of walls, and backs of those of a single line, which are not in
    the plan."""
    is_oriented: Bool[np.ndarray, " n"]
    """Whether the free side is known."""
    n_drawn: int
    """How many of them are faces of the plan, or parts of such."""
    lintels: Float[np.ndarray, "k 2 2"]
    """Where walls go on above openings, along their faces."""
    soffits: Float[np.ndarray, "m 2 2"]
    """One side of the underside of each, where both sides of the opening are known."""
    soffit_depths: Float[np.ndarray, " m"]
    """How far to the left of that side the other one is."""

    @cached_property
    def _tree(self) -> shapely.STRtree:
        return shapely.STRtree(line_strings(self.ends))

    def distance(self, xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        """Distances, m, from points to the nearest of the walls.

        By a tree of segments: plans of offices have thousands, and cells hundreds of thousands.
        """
        points = shapely.points(xy)
        return shapely.distance(points, self._tree.geometries[self._tree.nearest(points)])


def plan_walls(
    floorplan: Floorplan,
    single_wall_m: float,
    walked: Float[np.ndarray, "k 2"] | None,
    reach_m: float,
) -> PlanWalls:
    """Walls of a plan in metres.

    Args:
        floorplan: faces as read.
        single_wall_m: thickness of walls that are drawn by one face only, behind it.
        walked: points of a way that is known to be free, m; faces are not built near it.
        reach_m: how near, m.
    """
    ends, is_oriented = floorplan.ends_free_left, floorplan.is_oriented
    if walked is not None:
        ends, source = _without(ends, shapely.LineString(walked).buffer(reach_m))
        is_oriented = is_oriented[source]
    pairs = _bodies(ends, is_oriented)
    closing = _closing(ends, pairs)
    backs = _backs(ends, is_oriented, pairs, single_wall_m)
    more = np.concatenate([closing, backs])
    more = more[segments.lengths(more) > _SAME_M]
    more = more[~_repeats(more, ends)]
    openings = np.zeros((0, 2, 2)) if floorplan.openings is None else floorplan.openings
    openings = openings[segments.lengths(openings) > _SAME_M]
    return PlanWalls(
        np.concatenate([ends, more]),
        np.concatenate([is_oriented, np.zeros(len(more), dtype=bool)]),
        len(ends),
        openings,
        *_soffits(openings),
    )


def _without(
    ends: Float[np.ndarray, "n 2 2"], hole: shapely.Geometry
) -> tuple[Float[np.ndarray, "m 2 2"], Int[np.ndarray, " m"]]:
    """What of the segments lies outside a hole, in their own direction, and of which each is part."""
    parts, source = [], []
    for i, line in enumerate(line_strings(ends)):
        left = shapely.get_parts(shapely.difference(line, hole))
        for part in left:
            if part.length > _SAME_M:
                at = shapely.get_coordinates(part)[[0, -1]]
                along = np.argsort((at - ends[i, 0]) @ (ends[i, 1] - ends[i, 0]))
                parts.append(at[along])
                source.append(i)
    return np.array(parts).reshape(-1, 2, 2), np.array(source, dtype=int)


def _bodies(ends: Float[np.ndarray, "n 2 2"], is_oriented: Bool[np.ndarray, " n"]) -> Partners:
    """Pairs of faces with nothing but wall between: the partner is behind, and looks the other way."""
    pairs = find_partners(ends, MAX_WALL_M, MIN_WALL_M, 0.02)
    along = segments.directions(ends)
    looks_away = np.einsum("pi,pi->p", along[pairs.line], along[pairs.partner]) < 0
    is_behind = pairs.gap < 0  # the free side is on the left
    known = is_oriented[pairs.line] & is_oriented[pairs.partner]
    keep = np.flatnonzero(looks_away & is_behind & known)
    behind = pairs.take(np.flatnonzero(is_behind))
    first = np.searchsorted(behind.line, np.arange(len(ends) + 1))
    nearest = []
    for p in keep:
        others = slice(first[pairs.line[p]], first[pairs.line[p] + 1])
        # What is between two faces, over most of where they overlap, is another wall, and a gap.
        shared = np.minimum(behind.high[others], pairs.high[p]) - np.maximum(
            behind.low[others], pairs.low[p]
        )
        is_between = behind.gap[others] > pairs.gap[p] + _SAME_M
        if not (is_between & (shared > 0.5 * (pairs.high[p] - pairs.low[p]))).any():
            nearest.append(p)
    return pairs.take(np.array(nearest, dtype=int))


def _closing(ends: Float[np.ndarray, "n 2 2"], pairs: Partners) -> Float[np.ndarray, "m 2 2"]:
    """Across each wall where its two faces cease to overlap. Those within a wall are never seen."""
    once = pairs.take(np.flatnonzero(pairs.line < pairs.partner))
    along, left = segments.directions(ends), segments.left_normals(ends)
    result = []
    for at in (once.low, once.high):
        front = ends[once.line, 0] + at[:, None] * along[once.line]
        # The line of the partner is met straight behind: faces of a wall may be a little askew.
        across = -left[once.line]
        to_partner = np.einsum("pi,pi->p", ends[once.partner, 0] - front, left[once.partner])
        depth = to_partner / np.einsum("pi,pi->p", across, left[once.partner])
        result.append(np.stack([front, front + depth[:, None] * across], axis=1))
    return np.concatenate(result)


def _backs(
    ends: Float[np.ndarray, "n 2 2"],
    is_oriented: Bool[np.ndarray, " n"],
    pairs: Partners,
    thickness_m: float,
) -> Float[np.ndarray, "m 2 2"]:
    """Backs and ends of walls that are drawn by one face only."""
    has_partner = np.zeros(len(ends), dtype=bool)
    has_partner[pairs.line] = True
    single = ends[is_oriented & ~has_partner]
    behind = single - thickness_m * segments.left_normals(single)[:, None]
    sides = [np.stack([single[:, k], behind[:, k]], axis=1) for k in (0, 1)]
    return np.concatenate([behind, *sides])


def _repeats(
    more: Float[np.ndarray, "m 2 2"], ends: Float[np.ndarray, "n 2 2"]
) -> Bool[np.ndarray, " m"]:
    """Which lie on a face that is there already."""
    middles = shapely.points(more.mean(axis=1))
    tree = shapely.STRtree(line_strings(ends))
    which, face = tree.query(middles, predicate="dwithin", distance=_SAME_M)
    cosine = np.einsum(
        "pi,pi->p", segments.directions(more)[which], segments.directions(ends)[face]
    )
    result = np.zeros(len(more), dtype=bool)
    result[which[np.abs(cosine) > 0.95]] = True
    return result


def _soffits(
    openings: Float[np.ndarray, "k 2 2"],
) -> tuple[Float[np.ndarray, "m 2 2"], Float[np.ndarray, " m"]]:
    """Between the two sides of each opening, where both are known."""
    pairs = find_partners(openings, MAX_WALL_M, MIN_WALL_M, 0.1)
    once = pairs.take(np.flatnonzero(pairs.line < pairs.partner))
    return openings[once.line], once.gap


CELL_M = 0.1
_INSIDE_CELL_M = 2 * CELL_M
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
