"""Line work of a drawing or model, kept to be shown behind the faces that were found in it."""

from collections.abc import Sequence

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.vector.drawing import Drawing
from planfit.floorplan.vector.layer_names import Role
from planfit.geometry import segments

MAX_LINES = 100_000
"""More of them, in 3 MB, do not show in a picture of 1600 px: those left off are the shortest."""


def shown_lines(
    drawing: Drawing,
    roles: list[Role],
    is_left_out: np.ndarray,
    apart: np.ndarray,
    file_from_drawing: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """What was looked at, and what was left out: (k, 2, 2) each, in the file's own coordinates.

    Args:
        drawing: cleaned.
        roles: of its layers.
        is_left_out: (n,) bool of its lines: not looked at as walls.
        apart: (m, 2, 2) faces that were found and left out, in the drawing's coordinates.
        file_from_drawing: (3, 3), affine.
    """
    by_role: tuple[list[BaseGeometry], list[BaseGeometry]] = ([], [])
    for fill in drawing.fills:
        by_role[roles[fill.layer] == Role.NO_WALL].append(fill.polygon)
    ends = drawing.lines.ends
    kept = np.concatenate([ends[~is_left_out], outlines(by_role[0])])
    left = np.concatenate([ends[is_left_out], outlines(by_role[1]), apart])
    return moved(longest(kept), file_from_drawing), moved(longest(left), file_from_drawing)


def outlines(shapes: Sequence[BaseGeometry]) -> np.ndarray:
    """Pieces (k, 2, 2) of the rings of areas and of lines; points have none."""
    parts = shapely.get_parts(shapely.get_parts(np.array(shapes, dtype=object)))
    kinds = shapely.get_type_id(parts)
    rings = shapely.get_rings(parts[kinds == shapely.GeometryType.POLYGON])
    lines = parts[kinds == shapely.GeometryType.LINESTRING]
    points, of = shapely.get_coordinates(np.concatenate([rings, lines]), return_index=True)
    same = of[:-1] == of[1:]
    return np.stack([points[:-1][same], points[1:][same]], axis=1)


def longest(ends: np.ndarray, n: int = MAX_LINES) -> np.ndarray:
    """At most `n` of the segments (k, 2, 2), in their order."""
    if len(ends) <= n:
        return ends
    shortest_first = np.argsort(segments.lengths(ends), kind="stable")
    return ends[np.sort(shortest_first[-n:])]


def moved(ends: np.ndarray, there_from_here: np.ndarray) -> np.ndarray:
    """Segments (k, 2, 2) under an affine map (3, 3)."""
    return ends @ there_from_here[:2, :2].T + there_from_here[:2, 2]
