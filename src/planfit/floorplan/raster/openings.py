"""Doors and windows: gaps of the same place and width in both faces of a wall."""

import numpy as np
from jaxtyping import Float

from planfit.geometry import segments

_LINE_PX = 2.5
_WIDEST = 14.0
"""Openings are at most this many times as wide as their wall is thick."""


def find_openings(
    ends: Float[np.ndarray, "n 2 2"],
    normals: Float[np.ndarray, "n 2"],
    thickness: Float[np.ndarray, " n"],
) -> Float[np.ndarray, "k 2 2"]:
    """Openings along the faces they interrupt, one on each face of the wall.

    Only gaps that both faces have count: a gap in one face alone is a wall that meets it, or a recess.

    Args:
        ends: faces, px.
        normals: to the free side.
        thickness: of the wall behind each, px.
    """
    gaps = _gaps(ends, normals, thickness)
    if len(gaps) == 0:
        return np.zeros((0, 2, 2))
    gap_ends = np.array([gap for gap, _, _ in gaps])
    gap_normals = np.array([normal for _, normal, _ in gaps])
    gap_thickness = np.array([thick for _, _, thick in gaps])
    kept = np.zeros(len(gaps), dtype=bool)
    for i in range(len(gaps)):
        opposite = gap_normals @ gap_normals[i] < -0.99
        behind = (gap_ends[i, 0] - gap_ends[:, 0]) @ gap_normals[i]
        near = opposite & (np.abs(behind - gap_thickness[i]) < 0.35 * gap_thickness[i] + 1.0)
        along = gap_ends[i, 1] - gap_ends[i, 0]
        length = np.linalg.norm(along)
        at = np.sort((gap_ends - gap_ends[i, 0]) @ (along / length), axis=1)
        overlap = np.minimum(at[:, 1], length) - np.maximum(at[:, 0], 0.0)
        kept[i] = bool((near & (overlap > 0.8 * np.maximum(length, at[:, 1] - at[:, 0]))).any())
    return gap_ends[kept]


def _gaps(
    ends: Float[np.ndarray, "n 2 2"],
    normals: Float[np.ndarray, "n 2"],
    thickness: Float[np.ndarray, " n"],
) -> list[tuple[Float[np.ndarray, "2 2"], Float[np.ndarray, "2"], float]]:
    """Gaps between faces of one line: ends, normal, thickness of the wall."""
    lengths = segments.lengths(ends)
    # A jamb is short and has the whole length of its wall behind it.
    is_long = lengths > 0.5 * thickness
    result = []
    for i in np.flatnonzero(is_long):
        along = (ends[i, 1] - ends[i, 0]) / lengths[i]
        offset = np.abs((ends - ends[i, 0]) @ normals[i]).max(axis=1)
        same = is_long & (normals @ normals[i] > 0.99) & (offset < _LINE_PX)
        at = np.sort((ends - ends[i, 0]) @ along, axis=1)
        later = np.flatnonzero(same & (at[:, 0] > lengths[i] - 1.0))
        if len(later) == 0:
            continue
        j = later[np.argmin(at[later, 0])]
        wide, thick = at[j, 0] - lengths[i], float(min(thickness[i], thickness[j]))
        if max(lengths[i], lengths[j]) < 1.2 * thick:
            continue  # two columns
        if (
            0.5 * thick < wide < _WIDEST * thick
            and max(thickness[i], thickness[j]) < 1.7 * thick + 2
        ):
            nearest = ends[j][np.argmin((ends[j] - ends[i, 0]) @ along)]
            result.append((np.array([ends[i, 1], nearest]), normals[i], thick))
    return result
