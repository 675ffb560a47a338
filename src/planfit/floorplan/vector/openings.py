"""Windows as they are drawn in line work: panes from jamb to jamb in a wall that goes on beyond both.
Left in, panes are thin walls, and sills drawn through make the faces of the wall run on."""

from dataclasses import dataclass

import numpy as np
import shapely
from jaxtyping import Float, Int
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.faces import PARALLEL_SINE, Ends, line_strings
from planfit.floorplan.vector.line_work import cut_out
from planfit.geometry import segments

MAX_LENGTH = 12.0
"""Of an opening, in thicknesses of its wall: 4.8 m in one of 40 cm."""
LAYERED_LENGTH = 8.0
"""Of a box with one line within, in thicknesses of its wall: longer ones are layers of the wall."""
_CROSS_SINE = 0.94


@dataclass(frozen=True)
class Windows:
    """Openings in walls drawn as two lines."""

    openings: Float[np.ndarray, "k 2 2"]
    """Their two sides along the faces of the wall."""
    ends: Float[np.ndarray, "m 2 2"]
    """The lines without panes, cut where sills ran through."""
    line: Int[np.ndarray, " m"]
    """The line that each was."""


def take_out_windows(ends: Ends, least: float, most: float, tolerance: float) -> Windows:
    """Find windows among lines and take out what is drawn in them.

    A pane ends within two lines across it, the jambs. The wall is what both jambs span, and beyond each
    of them one of its faces goes on, with nothing between; otherwise lines within are layers of a wall.

    Args:
        ends: merged, no two on one another.
        least: thickness of walls.
        most: thickness of walls.
        tolerance: how exactly lines meet.
    """
    boxes = _boxes(ends, least, most, tolerance)
    if len(boxes) == 0:
        return Windows(np.zeros((0, 2, 2)), ends, np.arange(len(ends)))
    sides = np.ascontiguousarray(np.concatenate([boxes[:, [0, 1]], boxes[:, [3, 2]]]))
    # Sideways past the sills, lengthwise short of the jambs.
    along = segments.directions(boxes[:, [0, 1]])[:, None] * tolerance
    across = segments.directions(boxes[:, [0, 3]])[:, None] * tolerance
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])[None, :, :, None]
    insides = boxes - signs[:, :, 0] * along + signs[:, :, 1] * across
    area: BaseGeometry = shapely.union_all(shapely.polygons(insides))
    parts, line = cut_out(ends, area, 3 * tolerance)
    return Windows(sides, parts, line)


