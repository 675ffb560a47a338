"""Mutually orthogonal metric (MOM): how thick the map is on three planes that each depth map itself shows."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.cluster.hierarchy import fcluster, linkage

from planfit.evaluation.map_quality import MapQuality, MapSample
from planfit.evaluation.neighbourhoods import as_matrices, covariances, make_grid

_PLANAR = 100.0
"""A point is planar where its smallest eigenvalue is below the middle one by this factor."""
_MAX_DIFFERENCE = 0.1
"""Normals of one cluster differ by at most this (complete linkage); the cosine of orthogonal ones is
smaller."""
_MIN_NEIGHBOURS = 4
_MIN_POINTS = 6
_MAX_POINTS = 1500
"""Planar points of a depth map that are clustered, evenly thinned: clustering takes their square in
memory."""


@dataclass(frozen=True)
class OrthogonalSets:
    """Points on three mutually orthogonal planes of a depth map, as indices into a `MapSample`."""

    frame_idx: int
    sets: tuple[Int[np.ndarray, " a"], Int[np.ndarray, " b"], Int[np.ndarray, " c"]]


def find_orthogonal_sets(
    sample: MapSample, radius_m: float, max_frames: int
) -> tuple[OrthogonalSets, ...]:
    """Orthogonal planes of some depth maps, evenly spread; poses play no part.

    Depth maps that show no three orthogonal planes are left out.
    """
    filled = np.flatnonzero(np.diff(sample.start))
    chosen = filled[np.linspace(0, len(filled) - 1, min(max_frames, len(filled))).astype(int)]
    found = []
    for i in chosen.tolist():
        triple = orthogonal_triple(sample.of_frame(i).astype(float), radius_m)
        if triple is not None:
            first, second, third = (idx + sample.start[i] for idx in triple)
            found.append(OrthogonalSets(i, (first, second, third)))
    return tuple(found)


def orthogonal_triple(
    points_cam: Float[np.ndarray, "m 3"], radius_m: float
) -> tuple[Int[np.ndarray, " a"], Int[np.ndarray, " b"], Int[np.ndarray, " c"]] | None:
    """Indices of points (m), camera frame, in the three orthogonal clusters with the most points."""
    idx, normals = planar_normals(points_cam, radius_m)
    step = max(1, -(-len(idx) // _MAX_POINTS))
    idx, normals = idx[::step], normals[::step]
    if len(idx) < 3 * _MIN_POINTS:
        return None
    labels = fcluster(linkage(normals, "complete"), _MAX_DIFFERENCE, criterion="distance")
    sizes = np.bincount(labels)
    kept = np.flatnonzero(sizes >= _MIN_POINTS)
    means = (
        np.stack([normals[labels == k].mean(axis=0) for k in kept]) if len(kept) else normals[:0]
    )
    means /= np.linalg.norm(means, axis=1, keepdims=True)
    best = _largest_triple(np.abs(means @ means.T) < _MAX_DIFFERENCE, sizes[kept])
    if best is None:
        return None
    first, second, third = (idx[labels == kept[k]] for k in best)
    return first, second, third


def planar_normals(
    points_cam: Float[np.ndarray, "m 3"], radius_m: float
) -> tuple[Int[np.ndarray, " p"], Float[np.ndarray, "p 3"]]:
    """Index of the planar points among points (m), and their unit normals towards the camera."""
    counts = np.zeros(len(points_cam), dtype=int)
    covariance = np.zeros((len(points_cam), 6))
    for idx, n, found in covariances(make_grid(points_cam, radius_m)):
        counts[idx], covariance[idx] = n, found
    values, vectors = np.linalg.eigh(as_matrices(covariance))
    is_planar = (counts >= _MIN_NEIGHBOURS) & (_PLANAR * values[:, 0] < values[:, 1])
    idx = np.flatnonzero(is_planar)
    normals = vectors[idx, :, 0]
    faces_away = np.einsum("ni,ni->n", normals, points_cam[idx]) > 0
    return idx, np.where(faces_away[:, None], -normals, normals)


def mom_m2(sets: tuple[OrthogonalSets, ...], quality: MapQuality) -> float:
    """MOM: mean over depth maps of the sum over three planes of the median plane variance in the map.

    Args:
        sets: of depth maps of the sample.
        quality: of the map made of the whole sample, its points in their order.

    Returns:
        m^2; NaN where no depth map shows three orthogonal planes.
    """
    sums = []
    for of_frame in sets:
        medians = []
        for idx in of_frame.sets:
            idx = idx[quality.n_neighbours[idx] >= _MIN_NEIGHBOURS]
            if len(idx):
                medians.append(float(np.median(quality.plane_variance_m2[idx])))
        if len(medians) == 3:
            sums.append(sum(medians))
    return float(np.mean(sums)) if sums else np.nan


def _largest_triple(is_orthogonal: np.ndarray, sizes: np.ndarray) -> tuple[int, int, int] | None:
    """Three clusters, each orthogonal to the others, with the most points; the first of equals."""
    best, most = None, 0
    # k < j < i, so that each triple is looked at once.
    for i in range(len(sizes)):
        for j in np.flatnonzero(is_orthogonal[i, : i + 1]):
            common = np.flatnonzero(is_orthogonal[i, :j] & is_orthogonal[j, :j])
            if len(common) == 0:
                continue
            k = common[np.argmax(sizes[common])]
            total = int(sizes[i] + sizes[j] + sizes[k])
            if total > most:
                best, most = (int(k), int(j), i), total
    return best
