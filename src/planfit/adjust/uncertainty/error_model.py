"""Errors of all terms, as residuals tell them, carried to the normal equations.

The adjustment weighs its terms by the sigmas that it was given; what comes out of it errs by what they
really are (`spreads`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse

from planfit.adjust.problem import AdjustmentProblem
from planfit.adjust.rigid_motion import free_motions, rigid_tangents
from planfit.adjust.terms.between import OdometryTerm, PointTerm, SurfaceTerm
from planfit.adjust.terms.levels import LevelTerm
from planfit.adjust.terms.walls import WallTerm
from planfit.adjust.uncertainty.bundles import (
    Bundles,
    PointBundles,
    pair_bundles,
    plane_bundles,
    sparse_rows,
)
from planfit.adjust.uncertainty.spreads import (
    MIN_MOTION_FACTOR,
    Clusters,
    Probes,
    Spread,
    find_motion_factor,
    find_spread,
)
from planfit.lsq.blocks import NormalBlocks
from planfit.lsq.covariance import Factors, factorised
from planfit.lsq.normal_equations import NormalEquations
from planfit.lsq.residual_term import WeightedResiduals
from planfit.lsq.robust import loss_value
from planfit.lsq.term import Term
from planfit.scan.odometry import FIXED_M

DRAWN_SIGMA_M = 0.01
"""Of walls about where they are drawn, before anything is seen of them; no other error is thought to be
shared."""
AXES_OF_STEPS = ([0, 1], [2], [3, 4], [5])
"""Tilt, heading, way and height among the six numbers of a step (rotation, translation), z up."""


@dataclass(frozen=True)
class ErrorModel:
    """Errors of all terms, carried to the normal equations."""

    factors: Factors
    noise: sparse.csr_array
    """(6 n, 6 n): covariance of the gradient, errors that bundles share left out."""
    shared: sparse.csr_array
    """(6 n, c): pulls of clusters, each by one standard deviation."""
    free: Float[np.ndarray, "6 f"]
    """Rigid motions that nothing fixed holds, axes of `rigid_tangents`; each is held at the first camera."""
    spreads: dict[str, Spread]
    """Of each term whose residuals tell them."""
    bundles: dict[str, PointBundles]
    """Of the same terms."""


def model_errors(
    problem: AdjustmentProblem,
    stretch: Int[np.ndarray, " n"],
    misfit: Float[np.ndarray, " n"],
    rng: np.random.Generator,
) -> ErrorModel:
    """Spreads of all terms where an adjustment ended, and what they come to.

    Args:
        problem: all terms, its unknowns where they are least.
        stretch: of the walk that each camera belongs to: matches between two of them share their errors.
        misfit: factor on the variance of the recorded steps from each camera on.
    """
    unknowns, n = problem.unknowns, len(problem.unknowns)
    bundles = {
        t.name: b for t in problem.terms if (b := _bundles(t, unknowns, stretch)) is not None
    }
    parts = []
    for term in problem.terms:
        own = bundles.get(term.name)
        quadratic = term.reweight(unknowns)[0] if own is None else own.moments
        parts.append(quadratic.normal_blocks(unknowns))
    if problem.gauge is None:
        free = free_motions(parts, unknowns, problem.n_cams)
        of_first = rigid_tangents(unknowns[: problem.n_cams, :3, 3])[0] @ free
        factors = factorised(NormalEquations([*parts, _held_at_first(parts, of_first, n)], n))
    else:
        free, factors = np.eye(6), factorised(NormalEquations(parts, n))
    probes = Probes.make(factors, rng)
    noise, pulls, spreads = [], [sparse.csr_array((6 * n, 0))], {}
    for term, part in zip(problem.terms, parts, strict=True):
        own = bundles.get(term.name)
        if own is None:
            if isinstance(term, OdometryTerm):
                steps = Steps.of(term, unknowns)
                found = steps.spreads(stretch, factors, probes, rng)
                part = steps.noise([spread.factor for spread, _ in found], misfit)
                pulls += [spread.shared_m * clusters.pull for spread, clusters in found]
            elif isinstance(term, SurfaceTerm):
                factor = _of_surfaces(term, unknowns, probes)
                part = replace(part, blocks=factor * part.blocks)
            noise.append(part)
            continue
        clusters, is_wall = Clusters.of(own), isinstance(term, WallTerm)
        prior_m = DRAWN_SIGMA_M if is_wall else 0.0
        spread = find_spread(own, clusters, factors, probes, rng, prior_m)
        spreads[term.name] = spread
        noise.append(replace(part, blocks=spread.factor * part.blocks))
        pulls.append(spread.shared_m * clusters.pull)
    matrix = sparse.csr_array(NormalEquations(noise, n).matrix)
    shared = sparse.hstack(pulls, format="csr")
    return ErrorModel(factors, matrix, shared, free, spreads, bundles)


def _held_at_first(
    parts: Sequence[NormalBlocks], motions: Float[np.ndarray, "6 f"], n: int
) -> NormalBlocks:
    """Holds the first camera against some motions, as firmly as anything holds it.

    Solved as they are, singular equations give columns of rounding errors: variances below 0.
    """
    of_first = sum(p.blocks[(p.rows == 0) & (p.columns == 0)].sum(axis=0) for p in parts)
    diagonal = np.diagonal(of_first)
    root = np.sqrt(np.maximum(diagonal, 1e-12 * max(diagonal.max(), 1e-300)))[:, None]
    axes = np.linalg.qr(root * motions)[0]
    block = root * (axes @ axes.T) * root.T
    first = np.zeros(1, dtype=int)
    return NormalBlocks(first, first, block[None], np.zeros((n, 6)))


def _bundles(
    term: Term, unknowns: Float[np.ndarray, "u 4 4"], stretch: Int[np.ndarray, " n"]
) -> PointBundles | None:
    """Bundles of a term over points, by what their errors are shared with; None of another."""
    found = None
    if isinstance(term, WallTerm):
        found = plane_bundles(term.groups, unknowns, term.association.face_idx)
    elif isinstance(term, LevelTerm):
        groups = term.groups
        found = plane_bundles(groups, unknowns, stretch[groups.pose_idx])
    elif isinstance(term, PointTerm):
        groups = term.groups
        first, last = np.sort(stretch[groups.pairs], axis=1).T
        found = pair_bundles(groups, unknowns, first * (int(stretch[-1]) + 1) + last)
    return None if found is None or len(found.weights) == 0 else found


@dataclass(frozen=True)
class Steps:
    """k recorded steps where an adjustment ended: departures (rotation, translation), axes whose z is up."""

    term: OdometryTerm
    unknowns: Float[np.ndarray, "u 4 4"]
    upright: Float[np.ndarray, "k 6 6"]
    """To those axes from the second camera's. Sigmas are the same along all three of either."""
    residuals: Float[np.ndarray, "k 6"]
    information: Float[np.ndarray, "k 6"]
    """Robust weights in it."""
    jacobian: sparse.csr_array
    """(6 k, 6 u): of the residuals by the tangents of the poses."""

    @staticmethod
    def of(term: OdometryTerm, unknowns: Float[np.ndarray, "u 4 4"]) -> "Steps":
        """Of a term."""
        rows, information = term.between.rows, term.reweight(unknowns)[0].information
        k = len(information)
        upright = np.zeros((k, 6, 6))
        upright[:, :3, :3] = upright[:, 3:, 3:] = unknowns[term.between.pairs[:, 1], :3, :3]
        by_ends = (upright @ rows.jacobians(unknowns)).reshape(k, 6, 2, 6).transpose(0, 2, 1, 3)
        return Steps(
            term,
            unknowns,
            upright,
            np.einsum("kij,kj->ki", upright, rows.residuals(unknowns)),
            information,
            sparse_rows(by_ends, term.between.pairs, len(unknowns)),
        )

    def spreads(
        self,
        stretch: Int[np.ndarray, " n"],
        factors: Factors,
        probes: Probes,
        rng: np.random.Generator,
    ) -> list[tuple[Spread, Clusters]]:
        """Of tilt, heading, way and height: a tracker that feels gravity is surer of the first and the last.
        Cameras that are fixed to each other do not drift."""
        sigmas = self.term.between.sigma
        assert isinstance(sigmas, np.ndarray)
        moving = np.flatnonzero(sigmas[:, 3] > FIXED_M)
        first = self.term.between.pairs[moving, 0]
        labels, cluster = np.unique(stretch[first], return_inverse=True)
        found = []
        for axes in AXES_OF_STEPS:
            rows, sigma = (6 * moving[:, None] + axes).ravel(), sigmas[moving][:, axes]
            bundles = Bundles(
                self.residuals[moving][:, axes] / sigma,
                self.information[moving, axes[0]] * sigma[:, 0] ** 2,
                sparse.csr_array(sparse.diags_array(1.0 / sigma.ravel()) @ self.jacobian[rows]),
                cluster,
                labels,
            )
            clusters = Clusters.of(bundles)
            found.append((find_spread(bundles, clusters, factors, probes, rng, 0.0), clusters))
        return found

    def noise(self, factors: Sequence[float], misfit: Float[np.ndarray, " n"]) -> NormalBlocks:
        """The steps' part of the gradient's covariance, by factors on the variances of tilt, heading, way and
        height."""
        by_axis = np.ones(6)
        for axes, factor in zip(AXES_OF_STEPS, factors, strict=True):
            by_axis[axes] = max(factor, MIN_MOTION_FACTOR)
        # Where the tracker was worse than it said, in a stretch of its own, that counts.
        worse = misfit[: len(self.residuals), None]
        by_step = np.where(worse > 1.0, np.maximum(worse, by_axis), by_axis)
        noise = np.swapaxes(self.upright, 1, 2) @ (
            (by_step * self.information)[:, :, None] * self.upright
        )
        return WeightedResiduals(self.term.between.rows, noise).normal_blocks(self.unknowns)


def _of_surfaces(term: SurfaceTerm, unknowns: Float[np.ndarray, "u 4 4"], probes: Probes) -> float:
    """Factor on the covariances of motions that surfaces were matched by."""
    rows, information = term.between.rows, term.between.information
    assert information is not None
    jacobians = rows.jacobians(unknowns)
    by_ends = jacobians.reshape(len(jacobians), 6, 2, 6).transpose(0, 2, 1, 3)
    jacobian = sparse_rows(by_ends, term.pairs, len(unknowns))
    residuals = rows.residuals(unknowns)
    in_sigmas = np.einsum("ki,kij,kj->k", residuals, information, residuals)
    weights = term.model.weight * loss_value(in_sigmas, term.model.loss)[1]
    return find_motion_factor(residuals, information, weights, jacobian, probes)
