"""Map quality without a truth: mean map entropy (MME) and mean plane variance (MPV)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from planfit.evaluation.neighbour_kernels import smallest_eigenvalues
from planfit.evaluation.neighbourhoods import each_block, make_grid

DEPTH_RADIUS_M = 0.2
"""Neighbourhood for depth cameras, as in the published library; 1.0 for LiDAR."""
MIN_NEIGHBOURS = 6
"""Neighbours, the point included, from which on a point counts: more than five."""
_FLAT = 1e-14
"""A determinant below this times the cube of the trace is zero but for rounding: a depth off by 1 mm in 0.2 m
leaves 1e-8."""


@dataclass(frozen=True)
class MapQuality:
    """Sharpness of a map; lower is better. Depends on the sampling and the radius: compare only like with
    like."""

    mme: float
    """Mean over points of 0.5 ln det(2 pi e C), C the covariance of the neighbourhood (m^2); NaN where no
    point has enough neighbours around it."""
    mpv_m2: float
    """Mean over points of the smallest eigenvalue of C; NaN likewise."""
    plane_variance_m2: Float[np.ndarray, " m"]
    """Smallest eigenvalue at each point, NaN where it has fewer than two neighbours."""
    n_neighbours: Int[np.ndarray, " m"]
    """Within the radius, the point included."""


def map_quality(
    points: Float[np.ndarray, "m 3"], radius_m: float = DEPTH_RADIUS_M, workers: int = 1
) -> MapQuality:
    """MME and MPV of points (m), and the plane variance at every point.

    Raises:
        OptionError: the radius is not above 0, or a few points are far away from all others.
    """
    variance = np.full(len(points), np.nan, dtype=np.float32)
    n_neighbours = np.zeros(len(points), dtype=np.int32)
    sums = np.zeros(4)
    for idx, counts, smallest, block_sums in each_block(
        make_grid(points, radius_m), _block, workers
    ):
        n_neighbours[idx] = counts
        variance[idx] = smallest
        sums += block_sums
    entropy_sum, n_entropy, variance_sum, n_variance = (float(v) for v in sums)
    constant = 1.5 * np.log(2 * np.pi * np.e)  # det(2 pi e C) = (2 pi e)^3 det C
    return MapQuality(
        mme=entropy_sum / n_entropy + constant if n_entropy else np.nan,
        mpv_m2=variance_sum / n_variance if n_variance else np.nan,
        plane_variance_m2=variance,
        n_neighbours=n_neighbours,
    )


def _block(
    idx: np.ndarray, counts: np.ndarray, covariance: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Index, neighbours and plane variance of the points of a block; sum and number of both means."""
    smallest = np.zeros(len(idx))
    smallest_eigenvalues(covariance, smallest)
    enough = counts >= MIN_NEIGHBOURS
    determinant, trace = _determinants(covariance[enough])
    is_solid = determinant > _FLAT * trace**3
    sums = np.array(
        [
            np.sum(0.5 * np.log(determinant[is_solid])),
            is_solid.sum(),
            smallest[enough].sum(),
            enough.sum(),
        ]
    )
    return idx, counts, np.where(counts >= 2, smallest, np.nan), sums


def _determinants(covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Determinants and traces (m,) of symmetric matrices by their six entries (m, 6)."""
    a, b, c, d, e, f = covariance.T  # xx xy xz yy yz zz; expanded along the first row
    return a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d), a + d + f
