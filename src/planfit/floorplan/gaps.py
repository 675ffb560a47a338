"""Gaps of a plan: doors, windows and passages, by what the file marks and by where faces stop; in metres, and
in pixels of a picture."""

from dataclasses import dataclass

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from planfit.floorplan.faces import Ends, connected_groups, line_strings
from planfit.floorplan.types import Floorplan
from planfit.geometry import segments
from planfit.priors import DRAWING_ROUNDING_M, WALL_FACES_APART_M

MAX_WALL_M = WALL_FACES_APART_M.high
"""Both sides of a gap are no further apart."""
SHORTEST_FACE_M = 0.1
"""Shorter faces are ends of walls and jambs: nothing goes on from them."""
ASKEW_M, PARALLEL = 0.05, 0.99
"""Faces of one line: across, and cosine between their directions. So near to the ends of a gap, what crosses
it is drawn askew, too."""
OVERLAP_SHARE = 0.7
"""Of the wider of two gaps, that lies beside the other where they are both sides of one."""

SAME_CORNER_M = DRAWING_ROUNDING_M.value
"""Ends of faces that meet are no further apart."""
LINE_PX = 2.5
"""Across, between edges of one line in a picture."""
WIDEST = 14.0
"""Openings are at most this many times as wide as their wall is thick."""


@dataclass(frozen=True)
class Gap:
    """A place where a wall is interrupted, plan frame."""

    ends: Float[np.ndarray, "2 2"]
    """Along the middle of the wall, m."""
    normal: Float[np.ndarray, "2"]
    """Unit, across the wall."""
    thickness_m: float
    """Of the wall; 0 where it is drawn as one line."""
    storey: int | None = None
    """Where the plan has storeys."""

    @property
    def width_m(self) -> float:
        """As drawn."""
        return float(np.linalg.norm(self.ends[1] - self.ends[0]))


