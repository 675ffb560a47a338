"""How far each camera of a result may be off: from solves without a part, from rivals, and from the sigmas.

Where nothing fixed holds the whole (no plan, no control points), an error is what is left once positions are
brought to the truth by one rigid motion: the frame that the gauge holds is no surer than the others.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from planfit.adjust import AdjustmentProblem, Rival
from planfit.adjust.torn_steps import step_departures
from planfit.geometry import se3
from planfit.lsq.covariance import aligned_position_covariances, position_covariances
from planfit.pipeline.folds import Folds

MAX_COVARIANCES = 120
"""Frames whose covariance is taken, evenly along the walk; between them it is interpolated."""
MAX_STEP_SIGMAS = 5.0
"""A step that departs by more counts as this much in the misfit of its stretch: the jackknife sees it too."""
RIVAL_COST = 10.0
"""A rival whose full cost is this much higher counts 1/e as much as the result: errors of one wall, or of the
matches of one place, are not independent, so costs are no log likelihoods to the letter."""


def predicted_covariance(
    problem: AdjustmentProblem,
    rivals: Sequence[Rival],
    folds: Folds,
    by_fold: Sequence[Float[np.ndarray, "k 4 4"]],
) -> Float[np.ndarray, "k 3 3"]:
    """Covariance of camera positions (m^2, target axes).

    The sigmas know of noise, not of what is wrong; the folds of what pulls differently, not of what nothing
    measures, nor of another optimum; the rivals of that.

    Args:
        problem: all evidence, its unknowns those of the result.
        rivals: other optima.
        folds: which fold did without what.
        by_fold: poses of each fold's solve.
    """
    is_free = problem.gauge is not None
    moved = _moved_by_folds(problem, by_fold, is_free)
    covariance = np.einsum("fki,fkj->kij", moved, moved) * (folds.count - 1) / folds.count
    covariance += spread_of_rivals(problem.unknowns[: problem.n_cams], rivals)
    by_sigma = _by_sigma(problem, is_free)
    if by_sigma is None:
        return covariance
    return covariance + _misfit(problem, folds)[:, None, None] * by_sigma


def _moved_by_folds(
    problem: AdjustmentProblem, by_fold: Sequence[Float[np.ndarray, "k 4 4"]], is_free: bool
) -> Float[np.ndarray, "f k 3"]:
    """How far each camera lies from where it is in the result."""
    positions = problem.unknowns[: problem.n_cams, :3, 3]
    ends = [poses[:, :3, 3] for poses in by_fold]
    return np.stack([brought_close(e, positions) if is_free else e for e in ends]) - positions


def _by_sigma(problem: AdjustmentProblem, is_free: bool) -> Float[np.ndarray, "k 3 3"] | None:
    """What the sigmas leave open; None where there is none to go by, or frames that nothing holds."""
    if problem.options.averaging == "mean" or problem.odometry is None:
        return None
    n = problem.n_cams
    some = np.unique(np.linspace(0, n - 1, min(n, MAX_COVARIANCES)).astype(int))
    covariance_of = aligned_position_covariances if is_free else position_covariances
    found = covariance_of(problem.terms, problem.unknowns, some).reshape(len(some), 9)
    every = np.arange(n)
    return np.column_stack([np.interp(every, some, entry) for entry in found.T]).reshape(n, 3, 3)


def _misfit(problem: AdjustmentProblem, folds: Folds) -> Float[np.ndarray, " k"]:
    """Factor on the variance of each frame: steps that depart by more than their sigma say that the tracker
    was worse than its sigmas in that stretch."""
    odometry = problem.measurements.odometry
    solved = problem.unknowns[: problem.n_cams]
    rotation, translation = step_departures(odometry.cam_from_next, solved)
    squares = (rotation / odometry.sigma_rotation) ** 2
    squares += (translation / odometry.sigma_translation) ** 2
    # Six numbers a step; that one step is torn says little of how the others were measured.
    chi_square = np.minimum(squares / 6, MAX_STEP_SIGMAS**2)
    stretch_of_step = folds.stretch[:-1]
    mean = np.bincount(stretch_of_step, chi_square, folds.n_stretches) / np.maximum(
        np.bincount(stretch_of_step, minlength=folds.n_stretches), 1
    )
    return np.maximum(mean, 1.0)[folds.stretch]


def spread_of_rivals(
    solved: Float[np.ndarray, "k 4 4"], rivals: Sequence[Rival]
) -> Float[np.ndarray, "k 3 3"]:
    """Covariance of camera positions (m^2) about the result, if either it or a rival is right.

    Each is weighed by its cost. Folds begin at the result and do not leave its optimum, so they know nothing
    of another that costs as little: walls that were moved alike hold a scan as firmly as right ones.
    """
    weights = np.exp([-rival.excess_cost / RIVAL_COST for rival in rivals])
    covariance = np.zeros((len(solved), 3, 3))
    for weight, rival in zip(weights, rivals, strict=True):
        apart = rival.plan_from_cams[:, :3, 3] - solved[:, :3, 3]
        covariance += weight / (1.0 + weights.sum()) * np.einsum("ki,kj->kij", apart, apart)
    return covariance


def brought_close(
    positions: Float[np.ndarray, "k 3"], target: Float[np.ndarray, "k 3"]
) -> Float[np.ndarray, "k 3"]:
    """Positions after the rigid motion that brings them closest to others."""
    return se3.transform(se3.fit_rigid(positions, target), positions)
