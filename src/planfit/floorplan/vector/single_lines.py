"""Walls drawn as single lines, whose thickness and free side a drawing does not tell."""

import numpy as np
import shapely
from jaxtyping import Float, Int
from shapely.geometry.base import BaseGeometry

from planfit.floorplan.faces import line_strings
from planfit.floorplan.vector.candidates import Candidates
from planfit.floorplan.vector.double_lines import LineFaces
from planfit.floorplan.vector.line_work import cut_out
from planfit.geometry import segments

SINGLE_SHARE = 0.3
"""Where less became faces than this share of the long lines left, walls are drawn as single lines."""
FEW_SHARE = 0.25
"""The same of lines longer than a tenth of the drawing, which furniture is not."""


def single_lines(candidates: Candidates, faces: LineFaces, extent: float) -> LineFaces:
    """Long lines where walls are drawn as such, as faces whose free side is unknown.

    Of layers called wall, those of which little became faces. Of a drawing without such layers all, where
    what became faces is little beside the very long ones, or is little beside the rest and fills little of
    its room: a counter, a staircase.

    Args:
        candidates: all lines that were looked at.
        faces: that were found among them.
        extent: of the drawing.
    """
    if len(candidates) == 0:
        return LineFaces.together([])
    rest = candidates.cut(*cut_out(candidates.ends, body_of_faces(faces, extent), 0.01 * extent))
    length = segments.lengths(rest.ends)
    is_long = length > 0.02 * extent
    own = np.flatnonzero(is_long & (rest.layer >= 0))
    n_layers = int(candidates.layer.max()) + 1 if len(candidates) else 0
    left = np.bincount(rest.layer[own], length[own], minlength=max(n_layers, 1))
    on_line = faces.line >= 0
    of_face = candidates.layer[faces.line[on_line]]
    face_length = segments.lengths(faces.ends[on_line])
    taken = np.bincount(of_face[of_face >= 0], face_length[of_face >= 0], minlength=len(left))
    if candidates.is_called_wall.any():
        is_single = taken < SINGLE_SHARE * left
        at = own[rest.is_called_wall[own] & is_single[rest.layer[own]]]
    else:
        total = segments.lengths(faces.ends).sum()
        very_long = length[own][length[own] > 0.1 * extent].sum()
        is_corner = _room(faces.ends) < 0.5 * _room(rest.ends[own])
        is_single = total < FEW_SHARE * very_long or (
            is_corner and total < SINGLE_SHARE * left.sum()
        )
        at = own if is_single or len(faces.ends) == 0 else own[:0]
    ends, n = rest.ends[at], len(at)
    line = np.array([], dtype=int) if n == 0 else _nearest_line(candidates.ends, ends)
    return LineFaces(
        ends, segments.left_normals(ends), np.zeros(n, dtype=bool), np.full(n, np.nan), line
    )


def _nearest_line(
    lines: Float[np.ndarray, "n 2 2"], parts: Float[np.ndarray, "k 2 2"]
) -> Int[np.ndarray, " k"]:
    """Index of the line that each part was cut from."""
    middles = shapely.points(parts.mean(axis=1))
    return np.asarray(shapely.STRtree(line_strings(lines)).nearest(middles), dtype=int)


def body_of_faces(faces: LineFaces, extent: float) -> BaseGeometry:
    """Walls behind faces, with the faces themselves."""
    if len(faces.ends) == 0:
        return shapely.Polygon()
    depth = np.where(np.isfinite(faces.thickness), faces.thickness, 0.0)[:, None]
    behind = faces.ends - (depth * faces.normals)[:, None]
    quads = np.concatenate([faces.ends, behind[:, ::-1]], axis=1)
    shapes = [*np.asarray(shapely.polygons(quads)), *line_strings(faces.ends)]
    return shapely.union_all(
        shapely.buffer(np.array(shapes, dtype=object), 1e-3 * extent, join_style="mitre")
    )


def _room(ends: Float[np.ndarray, "n 2 2"]) -> float:
    """Area of the box around segments; 0 of none."""
    if len(ends) == 0:
        return 0.0
    return float(np.prod(np.ptp(ends.reshape(-1, 2), axis=0)))
