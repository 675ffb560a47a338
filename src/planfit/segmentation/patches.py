"""Upright planar patches among the wall points of one frame."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from planfit.priors import COLUMN_SIDE_M, WALL_LENGTH_LEAST_M

_TOLERANCE_M = 0.04
"""Points within this, plus `_TOLERANCE_PER_M` of their distance, lie on a patch."""
_TOLERANCE_PER_M = 0.004
"""Growth of the tolerance with distance from the camera."""
_MAX_PER_FRAME = 8
"""Patches looked for in a frame, largest first."""
_ROUNDS = 200
"""Random pairs of points tried for each patch."""
_MIN_BASE_M = 0.2
"""Nearer pairs of points do not tell the direction of a line."""


@dataclass(frozen=True)
class PatchSize:
    """When points of a frame are enough for a flat patch."""

    min_points: int
    """Fewer sampled points are clutter."""
    min_length_m: float
    """Shorter patches say little about the direction of their surface."""


WALL_PATCH = PatchSize(min_points=60, min_length_m=WALL_LENGTH_LEAST_M.value)
COLUMN_PATCH = PatchSize(min_points=30, min_length_m=COLUMN_SIDE_M.low)
"""A column's side is short."""


@dataclass(frozen=True)
class Patch:
    """A flat upright patch of wall in a frame turned level, seen from its origin."""

    point_idx: Int[np.ndarray, " k"]
    """Into the points given."""
    normal: Float[np.ndarray, "2"]
    """Unit, towards the camera."""
    ends: Float[np.ndarray, "2 2"]
    """m."""


def find_patches(
    xy: Float[np.ndarray, "n 2"], size: PatchSize, rng: np.random.Generator
) -> list[Patch]:
    """Sequential RANSAC for lines among wall points (m) seen from above, camera at the origin."""
    patches: list[Patch] = []
    left = np.arange(len(xy))
    tolerance = _TOLERANCE_M + _TOLERANCE_PER_M * np.linalg.norm(xy, axis=1)
    while len(left) >= size.min_points and len(patches) < _MAX_PER_FRAME:
        members = left[_largest_line(xy[left], tolerance[left], rng)]
        if len(members) < size.min_points:
            break
        left = np.setdiff1d(left, members, assume_unique=True)
        patch = _make_patch(xy, members, size)
        if patch is not None:
            patches.append(patch)
    return patches


def _largest_line(xy: np.ndarray, tolerance: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Indices (k,) of the points (n, 2) on the line that most lie on, refitted twice."""
    pairs = rng.integers(len(xy), size=(_ROUNDS, 2))
    along = xy[pairs[:, 1]] - xy[pairs[:, 0]]
    length = np.linalg.norm(along, axis=1)
    pairs, along = (
        pairs[length > _MIN_BASE_M],
        along[length > _MIN_BASE_M] / length[length > _MIN_BASE_M, None],
    )
    if len(pairs) == 0:
        return np.zeros(0, dtype=int)
    # All lines against all points in one product: normals (2, r), distances (n, r).
    normals = np.stack([-along[:, 1], along[:, 0]])
    offsets = np.sum(normals.T * xy[pairs[:, 0]], axis=1)
    is_near = np.abs(xy @ normals - offsets) < tolerance[:, None]
    on_line = is_near[:, np.argmax(is_near.sum(axis=0))]
    for _ in range(2):
        normal, centre = _fit_line(xy[on_line])
        on_line = np.abs((xy - centre) @ normal) < tolerance
    return np.flatnonzero(on_line)


def _fit_line(xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit normal (2,) and centre (2,) of the line nearest to points (n, 2) by least squares."""
    centre = xy.mean(axis=0)
    # Eigenvalues rise: the first vector is the direction of least scatter.
    _, vectors = np.linalg.eigh((xy - centre).T @ (xy - centre))
    return vectors[:, 0], centre


def _make_patch(xy: np.ndarray, members: np.ndarray, size: PatchSize) -> Patch | None:
    """Cut the run of most points without a gap of half a metre out of a line's members (k,)."""
    normal, centre = _fit_line(xy[members])
    if normal @ centre > 0:
        normal = -normal
    along = np.array([-normal[1], normal[0]])
    at = (xy[members] - centre) @ along
    # Sorted along the line, a gap is a large difference of neighbours; the points part there.
    order = np.argsort(at)
    breaks = np.flatnonzero(np.diff(at[order]) > 0.5) + 1
    run = max(np.split(order, breaks), key=len)
    low, high = np.quantile(at[run], [0.02, 0.98])
    if len(run) < size.min_points or high - low < size.min_length_m:
        return None
    ends = centre + np.outer([low, high], along)
    return Patch(np.sort(members[run]), normal, ends)
