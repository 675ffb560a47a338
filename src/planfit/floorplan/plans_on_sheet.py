"""Plans of several storeys: told apart on one sheet, as groups of walls whose extents do so, and made one."""

from collections.abc import Mapping

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int, Shaped

from planfit.errors import FloorplanError
from planfit.floorplan.faces import connected_groups, covered_lengths
from planfit.floorplan.types import Floorplan, PlanSource

MOST_STOREYS = 8
"""More plans than this are not drawn on one sheet: windows of a facade, houses of a site plan are."""
_APART = 0.3
"""Groups that come nearer than this many thicknesses of a wall are one."""
_LEAST_SHARE = 0.12
"""A group of less area or less wall than this share of the largest is a part of its neighbour: a wall around
a yard has the extent of a storey, and little in it."""
_SOLID = 0.6
"""A group that fills this share of its extent has no rooms: the bar of a title. Walls fill 0.05 to 0.3,
houses of a site plan 0.5."""

_FAR = 0.25
"""Groups further apart than this share of the smaller one's shorter side are plans of their own."""
_SCRAPS = 0.15
"""Where groups too small for a storey hold this share of all wall or more, a plan was read in pieces, as thin
walls of a small picture are; large groups that they tie together are one. Two real storeys have none."""
_BAND, _WALLED = 0.15, 0.5
"""Else each has wall in the band along the strip between them, of this share of its width, over at least
this share of the strip's length."""
_AROUND, _CORNER = 1.5, 0.35
"""Within so many thicknesses of the jamb of a door is its own wall, and of others less than this share of a
square of the thickness; the paper between two plans in line has a corner at both ends."""


def find_storeys(
    walls: Shaped[np.ndarray, " n"],
    thickness_px: float,
    openings: Float[np.ndarray, "k 2 2"],
    lines: Bool[np.ndarray, "h w"],
) -> Int[np.ndarray, " n"]:
    """Number of the storey of each region of wall; numbered as one reads a page.

    Args:
        thickness_px: usual thickness of a wall.
        openings: doors and windows, one on each face of the wall; the walls on their two sides are of one
            storey.
        lines: everything drawn: storeys have a blank strip between them.
    """
    boxes = shapely.bounds(walls) + np.array([-1, -1, 1, 1]) * _APART * thickness_px
    group = np.arange(len(walls))
    if len(openings):
        doors = openings[~_are_between_corners(openings, walls)]
        tree = shapely.STRtree(walls)
        sides = tree.nearest(shapely.points(doors.reshape(-1, 2))).reshape(-1, 2)
        group = connected_groups(sides[:, 0], sides[:, 1], len(walls))
    while True:
        group = _overlapping(boxes, group)
        pair = _joined_by_drawing(_extents(boxes, group)[1], lines)
        if pair is None:
            break
        group[group == pair[1]] = pair[0]
    group = _without_parts(walls, boxes, group)
    names, extents, is_storey = _large(walls, boxes, group)
    centre = (extents[:, :2] + extents[:, 2:]) / 2
    # Down the page in rows: plans whose extents overlap in v stand side by side.
    order = sorted(
        np.flatnonzero(is_storey), key=lambda i: (_row(extents, is_storey, int(i)), centre[i, 0])
    )
    number = {names[i]: k for k, i in enumerate(order)}
    for i in np.flatnonzero(~is_storey):
        gaps = [_gap(extents[i], extents[j]) for j in order]
        number[names[i]] = int(np.argmin(gaps))
    storey = np.array([number[name] for name in group])
    length = shapely.length(walls)
    scraps = float(length[np.isin(group, names[~is_storey])].sum())
    if scraps < _SCRAPS * length.sum():
        return storey
    return _overlapping(boxes, storey)


def _are_between_corners(
    openings: Float[np.ndarray, "k 2 2"], walls: Shaped[np.ndarray, " n"]
) -> Bool[np.ndarray, " k"]:
    """Whether the wall ends at another wall on both sides of the gap, which may be one between two plans."""
    along = openings[:, 1] - openings[:, 0]
    length = np.hypot(along[:, 0], along[:, 1])
    middle = openings.mean(axis=1)
    solid = shapely.union_all(walls)
    shapely.prepare(solid)
    result = np.zeros(len(openings), dtype=bool)
    for i, direction in enumerate(along / length[:, None]):
        left = np.array([-direction[1], direction[0]])
        apart = middle - middle[i]
        across = np.abs(apart @ left)
        is_opposite = along @ direction < -0.99 * length
        is_opposite &= (np.abs(apart @ direction) < 0.2 * length) & (across < 2 * length)
        if not is_opposite.any():
            continue
        other = np.flatnonzero(is_opposite)[np.argmin(across[is_opposite])]
        thick, half = across[other], 0.5 * float(apart[other] @ left) * left
        axis = shapely.LineString(openings[i] + half)
        free = shapely.get_parts(shapely.difference(axis, solid))
        own = shapely.buffer(_longer(axis, 3 * thick), 0.6 * thick, cap_style="flat")
        if len(free) == 0 or free[np.argmax(shapely.length(free))].length == 0:
            continue
        jambs = shapely.points(shapely.get_coordinates(free[np.argmax(shapely.length(free))]))
        around = shapely.difference(shapely.buffer(jambs, _AROUND * thick), own)
        others = shapely.area(shapely.intersection(around, solid))
        result[i] = others.min() > _CORNER * thick**2
    return result