def gaps_in_line(
    ends: Ends, widths: tuple[float, float]
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Pairs of faces in one line of which the second goes on where the first stopped: (before, after).

    `ends`: faces, m, the free side on the left of the way from the first end to the second; `widths`:
    narrowest and widest gap, m.
    """
    tree = shapely.STRtree(np.asarray(shapely.points(ends[:, 0]), dtype=object))
    before, after = tree.query(shapely.points(ends[:, 1]), predicate="dwithin", distance=widths[1])
    gap = ends[after, 0] - ends[before, 1]
    along, left = segments.directions(ends), segments.left_normals(ends)
    ahead = np.einsum("pi,pi->p", gap, along[before])
    aside = np.abs(np.einsum("pi,pi->p", gap, left[before]))
    is_straight = np.einsum("pi,pi->p", along[after], along[before]) > PARALLEL
    is_gap = is_straight & (ahead > widths[0]) & (ahead < widths[1]) & (aside < ASKEW_M)
    return before[is_gap], after[is_gap]


def find_gaps(floorplan: Floorplan, widths: tuple[float, float]) -> tuple[Gap, ...]:
    """Doors, windows and passages of a plan in metres, each once.

    What the file marks counts, and what interrupts both faces of a wall at one place; a gap in one face alone
    is a wall that meets it, or a recess. Of walls that are drawn as one line, a gap in that counts; jambs
    are no walls, though two doors that face each other have jambs in one line.

    `floorplan`: as drawn, m; `widths`: narrowest and widest, m.
    """
    if floorplan.storeys is None:
        return _gaps(floorplan, widths, None)
    return tuple(
        gap
        for storey in np.unique(floorplan.storeys)
        for gap in _gaps(floorplan.of_storey(int(storey)), widths, int(storey))
    )


def _gaps(floorplan: Floorplan, widths: tuple[float, float], storey: int | None) -> tuple[Gap, ...]:
    sides, is_oriented, is_marked, is_of_jambs = _sides(floorplan, widths)
    found = []
    for own in sides_of_gaps(sides, is_oriented, is_marked):
        is_through = len(own) > 1 if is_oriented[own].all() else not is_of_jambs[own].all()
        if is_marked[own].any() or is_through:
            found.append(gap_between(sides[own], storey))
    return tuple(gap for gap in found if _is_clear(gap, floorplan))


def _sides(
    floorplan: Floorplan, widths: tuple[float, float]
) -> tuple[
    Float[np.ndarray, "s 2 2"],
    Bool[np.ndarray, " s"],
    Bool[np.ndarray, " s"],
    Bool[np.ndarray, " s"],
]:
    """Gaps of single faces and marks; whether their free side, on the left, is known; which are marks; which
    lie between ends of walls."""
    long = floorplan.lengths > SHORTEST_FACE_M
    is_end = _are_ends_of_walls(floorplan)[long]
    ends, is_oriented = floorplan.ends_free_left[long], floorplan.is_oriented[long]
    # A line whose free side is unknown goes on either way.
    both = np.concatenate([ends, ends[~is_oriented][:, ::-1]])
    is_known = np.concatenate([is_oriented, np.zeros(int((~is_oriented).sum()), dtype=bool)])
    is_end = np.concatenate([is_end, is_end[~is_oriented]])
    before, after = gaps_in_line(both, widths)
    width = np.linalg.norm(both[after, 0] - both[before, 1], axis=1)
    order = np.argsort(width, kind="stable")
    # What goes on first: a pier between two doors is passed by the longer gap over both.
    nearest = order[np.unique(before[order], return_index=True)[1]]
    before, after = before[nearest], after[nearest]
    gaps = np.stack([both[before, 1], both[after, 0]], axis=1)
    marks = np.zeros((0, 2, 2)) if floorplan.openings is None else floorplan.openings
    length = np.linalg.norm(marks[:, 1] - marks[:, 0], axis=1)
    marks = marks[(length > widths[0]) & (length < widths[1])]
    return (
        np.concatenate([gaps, marks]),
        np.concatenate([is_known[before] & is_known[after], np.zeros(len(marks), dtype=bool)]),
        np.arange(len(gaps) + len(marks)) >= len(gaps),
        np.concatenate([is_end[before] & is_end[after], np.zeros(len(marks), dtype=bool)]),
    )


def _are_ends_of_walls(floorplan: Floorplan) -> Bool[np.ndarray, " n"]:
    """Faces no longer than walls are thick, from both of whose ends others run on, side by side: jambs."""
    ends, n = floorplan.ends, len(floorplan)
    corners = np.asarray(shapely.points(ends.reshape(-1, 2)), dtype=object)
    here, there = shapely.STRtree(corners).query(corners, "dwithin", distance=SAME_CORNER_M)
    here, there = here[here // 2 != there // 2], there[here // 2 != there // 2]
    along = segments.directions(ends)
    # From each corner away along the face that meets it there.
    away = along[there // 2] * np.where(there % 2 == 0, 1.0, -1.0)[:, None]
    is_end = np.zeros(n, dtype=bool)
    for face in np.flatnonzero(floorplan.lengths <= MAX_WALL_M):
        first, second = away[here == 2 * face], away[here == 2 * face + 1]
        beside = first @ second.T > PARALLEL
        is_across = np.abs(first @ along[face]) < 1.0 - PARALLEL
        is_end[face] = bool((beside & is_across[:, None]).any())
    return is_end


def sides_of_gaps(
    sides: Float[np.ndarray, "s 2 2"],
    is_oriented: Bool[np.ndarray, " s"],
    is_marked: Bool[np.ndarray, " s"],
) -> list[Int[np.ndarray, " k"]]:
    """Gaps of single faces that are of one gap through their wall.

    Args:
        sides: ends of each, m, the free side of the face on the left.
        is_oriented: whether that side is known; where it is, both sides of a wall look away from each other.
        is_marked: those that a file marks may differ more in width from what the faces leave.
    """
    if len(sides) == 0:
        return []
    middles = sides.mean(axis=1)
    reach = MAX_WALL_M + float(segments.lengths(sides).max())
    points = np.asarray(shapely.points(middles), dtype=object)
    i, j = shapely.STRtree(points).query(points, predicate="dwithin", distance=reach)
    i, j = i[i < j], j[i < j]
    along, left = segments.directions(sides), segments.left_normals(sides)
    cosine = np.einsum("pi,pi->p", along[i], along[j])
    behind = -np.einsum("pi,pi->p", middles[j] - middles[i], left[i])
    at_i = np.sort(np.einsum("pei,pi->pe", sides[i], along[i]), axis=1)
    at_j = np.sort(np.einsum("pei,pi->pe", sides[j], along[i]), axis=1)
    shared = np.minimum(at_i, at_j)[:, 1] - np.maximum(at_i, at_j)[:, 0]
    wider = np.maximum(np.ptp(at_i, axis=1), np.ptp(at_j, axis=1))
    look_away = (cosine < 0) & (behind > 0)
    is_one = np.where(is_oriented[i] & is_oriented[j], look_away, True)
    is_one &= (np.abs(cosine) > PARALLEL) & (np.abs(behind) < MAX_WALL_M)
    is_one &= shared > np.where(is_marked[i] | is_marked[j], 0.5, OVERLAP_SHARE) * wider
    group = connected_groups(i[is_one], j[is_one], len(sides))
    return [np.flatnonzero(group == k) for k in range(group.max() + 1)]


def gap_between(sides: Float[np.ndarray, "s 2 2"], storey: int | None) -> Gap:
    """The gap that some sides are of; its normal is to the left of the first of them."""
    along, normal = segments.directions(sides[:1])[0], segments.left_normals(sides[:1])[0]
    at, across = np.sort(sides @ along, axis=1), sides.mean(axis=1) @ normal
    ends = at.mean(axis=0)[:, None] * along + (across.min() + across.max()) / 2 * normal
    return Gap(ends, normal, float(np.ptp(across)), storey)


def _is_clear(gap: Gap, floorplan: Floorplan) -> bool:
    """Whether no wall crosses the middle of a gap: two walls in line that end at a corridor leave none."""
    along = (gap.ends[1] - gap.ends[0]) / gap.width_m
    inner = gap.ends + ASKEW_M * np.array([along, -along])
    lines = line_strings(floorplan.ends)
    return not bool(shapely.intersects(lines, shapely.LineString(inner)).any())


def find_openings(
    ends: Ends, normals: Float[np.ndarray, "n 2"], thickness: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "k 2 2"]:
    """Openings along the faces they interrupt, one on each face of the wall.

    Only gaps that both faces have count: a gap in one face alone is a wall that meets it, or a recess.

    Args:
        ends: faces, px.
        normals: to the free side.
        thickness: of the wall behind each, px.
    """
    gaps = _gaps_px(ends, normals, thickness)
    if len(gaps) == 0:
        return np.zeros((0, 2, 2))
    gap_ends, gap_normals, gap_thickness = map(np.array, zip(*gaps, strict=True))
    # The other face is no further than the wall is thick; and of two gaps that nearly cover each other,
    # turned by 8 degrees at most, no point lies further off than a fifth of the longer one.
    margin = 1.35 * gap_thickness + 0.25 * segments.lengths(gap_ends) + 3.0
    near_of = _those_near(gap_ends, gap_ends, margin)
    kept = np.zeros(len(gaps), dtype=bool)
    for i, some in enumerate(near_of):
        others = gap_ends[some]
        opposite = gap_normals[some] @ gap_normals[i] < -0.99
        behind = (gap_ends[i, 0] - others[:, 0]) @ gap_normals[i]
        near = opposite & (np.abs(behind - gap_thickness[i]) < 0.35 * gap_thickness[i] + 1.0)
        along = gap_ends[i, 1] - gap_ends[i, 0]
        length = np.linalg.norm(along)
        at = np.sort((others - gap_ends[i, 0]) @ (along / length), axis=1)
        overlap = np.minimum(at[:, 1], length) - np.maximum(at[:, 0], 0.0)
        kept[i] = bool((near & (overlap > 0.8 * np.maximum(length, at[:, 1] - at[:, 0]))).any())
    return gap_ends[kept]


def _those_near(
    ends: Ends, asked: Float[np.ndarray, "m 2 2"], margin: Float[np.ndarray, " m"]
) -> list[Int[np.ndarray, " k"]]:
    """For each segment asked about, which segments have a box that its own, grown by a margin, meets: to look
    at all for each takes minutes where a picture has ten thousand."""
    low, high = asked.min(axis=1) - margin[:, None], asked.max(axis=1) + margin[:, None]
    tree = shapely.STRtree(shapely.box(*ends.min(axis=1).T, *ends.max(axis=1).T))
    of, found = tree.query(shapely.box(*low.T, *high.T))
    order = np.lexsort((found, of))
    return np.split(found[order], np.searchsorted(of[order], np.arange(1, len(asked))))


def _gaps_px(
    ends: Ends, normals: Float[np.ndarray, "n 2"], thickness: Float[np.ndarray, " n"]
) -> list[tuple[Float[np.ndarray, "2 2"], Float[np.ndarray, "2"], float]]:
    """Gaps between faces of one line: ends, normal, thickness of the wall."""
    lengths = segments.lengths(ends)
    # A jamb is short and has the whole length of its wall behind it.
    is_long = lengths > 0.5 * thickness
    result = []
    asked = np.flatnonzero(is_long)
    if len(asked) == 0:
        return result
    # Where the face goes on: no further than an opening is wide.
    begin = ends[asked, 1]
    along_all = (begin - ends[asked, 0]) / lengths[asked, None]
    beyond = begin + (WIDEST * thickness[asked] + 1.0)[:, None] * along_all
    margin = np.full(len(asked), LINE_PX + 2.0)
    near_of = _those_near(ends, np.stack([begin, beyond], axis=1), margin)
    for i, along, some in zip(asked, along_all, near_of, strict=True):
        others = ends[some]
        offset = np.abs((others - ends[i, 0]) @ normals[i]).max(axis=1)
        same = is_long[some] & (normals[some] @ normals[i] > PARALLEL) & (offset < LINE_PX)
        first = ((others - ends[i, 0]) @ along).min(axis=1)
        later = np.flatnonzero(same & (first > lengths[i] - 1.0))
        if len(later) == 0:
            continue
        nearest_later = later[np.argmin(first[later])]
        j = some[nearest_later]
        wide, thick = first[nearest_later] - lengths[i], float(min(thickness[i], thickness[j]))
        if max(lengths[i], lengths[j]) < 1.2 * thick:
            continue  # two columns
        if (
            0.5 * thick < wide < WIDEST * thick
            and max(thickness[i], thickness[j]) < 1.7 * thick + 2
        ):
            nearest = ends[j][np.argmin((ends[j] - ends[i, 0]) @ along)]
            result.append((np.array([ends[i, 1], nearest]), normals[i], thick))
    return result
