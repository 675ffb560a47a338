"""The rest of the outline of a wall whose two faces are drawn: solid corners, piers, niches."""

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.faces import line_strings, weighted_median
from planfit.floorplan.vector.candidates import Candidates
from planfit.floorplan.vector.double_lines import LineFaces
from planfit.floorplan.vector.line_work import cut_out, outlines
from planfit.floorplan.vector.single_lines import MAX_OUTLINE_LINES
from planfit.geometry import segments

MIN_SHARE = 0.8
"""An area is the body of a wall where faces with the wall behind them, in the area, are this share of its
outline. A room has none: its faces look into it."""
MIN_LENGTH = 1.5
"""Of what is added, in usual thicknesses: the closed end of a wall is as long as the wall is thick."""


def rest_of_bodies(candidates: Candidates, faces: LineFaces, extent: float) -> LineFaces:
    """Faces where lines close the body of a wall that is thicker there than a wall may be.

    None of drawings of more than `MAX_OUTLINE_LINES` lines, whose areas take too long to close.

    Args:
        candidates: all lines that were looked at.
        faces: found among them as two faces of one wall.
        extent: of the drawing.
    """
    none = LineFaces.together([])
    paired = faces.take(np.isfinite(faces.thickness) & faces.is_oriented & (faces.line >= 0))
    if len(paired.ends) == 0 or len(candidates) > MAX_OUTLINE_LINES:
        return none
    usual = weighted_median(paired.thickness, segments.lengths(paired.ends))
    tolerance = 1e-4 * extent
    # Corners of a drawing are as good as its last digit.
    lines = shapely.union_all(line_strings(candidates.ends), grid_size=0.1 * tolerance)
    areas = shapely.get_parts(shapely.polygonize([lines]))
    if len(areas) == 0:
        return none
    points, of = segments.sample(np.ascontiguousarray(paired.ends), 0.5 * usual)
    behind = points - 0.25 * paired.thickness[of, None] * paired.normals[of]
    point, area = shapely.STRtree(areas).query(shapely.points(behind), predicate="within")
    count = np.bincount(of, minlength=len(paired.ends))
    each = (segments.lengths(paired.ends) / np.maximum(count, 1))[of[point]]
    length = np.bincount(area, each, minlength=len(areas))
    taken = shapely.union_all(shapely.buffer(line_strings(faces.ends), tolerance, cap_style="flat"))
    ends, normals = [np.zeros((0, 2, 2))], [np.zeros((0, 2))]
    for body in areas[length > MIN_SHARE * shapely.length(areas)]:
        rest, _ = cut_out(outlines([body]), taken, MIN_LENGTH * usual)
        rest = rest[segments.lengths(rest) > MIN_LENGTH * usual]
        ends.append(rest)
        normals.append(_out_of(body, rest, tolerance))
    found = np.concatenate(ends)
    if len(found) == 0:
        return none
    nearest = shapely.STRtree(line_strings(candidates.ends)).nearest(
        shapely.points(found.mean(axis=1))
    )
    n = len(found)
    return LineFaces(
        found, np.concatenate(normals), np.ones(n, dtype=bool), np.full(n, np.nan), nearest
    )


def _out_of(body: BaseGeometry, ends: np.ndarray, step: float) -> np.ndarray:
    """Normals (n, 2) of parts of an outline, out of its area."""
    left = segments.left_normals(ends)
    is_inside = shapely.contains(body, shapely.points(ends.mean(axis=1) + step * left))
    return np.where(is_inside[:, None], -left, left)
