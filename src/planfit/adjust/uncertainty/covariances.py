"""Covariances of poses: what residuals say of each term, and of what all frames share, carried to the poses.

The adjustment weighs its terms by the sigmas that it was given; what comes out of it errs by what they
really are. With H the normal equations, cov = H^-1 (sum of f_t H_t + sum of tau_t^2 g g^T) H^-1 + S C S^T:
f_t and tau_t are a term's spreads (`spreads`), g pulls of its clusters, C the covariance of what all frames
share and S how poses follow it (consider covariance analysis: Bierman, Factorization Methods for Discrete
Sequential Estimation, 1977).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse

from planfit.adjust.problem import AdjustmentProblem
from planfit.adjust.rigid_motion import free_motions, rigid_tangents
from planfit.adjust.terms.levels import LevelTerm
from planfit.adjust.terms.odometry import OdometryTerm
from planfit.adjust.terms.points import PointTerm
from planfit.adjust.terms.walls import WallTerm
from planfit.adjust.uncertainty.bundles import Bundles, pair_bundles, plane_bundles, sparse_rows
from planfit.adjust.uncertainty.spreads import (
    Clusters,
    Probes,
    Spread,
    find_spread,
    find_step_factors,
)
from planfit.lsq.blocks import NormalBlocks
from planfit.lsq.covariance import Factors, factorised
from planfit.lsq.linear.normal_equations import NormalEquations
from planfit.lsq.term import Term
from planfit.lsq.terms.residual import WeightedResiduals

DRAWN_SIGMA_M = 0.01
"""Of walls about where they are drawn, before anything is seen of them; no other error is thought to be
shared."""


@dataclass(frozen=True)
class SharedError:
    """What all frames share and is not known exactly: the sensor, the scales of odometry and plan."""

    covariance: Float[np.ndarray, "s s"]
    """Of the shared parameters."""
    pose_by_shared: Float[np.ndarray, "u 6 s"]
    """How poses follow them, tangents as in `planfit.geometry.se3`."""


@dataclass(frozen=True)
class _Model:
    """Errors of all terms, carried to the normal equations."""

    factors: Factors
    noise: sparse.csr_array
    """(6 n, 6 n): covariance of the gradient, errors that bundles share left out."""
    shared: sparse.csr_array
    """(6 n, c): pulls of clusters, each by one standard deviation."""
    free: Float[np.ndarray, "6 f"]
    """Rigid motions that nothing fixed holds, axes of `rigid_tangents`; each is held at the first camera."""


def pose_covariances(
    problem: AdjustmentProblem,
    stretch: Int[np.ndarray, " n"],
    misfit: Float[np.ndarray, " n"],
    idx: Int[np.ndarray, " k"],
    rng: np.random.Generator,
    shared: SharedError | None = None,
) -> tuple[Float[np.ndarray, "k 6 6"], dict[str, Spread]]:
    """Covariances [rad^2, rad m, m^2] of some poses, tangents (rotation, translation), target axes.

    Where nothing fixed holds the whole, what remains once the positions asked for are brought to the true
    ones by one rigid motion (the S-transformation of geodetic networks, Baarda 1973). Where something holds
    it, but for some motions (height, if the floor takes no part), by one of those.

    Args:
        problem: all terms, its unknowns where they are least.
        stretch: of the walk that each camera belongs to: matches between two of them share their errors.
        misfit: factor on the variance of the recorded steps from each camera on.
        idx: cameras asked for.
        rng: draws random signs for traces.
        shared: what all frames share; None where that is known, or nothing.

    Returns:
        covariances, and the spreads of each term whose residuals tell them.
    """
    model, spreads = _model(problem, stretch, misfit, rng)
    if model.free.shape[1] > 0:
        return _aligned(model, problem.unknowns, idx, shared), spreads
    blocks = []
    for i in idx:
        solved = model.factors.columns(6 * int(i) + np.arange(6))
        by_clusters = model.shared.T @ solved
        blocks.append(solved.T @ (model.noise @ solved) + by_clusters.T @ by_clusters)
    covariances = np.stack(blocks)
    if shared is not None:
        by = shared.pose_by_shared[idx]
        covariances += by @ shared.covariance @ np.swapaxes(by, 1, 2)
    return 0.5 * (covariances + np.swapaxes(covariances, 1, 2)), spreads


def _model(
    problem: AdjustmentProblem,
    stretch: Int[np.ndarray, " n"],
    misfit: Float[np.ndarray, " n"],
    rng: np.random.Generator,
) -> tuple[_Model, dict[str, Spread]]:
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
                part = _of_steps(term, unknowns, misfit, probes)
            noise.append(part)
            continue
        clusters, is_wall = Clusters.of(own), isinstance(term, WallTerm)
        prior_m = DRAWN_SIGMA_M if is_wall else 0.0
        spread = find_spread(own, clusters, factors, probes, rng, prior_m)
        spreads[term.name] = spread
        noise.append(replace(part, blocks=spread.factor * part.blocks))
        pulls.append(spread.shared_m * clusters.pull)
    matrix = sparse.csr_array(NormalEquations(noise, n).matrix)
    return _Model(factors, matrix, sparse.hstack(pulls, format="csr"), free), spreads


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
) -> Bundles | None:
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


def _of_steps(
    term: OdometryTerm,
    unknowns: Float[np.ndarray, "u 4 4"],
    misfit: Float[np.ndarray, " n"],
    probes: Probes,
) -> NormalBlocks:
    """The recorded steps' part of the gradient's covariance."""
    weighted, rows = term.reweight(unknowns)[0], term.between.rows
    k, information = len(weighted.information), weighted.information
    by_ends = rows.jacobians(unknowns).reshape(k, 6, 2, 6).transpose(0, 2, 1, 3)
    jacobian = sparse_rows(by_ends, term.between.pairs, len(unknowns))
    residuals = rows.residuals(unknowns)
    factors = np.repeat(find_step_factors(residuals, information, jacobian, probes), 3)
    # Where the tracker was worse than it said, in a stretch of its own, that counts.
    by_step = np.where(misfit[:k, None] > 1.0, np.maximum(misfit[:k, None], factors), factors)
    return WeightedResiduals(rows, by_step * information).normal_blocks(unknowns)


def _aligned(
    model: _Model,
    unknowns: Float[np.ndarray, "u 4 4"],
    idx: Int[np.ndarray, " k"],
    shared: SharedError | None,
) -> Float[np.ndarray, "k 6 6"]:
    rows, k = (6 * idx[:, None] + np.arange(6)).ravel(), len(idx)
    solved = model.factors.columns(rows)
    by_clusters = model.shared.T @ solved
    whole = solved.T @ (model.noise @ solved) + by_clusters.T @ by_clusters
    if shared is not None:
        by = shared.pose_by_shared[idx].reshape(6 * k, -1)
        whole += by @ shared.covariance @ by.T
    without = _without_rigid(unknowns[idx, :3, 3], model.free)
    left = (without @ whole @ without.T).reshape(k, 6, k, 6)
    return np.einsum("kikj->kij", left)


def _without_rigid(
    positions: Float[np.ndarray, "k 3"], free: Float[np.ndarray, "6 f"]
) -> Float[np.ndarray, "u u"]:
    """Takes out of the poses' tangents those of free rigid motions that their positions ask for."""
    k, f = len(positions), free.shape[1]
    moved = rigid_tangents(positions) @ free
    fit = np.zeros((f, k, 6))
    fit[:, :, 3:] = np.linalg.pinv(moved[:, 3:].reshape(3 * k, f)).reshape(f, k, 3)
    return np.eye(6 * k) - moved.reshape(6 * k, f) @ fit.reshape(f, 6 * k)