def _longer(line: shapely.LineString, by: float) -> shapely.LineString:
    """A segment that reaches further at both ends."""
    a, b = shapely.get_coordinates(line)
    step = by * (b - a) / np.hypot(*(b - a))
    return shapely.LineString([a - step, b + step])


def _large(
    walls: Shaped[np.ndarray, " n"], boxes: Float[np.ndarray, "n 4"], group: Int[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " k"], Float[np.ndarray, "k 4"], Bool[np.ndarray, " k"]]:
    """Names of groups, their extents, and which are as large as a storey and have room in them."""
    names, extents = _extents(boxes, group)
    area = np.prod(extents[:, 2:] - extents[:, :2], axis=1)
    length = np.array([shapely.length(walls[group == name]).sum() for name in names])
    is_storey = (area >= _LEAST_SHARE * area.max()) & (length >= _LEAST_SHARE * length.max())
    solid = np.array([shapely.area(walls[group == name]).sum() for name in names])
    is_storey &= solid < _SOLID * area
    is_storey[np.argmax(length)] = True
    return names, extents, is_storey


def _without_parts(
    walls: Shaped[np.ndarray, " n"], boxes: Float[np.ndarray, "n 4"], group: Int[np.ndarray, " n"]
) -> Int[np.ndarray, " n"]:
    """Groups that look like parts of one building become one.

    Between two plans there is a wide strip of paper, or an outer wall of each along the strip. A blank strip
    between the core of a building and a row of its piers is narrow, and open on one side at least.
    """
    group = group.copy()
    while True:
        names, extents, is_storey = _large(walls, boxes, group)
        order = np.flatnonzero(is_storey)
        side = (extents[:, 2:] - extents[:, :2]).min(axis=1)
        parts = []
        for k, i in enumerate(order):
            others = order[k + 1 :]
            gap = np.hypot(*np.maximum(_apart(extents[i], extents[others]), 0.0).T)
            is_far = gap > _FAR * np.minimum(side[i], side[others])
            parts += [
                (i, j)
                for j in others[~is_far]
                if not _are_apart(
                    extents[i], extents[j], boxes[group == names[i]], boxes[group == names[j]]
                )
            ]
        if not parts:
            return group
        i, j = min(parts, key=lambda pair: _gap(extents[pair[0]], extents[pair[1]]))
        group[group == names[j]] = names[i]


def _are_apart(
    one: Float[np.ndarray, "4"],
    other: Float[np.ndarray, "4"],
    one_boxes: Float[np.ndarray, "a 4"],
    other_boxes: Float[np.ndarray, "b 4"],
) -> bool:
    """Whether two groups of walls that are not far from each other, given by their extents and boxes, are two
    buildings or storeys."""
    apart = _apart(one, other[None])[0]
    across = int(np.argmax(apart))
    along = 1 - across
    low = max(one[along], other[along])
    high = min(one[along + 2], other[along + 2])
    if apart[across] < 0 or high <= low:
        return False
    for extent, boxes, beyond in ((one, one_boxes, other), (other, other_boxes, one)):
        band = _BAND * (extent[across + 2] - extent[across])
        if extent[across] < beyond[across]:
            at_side = boxes[:, across + 2] > extent[across + 2] - band
        else:
            at_side = boxes[:, across] < extent[across] + band
        if _covered(boxes[at_side][:, [along, along + 2]], low, high) < _WALLED:
            return False
    return True


def _covered(spans: Float[np.ndarray, "n 2"], low: float, high: float) -> float:
    """Share of an interval that spans cover."""
    first, last = np.clip(spans, low, high).T
    covered = covered_lengths(np.zeros(len(spans), dtype=int), first, last, 1)
    return float(covered[0]) / (high - low)


def storey_words(
    walls: Shaped[np.ndarray, " n"], storey_of: Int[np.ndarray, " n"]
) -> tuple[str, ...]:
    """Where on the sheet each storey is."""
    boxes = shapely.bounds(walls)
    extents = _extents(boxes, storey_of)[1]
    whole, centre = shapely.total_bounds(walls), (extents[:, :2] + extents[:, 2:]) / 2
    share = (centre - whole[:2]) / np.maximum(whole[2:] - whole[:2], 1e-6)
    words = []
    for u, v in np.minimum(3 * share, 2).astype(int):
        both = (("top", "", "bottom")[v], ("left", "", "right")[u])
        words.append(" ".join(filter(None, both)) or "middle")
    return tuple(words)


def storeys_warning(words: tuple[str, ...]) -> str:
    """What to say of several plans on a sheet where none was chosen.

    `words`: where each is.
    """
    listed = ", ".join(f"{k} ({where})" for k, where in enumerate(words))
    return (
        f"{len(words)} plans on one sheet, probably storeys: {listed}; all are kept, "
        "choose one with --storey 0 and so on"
    )


