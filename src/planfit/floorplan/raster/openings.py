"""Doors and windows: gaps of the same place and width in both faces of a wall."""

import numpy as np
import shapely
from jaxtyping import Float, Int

from planfit.floorplan.gaps import PARALLEL
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
    ends: Float[np.ndarray, "n 2 2"],
    asked: Float[np.ndarray, "m 2 2"],
    margin: Float[np.ndarray, " m"],
) -> list[Int[np.ndarray, " k"]]:
    """For each segment asked about, which segments have a box that its own, grown by a margin, meets: to look
    at all for each takes minutes where a picture has ten thousand."""
    low, high = asked.min(axis=1) - margin[:, None], asked.max(axis=1) + margin[:, None]
    tree = shapely.STRtree(shapely.box(*ends.min(axis=1).T, *ends.max(axis=1).T))
    of, found = tree.query(shapely.box(*low.T, *high.T))
    order = np.lexsort((found, of))
    return np.split(found[order], np.searchsorted(of[order], np.arange(1, len(asked))))


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
    asked = np.flatnonzero(is_long)
    if len(asked) == 0:
        return result
    # Where the face goes on: no further than an opening is wide.
    begin = ends[asked, 1]
    along_all = (begin - ends[asked, 0]) / lengths[asked, None]
    beyond = begin + (_WIDEST * thickness[asked] + 1.0)[:, None] * along_all
    margin = np.full(len(asked), _LINE_PX + 2.0)
    near_of = _those_near(ends, np.stack([begin, beyond], axis=1), margin)
    for i, along, some in zip(asked, along_all, near_of, strict=True):
        others = ends[some]
        offset = np.abs((others - ends[i, 0]) @ normals[i]).max(axis=1)
        same = is_long[some] & (normals[some] @ normals[i] > PARALLEL) & (offset < _LINE_PX)
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
            0.5 * thick < wide < _WIDEST * thick
            and max(thickness[i], thickness[j]) < 1.7 * thick + 2
        ):
            nearest = ends[j][np.argmin((ends[j] - ends[i, 0]) @ along)]
            result.append((np.array([ends[i, 1], nearest]), normals[i], thick))
    return result