def _boxes(ends: Ends, least: float, most: float, tolerance: float) -> Float[np.ndarray, "k 4 2"]:
    """Corners of the openings, the first two along one face of the wall."""
    n = len(ends)
    tree = shapely.STRtree(line_strings(ends))
    left, length = segments.left_normals(ends), segments.lengths(ends)
    tips = np.concatenate([ends[:, 0], ends[:, 1]])
    tip, jamb = tree.query(shapely.points(tips), predicate="dwithin", distance=tolerance)
    pane = tip % n
    sine = np.abs(np.einsum("pi,pi->p", segments.directions(ends)[jamb], left[pane]))
    inset = np.linalg.norm(tips[tip][:, None] - ends[jamb], axis=2).min(axis=1)
    keep = (sine > _CROSS_SINE) & (inset > 4 * tolerance) & (length[pane] > least)
    tip, jamb, pane = tip[keep], jamb[keep], pane[keep]
    jambs_of: dict[int, tuple[list[int], list[int]]] = {}
    for t, j, p in zip(tip.tolist(), jamb.tolist(), pane.tolist(), strict=True):
        jambs_of.setdefault(p, ([], []))[t // n].append(j)
    found, seen = [], set()
    for p, (first, second) in jambs_of.items():
        for a in first:
            for b in second:
                spans = np.sort((ends[[a, b]] - ends[p, 0]) @ left[p], axis=1)
                low, high = spans[:, 0].max(), spans[:, 1].min()
                is_inside = low < -4 * tolerance and high > 4 * tolerance
                if a == b or (a, b) in seen or not (is_inside and least < high - low < most):
                    continue
                seen |= {(a, b), (b, a)}
                found.append(ends[p][[0, 1, 1, 0]] + np.outer([low, low, high, high], left[p]))
    rows = _in_rows(np.array(found).reshape(-1, 4, 2), tolerance)
    is_opening = [
        _is_in_wall(box, ends, tree, tolerance) and not _is_layered(box, ends, tree, tolerance)
        for box in rows
    ]
    return _outermost(rows[is_opening], tolerance)


def _in_rows(boxes: Float[np.ndarray, "n 4 2"], tolerance: float) -> Float[np.ndarray, "k 4 2"]:
    """Boxes with those made one that only a mullion, no wider than the wall is thick, parts."""
    rows = [*boxes]
    at = 0
    while at < len(rows):
        box = rows[at]
        origin, along = box[0], (box[1] - box[0]) / np.linalg.norm(box[1] - box[0])
        axes = np.stack([along, (box[3] - box[0]) / np.linalg.norm(box[3] - box[0])], axis=1)
        width = float(np.linalg.norm(box[3] - box[0]))
        low, high = 0.0, float(np.linalg.norm(box[1] - box[0]))
        others = []
        for k in range(at + 1, len(rows)):
            local = (rows[k] - origin) @ axes
            sides = np.sort(local[:, 1])
            is_in_row = np.abs(sides - [0, 0, width, width]).max() < 2 * tolerance
            if is_in_row and local[:, 0].max() > low - width and local[:, 0].min() < high + width:
                others.append(k)
                low, high = min(low, local[:, 0].min()), max(high, local[:, 0].max())
        if others:
            corners = np.array([[low, 0], [high, 0], [high, width], [low, width]])
            rows[at] = origin + corners @ axes.T
            rows = [row for k, row in enumerate(rows) if k not in others]
        else:
            at += 1
    return np.array(rows).reshape(-1, 4, 2)


def _is_in_wall(
    box: Float[np.ndarray, "4 2"], ends: Ends, tree: shapely.STRtree, tolerance: float
) -> bool:
    """Whether beyond both ends of a box a line goes on along one of its sides, and none between them:
    there would be layers of a wall."""
    length, width = (float(np.linalg.norm(box[k] - box[0])) for k in (1, 3))
    if not width < length < MAX_LENGTH * width:
        return False
    direction = (box[1] - box[0]) / length
    outwards = np.outer([-1.0, 1.0, 1.0, -1.0], direction) * width
    is_parallel = np.abs(segments.left_normals(ends) @ direction) < PARALLEL_SINE
    beyond = shapely.points(box + 0.5 * outwards)
    corner, line = tree.query(beyond, "dwithin", 2 * tolerance)
    goes_on = set(corner[is_parallel[line]].tolist())
    if not (goes_on & {0, 3} and goes_on & {1, 2}):
        return False
    for one, other in ((0, 3), (1, 2)):
        # A bar across the wall, short of its faces.
        bar = np.array([0.8 * box[one] + 0.2 * box[other], 0.2 * box[one] + 0.8 * box[other]])
        near = bar + 0.25 * outwards[one]
        crossing = tree.query(shapely.LineString(near), predicate="intersects")
        if is_parallel[crossing].any():
            return False
    return True


def _is_layered(
    box: Float[np.ndarray, "4 2"], ends: Ends, tree: shapely.STRtree, tolerance: float
) -> bool:
    """Whether a long box between two faces drawn through holds one line alone: two leaves of a wall. A window
    so long has a frame, or panes that mullions part."""
    along, across = box[1] - box[0], box[3] - box[0]
    length, width = float(np.linalg.norm(along)), float(np.linalg.norm(across))
    if length < LAYERED_LENGTH * width:
        return False
    near = tree.query(shapely.Polygon(box), predicate="dwithin", distance=2 * tolerance)
    local = (ends[near] - box[0]) @ np.stack([along / length, across / width], axis=1)
    first, last = local[..., 0].min(axis=1), local[..., 0].max(axis=1)
    covered = np.minimum(last, length) - np.maximum(first, 0)
    is_through = (covered > 0.8 * length) & (np.ptp(local[..., 1], axis=1) < 2 * tolerance)
    at = local[is_through, :, 1].mean(axis=1)
    is_low, is_high = at < 2 * tolerance, at > width - 2 * tolerance
    return bool(is_low.any() and is_high.any() and (~is_low & ~is_high).sum() == 1)


def _outermost(boxes: Float[np.ndarray, "n 4 2"], tolerance: float) -> Float[np.ndarray, "k 4 2"]:
    """Boxes without those within others: frames within openings."""
    polygons = np.asarray(shapely.polygons(boxes), dtype=object)
    order = np.argsort(-shapely.area(polygons), kind="stable")
    kept: list[int] = []
    for k in order:
        around = shapely.buffer(polygons[kept], 2 * tolerance, join_style="mitre")
        if not shapely.covers(around, polygons[k]).any():
            kept.append(int(k))
    return boxes[sorted(kept)]
