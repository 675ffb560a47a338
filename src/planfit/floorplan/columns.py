"""Which faces of a plan are columns: small closed outlines that stand by themselves."""

from dataclasses import dataclass

import numpy as np
import scipy.spatial
from jaxtyping import Float, Int

from planfit.floorplan.near_lines import connected_groups
from planfit.floorplan.types import Floorplan
from planfit.geometry import segments
from planfit.priors import COLUMN_SIDE_M

MOST_M = COLUMN_SIDE_M.high
"""Columns are no longer than this where the unit is known."""
MOST_THICKNESSES = 6.0
"""Else than so many thicknesses of the usual wall."""
ELONGATED = 3.0
"""What is longer than this many times its width is a piece of wall, or a line of one; else a column."""
_GAP = 0.15
"""Ends of neighbours are apart by less than this share of a column: edges of tones are set one by one."""


@dataclass(frozen=True)
class Columns:
    """Columns, in the units of the plan."""

    face: Int[np.ndarray, " n"]
    """For each face of the plan, the number of the column that it belongs to; -1 for none."""
    centres: Float[np.ndarray, "k 2"]
    sizes: Float[np.ndarray, "k 2"]
    """Extents in x and y."""


def find_columns(floorplan: Floorplan) -> Columns:
    """Rings of faces that look outwards, no larger than columns are, to which no wall is joined.

    Columns within a wall are part of its outline. A ring that looks inwards is a shaft.
    """
    ends = floorplan.ends
    n = len(ends)
    most = _most(floorplan)
    small = np.flatnonzero(floorplan.is_oriented & (floorplan.lengths <= most))
    none = Columns(np.full(n, -1), np.zeros((0, 2)), np.zeros((0, 2)))
    if len(small) < 3:
        return none
    tips = ends.reshape(-1, 2)
    tree = scipy.spatial.cKDTree(tips)
    own = np.repeat(small, 2)
    near = _GAP * np.minimum(most, 4 * floorplan.lengths[own])
    touched = tree.query_ball_point(tips[2 * own + np.tile([0, 1], len(small))], near)
    a = np.repeat(own, [len(other) for other in touched])
    b = np.concatenate([np.array(other, dtype=int) for other in touched]) // 2
    group = connected_groups(a, b, n)
    face, centres, sizes = np.full(n, -1), [], []
    is_small = np.zeros(n, dtype=bool)
    is_small[small] = True
    n_faces = np.bincount(group)
    n_small = np.bincount(group[small], minlength=len(n_faces))
    for each in np.flatnonzero((n_small >= 3) & (n_small == n_faces)):
        at = np.flatnonzero(group == each)
        if not _is_column(ends[at], floorplan.normals[at], most):
            continue
        low, high = ends[at].min(axis=(0, 1)), ends[at].max(axis=(0, 1))
        face[at] = len(centres)
        centres.append((low + high) / 2)
        sizes.append(high - low)
    return Columns(face, np.reshape(centres, (-1, 2)), np.reshape(sizes, (-1, 2)))


def _most(floorplan: Floorplan) -> float:
    """Largest side of a column, in units of the plan."""
    if floorplan.is_metric:
        return MOST_M
    thickness = floorplan.thickness
    if thickness is None or not np.isfinite(thickness).any():
        return 0.0
    return MOST_THICKNESSES * float(np.nanmedian(thickness))


def _is_column(
    ends: Float[np.ndarray, "m 2 2"], normals: Float[np.ndarray, "m 2"], most: float
) -> bool:
    """Whether faces go once around a compact body, which they look away from."""
    middle = ends.mean(axis=1)
    tips = ends.reshape(-1, 2)
    size = np.ptp(tips, axis=0)
    side = float(size.max())
    if not 0 < side <= most:
        return False
    # Along their main axes: what stands askew has a square box too.
    axes = np.linalg.svd(tips - tips.mean(axis=0), full_matrices=False)[2]
    across = np.ptp(tips @ axes.T, axis=0)
    if across.max() > ELONGATED * across.min():
        return False
    from_centre = middle - (tips.min(axis=0) + tips.max(axis=0)) / 2
    if (np.einsum("mi,mi->m", from_centre, normals) <= 0).any():
        return False
    # All around: the normals of a closed ring, weighed by the lengths of its faces, add up to nothing.
    length = segments.lengths(ends)
    rest = np.linalg.norm(normals.T @ length)
    return bool(rest < 2 * _GAP * length.sum() / np.pi)
