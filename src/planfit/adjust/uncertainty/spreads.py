"""What residuals say of the sigmas that a term was given, and of errors that many of its bundles share.

A bundle's mean residual is taken for the sum of an error of its own and one that it shares with all others
of its cluster: the patches of one wall, the pairs of one visit, the steps of one stretch of the walk, as a
tracker drifts the same way for a while. Both variances come from two sums of
squares, about the clusters' means and of these means (variance components, Searle et al. 1992), less what
fitting the poses took out of them. That a thousand points of a wall which is drawn 2 cm off agree with each
other then says nothing.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import sparse

from planfit.adjust.uncertainty.bundles import Bundles
from planfit.lsq.covariance import Factors

ROWS_AT_A_TIME = 16_384
"""Residuals whose products with all probes are held at once: 4 MB each."""
N_PROBES = 32
"""Random vectors that traces of products with the inverse are taken by (Hutchinson 1990)."""
STATED_BUNDLES, STATED_CLUSTERS = 1.0, 4.0
"""What was stated of a bundle's own error counts like so many bundles that were seen, and of an error that is
shared like so many clusters. Stated sigmas are wide: 4 bundles would say more than 15 ceilings that were
seen."""

MIN_MOTION_FACTOR = 0.1
"""On the variance of relative motions, at least. An error of the tracker leaves no residual where nothing
else measures, and one that neighbouring pairs of views share none between them: so neither is believed to be
better than a third of the sigma that it claims. A quarter and a tenth were tried: mean squares of poses 0.64
and 0.70 of what is stated on the scans for choosing, ConSLAM's the same."""


@dataclass(frozen=True)
class Spread:
    """Of a term, by its residuals."""

    factor: float
    """On the variance of each bundle's own error, as stated by sigma and effective observations."""
    shared_m: float
    """Standard deviation, each axis, of the error that all bundles of a cluster share: m; of recorded steps
    in sigmas."""


@dataclass(frozen=True)
class Probes:
    """Random signs, and the inverse normal equations times them."""

    signs: Float[np.ndarray, "u p"]
    solved: Float[np.ndarray, "u p"]

    @staticmethod
    def make(factors: Factors, rng: np.random.Generator) -> "Probes":
        """For the normal equations that are factorised."""
        signs = rng.choice([-1.0, 1.0], size=(len(factors.scale), N_PROBES))
        return Probes(signs, factors.solve(signs))

    def trace(self, rows: sparse.csr_array, weights: Float[np.ndarray, " r"]) -> float:
        """Of the inverse times rows^T weights rows."""
        total = 0.0
        for first in range(0, len(weights), ROWS_AT_A_TIME):
            part = slice(first, first + ROWS_AT_A_TIME)
            each = (rows[part] @ self.signs) * (rows[part] @ self.solved)
            total += float(weights[part] @ each.mean(axis=1))
        return total

    def trace_of_blocks(
        self, rows: sparse.csr_array, information: Float[np.ndarray, "k d d"]
    ) -> float:
        """The same, the weights being k matrices along the diagonal."""
        k, d, _ = information.shape
        signs, solved = ((rows @ v).reshape(k, d, -1) for v in (self.signs, self.solved))
        return float(np.einsum("kip,kij,kjp->p", signs, information, solved).mean())


@dataclass(frozen=True)
class Clusters:
    """Bundles summed by what they share."""

    weights: Float[np.ndarray, " c"]
    """1/m^2."""
    residuals: Float[np.ndarray, "c d"]
    """Mean, m."""
    pull: sparse.csr_array
    """(6 n, c d): how an error of 1 m that a cluster shares pulls on the poses."""

    @staticmethod
    def of(bundles: Bundles) -> "Clusters":
        """Weighted means and sums."""
        d, n, cluster = bundles.residuals.shape[1], bundles.n_clusters, bundles.cluster
        weights = np.bincount(cluster, bundles.weights, n)
        pick = sparse.csr_array(
            (bundles.weights, (cluster, np.arange(len(cluster)))), (n, len(cluster))
        )
        each_axis = sparse.kron(pick, sparse.eye_array(d), format="csr")
        pull = (each_axis @ bundles.jacobian).T.tocsr()
        return Clusters(weights, (pick @ bundles.residuals) / weights[:, None], pull)


def find_spread(
    bundles: Bundles,
    clusters: Clusters,
    factors: Factors,
    probes: Probes,
    rng: np.random.Generator,
    shared_prior_m: float,
) -> Spread:
    """Both variances of a term.

    Args:
        shared_prior_m: what a shared error is expected to be before anything is seen, m.
    """
    d = bundles.residuals.shape[1]
    of_clusters = np.repeat(clusters.weights, d)
    between = float(clusters.weights @ np.sum(clusters.residuals**2, axis=1))
    within = float(bundles.weights @ np.sum(bundles.residuals**2, axis=1)) - between
    fitted = probes.trace(bundles.jacobian, np.repeat(bundles.weights, d))
    fitted_between = probes.trace(clusters.pull.T.tocsr(), 1.0 / of_clusters)
    # What is left of each once poses were fitted: as many numbers as it has, less those.
    left_between = max(len(of_clusters) - fitted_between, 0.0)
    left_within = max(bundles.residuals.size - len(of_clusters) - (fitted - fitted_between), 0.0)
    factor = (STATED_BUNDLES + within) / (STATED_BUNDLES + left_within)
    # What is left of shared errors once the poses have followed them.
    signs = rng.choice([-1.0, 1.0], size=(len(of_clusters), N_PROBES))
    left = signs - (clusters.pull.T @ factors.solve(clusters.pull @ signs)) / of_clusters[:, None]
    of_unit = float(of_clusters @ np.mean(left**2, axis=1))
    variance = shared_variance(between, left_between, of_unit, factor, shared_prior_m)
    return Spread(factor, float(np.sqrt(variance)))


def shared_variance(
    between: float, n_left: float, of_unit: float, factor: float, prior_m: float
) -> float:
    """Variance (m^2, each axis) of the error that clusters share.

    Args:
        between: weighted sum of squares of the clusters' mean residuals.
        n_left: numbers in that once poses were fitted.
        of_unit: the same sum, were each cluster's error 1 m^2 before that.
        factor: on the variance of bundles' own errors.
        prior_m: expected before anything is seen.
    """
    seen = max(between - factor * n_left, 0.0) / max(of_unit, 1e-12)
    n_seen = max(n_left, 0.0) if of_unit > 0 else 0.0
    shared = STATED_CLUSTERS * prior_m**2 + n_seen * seen
    # Two less: the mean of a variance that so few were seen of (inverse gamma).
    return shared / (STATED_CLUSTERS + n_seen - 2.0)


def find_motion_factor(
    residuals: Float[np.ndarray, "k 6"],
    information: Float[np.ndarray, "k 6 6"],
    robust_weights: Float[np.ndarray, " k"],
    jacobian: sparse.csr_array,
    probes: Probes,
) -> float:
    """Factor on the covariances of relative motions that surfaces were matched by.

    Args:
        information: of each, of a rank below 6 where surfaces leave directions free.
        jacobian: (6 k, 6 n), of the residuals by the tangents of n poses.
    """
    weighted = robust_weights[:, None, None] * information
    measured = robust_weights @ np.linalg.matrix_rank(information, hermitian=True)
    left = max(measured - probes.trace_of_blocks(jacobian, weighted), 0.0)
    squares = float(np.einsum("ki,kij,kj->", residuals, weighted, residuals))
    factor = (STATED_BUNDLES + squares) / (STATED_BUNDLES + left)
    return max(factor, MIN_MOTION_FACTOR)
