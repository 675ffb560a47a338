"""Several plans on one sheet: groups of walls whose extents stay apart."""

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int, Shaped

_APART = 0.3
"""Groups that come nearer than this many thicknesses of a wall are one."""
_LEAST_SHARE = 0.12
"""A group of less area or less wall than this share of the largest is a part of its neighbour: a wall around
a yard has the extent of a storey, and little in it."""


def find_storeys(
    walls: Shaped[np.ndarray, " n"],
    thickness_px: float,
    openings: Float[np.ndarray, "k 2 2"],
    lines: Bool[np.ndarray, "h w"],
) -> Int[np.ndarray, " n"]:
    """Number of the storey of each region of wall; numbered as one reads a page.

    Args:
        walls: polygons.
        thickness_px: usual thickness of a wall.
        openings: doors and windows; the walls on their two sides are of one storey.
        lines: everything drawn: storeys have a blank strip between them.
    """
    boxes = shapely.bounds(walls) + np.array([-1, -1, 1, 1]) * _APART * thickness_px
    group = np.arange(len(walls))
    if len(openings):
        tree = shapely.STRtree(walls)
        sides = tree.nearest(shapely.points(openings.reshape(-1, 2))).reshape(-1, 2)
        for a, b in sides:
            group[group == group[b]] = group[a]
    while True:
        merged = _merged_once(boxes, group, lines)
        if (merged == group).all():
            break
        group = merged
    names = np.unique(group)
    extents = np.array([_extent(boxes[group == name]) for name in names])
    area = np.prod(extents[:, 2:] - extents[:, :2], axis=1)
    length = np.array([shapely.length(walls[group == name]).sum() for name in names])
    is_storey = (area >= _LEAST_SHARE * area.max()) & (length >= _LEAST_SHARE * length.max())
    is_storey[np.argmax(length)] = True
    centre = (extents[:, :2] + extents[:, 2:]) / 2
    # Down the page in rows: plans whose extents overlap in v stand side by side.
    order = sorted(
        np.flatnonzero(is_storey), key=lambda i: (_row(extents, is_storey, int(i)), centre[i, 0])
    )
    number = {names[i]: k for k, i in enumerate(order)}
    for i in np.flatnonzero(~is_storey):
        gaps = [_gap(extents[i], extents[j]) for j in order]
        number[names[i]] = int(np.argmin(gaps))
    return np.array([number[name] for name in group])


def storey_words(
    walls: Shaped[np.ndarray, " n"], storey_of: Int[np.ndarray, " n"]
) -> tuple[str, ...]:
    """Where on the sheet each storey is."""
    boxes = shapely.bounds(walls)
    extents = np.array([_extent(boxes[storey_of == k]) for k in range(storey_of.max() + 1)])
    whole, centre = _extent(boxes), (extents[:, :2] + extents[:, 2:]) / 2
    share = (centre - whole[:2]) / np.maximum(whole[2:] - whole[:2], 1e-6)
    words = []
    for u, v in share:
        across = "left" if u < 0.4 else "right" if u > 0.6 else ""
        down = "top" if v < 0.4 else "bottom" if v > 0.6 else ""
        words.append(" ".join(word for word in (down, across) if word) or "middle")
    return tuple(words)


def _merged_once(
    boxes: Float[np.ndarray, "n 4"], group: Int[np.ndarray, " n"], lines: Bool[np.ndarray, "h w"]
) -> Int[np.ndarray, " n"]:
    """Groups whose extents overlap, or that drawing joins, become one."""
    result = group.copy()
    names = np.unique(group)
    extents = [_extent(boxes[group == name]) for name in names]
    for i in range(len(names)):
        for j in range(i + 1, len(names)):
            near = _gap(extents[i], extents[j]) == 0.0
            if near or _are_joined(extents[i], extents[j], lines):
                result[result == names[j]] = names[i]
                return result
    return result


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


def _extent(boxes: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "4"]:
    return np.concatenate([boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)])


def _gap(one: Float[np.ndarray, "4"], other: Float[np.ndarray, "4"]) -> float:
    """Distance between two boxes."""
    apart = np.maximum(np.maximum(one[:2] - other[2:], other[:2] - one[2:]), 0.0)
    return float(np.hypot(*apart))


def _row(extents: Float[np.ndarray, "n 4"], is_storey: Bool[np.ndarray, " n"], i: int) -> int:
    """How many storeys lie wholly above."""
    return int((extents[is_storey, 3] < (extents[i, 1] + extents[i, 3]) / 2).sum())