def storey_number(name: str, asked: str, storeys: tuple[str, ...]) -> int:
    """Which of the plans on a sheet is asked for, by its number or by where it is.

    Raises:
        FloorplanError: there is no such, or there are several.
    """
    known = [str(k) for k in range(len(storeys))]
    if asked in known:
        return int(asked)
    if asked in storeys and storeys.count(asked) == 1:
        return storeys.index(asked)
    listed = ", ".join(f"{k} ({where})" for k, where in enumerate(storeys))
    raise FloorplanError(
        f"{name}: expected a storey of {listed}, found {asked!r}; choose one of these"
    )


def _overlapping(
    boxes: Float[np.ndarray, "n 4"], group: Int[np.ndarray, " n"]
) -> Int[np.ndarray, " n"]:
    """Number of the group of each, those being one whose extents overlap."""
    while True:
        names, group = np.unique(group, return_inverse=True)
        extents = np.asarray(shapely.box(*_extents(boxes, group)[1].T), dtype=object)
        a, b = shapely.STRtree(extents).query(extents, predicate="intersects")
        of = connected_groups(a, b, len(names))
        group = of[group]
        if of.max() + 1 == len(names):
            return group


def _joined_by_drawing(
    extents: Float[np.ndarray, "g 4"], lines: Bool[np.ndarray, "h w"]
) -> tuple[int, int] | None:
    """The first two groups side by side, by their boxes, that drawing joins; None where there are none."""
    for i, extent in enumerate(extents):
        apart = _apart(extent, extents[i + 1 :])
        is_beside = np.asarray((apart > 0).any(axis=1) & (apart < 0).any(axis=1))
        for j in i + 1 + np.flatnonzero(is_beside):
            if _are_joined(extent, extents[j], lines):
                return i, int(j)
    return None


def _are_joined(
    one: Float[np.ndarray, "4"], other: Float[np.ndarray, "4"], lines: Bool[np.ndarray, "h w"]
) -> bool:
    """Whether something is drawn everywhere between two boxes that lie side by side."""
    low, high = np.maximum(one[:2], other[:2]), np.minimum(one[2:], other[2:])
    u0, v0 = np.maximum(np.floor(np.minimum(low, high)).astype(int), 0)
    u1, v1 = np.ceil(np.maximum(low, high)).astype(int) + 1
    between = lines[v0:v1, u0:u1]
    if high[0] < low[0] and low[1] < high[1]:
        return bool(between.any(axis=0).all())
    if high[1] < low[1] and low[0] < high[0]:
        return bool(between.any(axis=1).all())
    return False


def _extents(
    boxes: Float[np.ndarray, "n 4"], group: Int[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " g"], Float[np.ndarray, "g 4"]]:
    """Names of groups, ascending, and the box around the boxes of each."""
    names, of = np.unique(group, return_inverse=True)
    low, high = np.full((len(names), 2), np.inf), np.full((len(names), 2), -np.inf)
    np.minimum.at(low, of, boxes[:, :2])
    np.maximum.at(high, of, boxes[:, 2:])
    return names, np.concatenate([low, high], axis=1)


def _apart(
    one: Float[np.ndarray, "4"], others: Float[np.ndarray, "n 4"]
) -> Float[np.ndarray, "n 2"]:
    """How far a box is from others along u and along v; below 0 where they overlap."""
    return np.maximum(one[:2] - others[:, 2:], others[:, :2] - one[2:])


def _gap(one: Float[np.ndarray, "4"], other: Float[np.ndarray, "4"]) -> float:
    """Distance between two boxes."""
    return float(np.hypot(*np.maximum(_apart(one, other[None])[0], 0.0)))


def _row(extents: Float[np.ndarray, "n 4"], is_storey: Bool[np.ndarray, " n"], i: int) -> int:
    """How many storeys lie wholly above."""
    return int((extents[is_storey, 3] < (extents[i, 1] + extents[i, 3]) / 2).sum())


def join_storeys(plans: Mapping[int, Floorplan]) -> Floorplan:
    """All faces of plans that are in one frame, in metres, each face with the storey of its plan.

    What only one drawing has, such as its own coordinates and the openings to draw, stays with the plans.

    Args:
        plans: by storey; at least one.
    """
    parts = list(plans.values())
    is_thick = any(part.thickness is not None for part in parts)
    thickness = [
        np.full(len(part), np.nan) if part.thickness is None else part.thickness for part in parts
    ]
    return Floorplan(
        " and ".join(dict.fromkeys(part.name for part in parts)),
        np.concatenate([part.ends for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.is_oriented for part in parts]),
        fingerprint=" ".join(part.fingerprint for part in parts),
        thickness=np.concatenate(thickness) if is_thick else None,
        source=PlanSource(warnings=tuple(w for part in parts for w in part.source.warnings)),
        storeys=np.repeat(list(plans), [len(part) for part in parts]),
    )
