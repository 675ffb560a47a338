"""How far each camera of a result may be off: by its residuals, by solves without a part, and by rivals.

Where nothing fixed holds the whole (no plan, no control points), an error is what is left once positions are
brought to the truth by one rigid motion: the frame that the gauge holds is no surer than the others.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.adjust import AdjustmentProblem, Rival
from planfit.adjust.torn_steps import step_departures
from planfit.adjust.uncertainty import ErrorModel, SharedError, model_errors, pose_covariances
from planfit.geometry import se3
from planfit.pipeline.folds import Folds
from planfit.priors import SURE_SIGMAS

MAX_COVARIANCES, MAX_ALIGNED_COVARIANCES = 120, 60
"""Frames whose covariance is taken, evenly along the walk; between them it is interpolated. Where nothing
fixed holds the whole, all of them are needed at once."""
MAX_STEP_SIGMAS = 5.0
"""A step that departs by more counts as this much in the misfit of its stretch: the jackknife sees it too."""
LEAST_SHARE, LEAST_VARIANCE = 1e-9, 1e-14
"""No variance is below this share of the pose's largest, nor below this (rad^2, m^2)."""


@dataclass(frozen=True)
class StatedCovariances:
    """Of some cameras, by the sigmas that terms were given, at the weights where the result ended."""

    frames: Int[np.ndarray, " s"]
    whole: Float[np.ndarray, "s 6 6"]
    """By all evidence."""
    by_fold: Float[np.ndarray, "f s 6 6"]
    """By what each fold has."""

    def are_exceeded(
        self, moved: Float[np.ndarray, "f k 6"], own: Float[np.ndarray, "k 6 6"]
    ) -> Bool[np.ndarray, "f k"]:
        """Whether folds move frames by more than `SURE_SIGMAS` of what they should.

        Args:
            moved: tangents.
            own: covariances of all frames by residuals, without what all frames share: sigmas that are stated
                too small or too large are so for both solves.
        """
        every = np.arange(moved.shape[1])
        whole, by_residuals = _mean_square(self.whole), _mean_square(own[self.frames])
        factor = by_residuals / np.maximum(whole, LEAST_VARIANCE)
        squares = np.sum(moved[:, :, 3:] ** 2, axis=2)
        expected = [
            np.interp(every, self.frames, factor * np.maximum(_mean_square(one) - whole, 0.0))
            for one in self.by_fold
        ]
        return squares > SURE_SIGMAS.value**2 * np.array(expected)


def predicted_covariance(
    problem: AdjustmentProblem,
    rivals: Sequence[Rival],
    folds: Folds,
    by_fold: Sequence[Float[np.ndarray, "k 4 4"]],
    stated: StatedCovariances,
    rng: np.random.Generator,
    shared: SharedError | None = None,
) -> Float[np.ndarray, "k 6 6"]:
    """Covariance of camera poses [rad^2, rad m, m^2], tangents (rotation, translation), target axes.

    Residuals know of noise, of walls that are drawn off and of the sensor; the rivals of other optima; the
    folds of what pulls differently. A solve that does without the walls of an end of the walk moves it by as
    much as the tracker may err there, which says nothing of poses that have them: of the folds those count
    that move a frame by more than they should (difference of the covariances of both, as Hausman 1978 tests
    it), and of these what exceeds the rest.

    Args:
        problem: all evidence, its unknowns those of the result.
        stated: of all evidence, and of each fold.
        shared: what all frames share; None where that is known.
    """
    n = problem.n_cams
    moved = _moved_by_folds(problem, by_fold, problem.gauge is not None)
    spread = np.zeros((n, 6, 6))
    spread[:, 3:, 3:] = spread_of_rivals(problem.unknowns[:n], rivals)
    by_residuals = _by_residuals(problem, folds, rng, shared)
    if by_residuals is not None and problem.gauge is None:
        moved[~stated.are_exceeded(moved, by_residuals[0])] = 0.0
    by_folds = np.einsum("fki,fkj->kij", moved, moved) * (folds.count - 1) / folds.count
    if by_residuals is None:
        return by_folds + spread
    return larger_of(by_residuals[1] + spread, by_folds)


def _mean_square(covariances: Float[np.ndarray, "s 6 6"]) -> Float[np.ndarray, " s"]:
    """Of positions, m^2."""
    return np.trace(covariances[:, 3:, 3:], axis1=1, axis2=2)


def frames_compared(stretch: Int[np.ndarray, " k"]) -> Int[np.ndarray, " s"]:
    """Frames that stated covariances are taken of: the middle one of each stretch, the first and the last."""
    counts = np.bincount(stretch)
    middles = np.cumsum(counts) - (counts + 1) // 2
    return np.unique([0, *middles, len(stretch) - 1])


def larger_of(
    one: Float[np.ndarray, "k 6 6"], other: Float[np.ndarray, "k 6 6"]
) -> Float[np.ndarray, "k 6 6"]:
    """The least covariance, in axes in which `one` is the identity, that is nowhere below either."""
    variances, axes = np.linalg.eigh(0.5 * (one + np.swapaxes(one, 1, 2)))
    least = np.maximum(LEAST_SHARE * variances.max(axis=1, keepdims=True), LEAST_VARIANCE)
    root = axes * np.sqrt(np.maximum(variances, least))[:, None]
    half = np.linalg.solve(root, other)
    whitened = np.linalg.solve(root, np.swapaxes(half, 1, 2))
    variances, axes = np.linalg.eigh(0.5 * (whitened + np.swapaxes(whitened, 1, 2)))
    stretched = root @ axes
    return (stretched * np.maximum(variances, 1.0)[:, None]) @ np.swapaxes(stretched, 1, 2)


def _moved_by_folds(
    problem: AdjustmentProblem, by_fold: Sequence[Float[np.ndarray, "k 4 4"]], is_free: bool
) -> Float[np.ndarray, "f k 6"]:
    """How far each camera lies from where it is in the result, as tangents."""
    solved = problem.unknowns[: problem.n_cams]
    tangents = []
    for poses in by_fold:
        closer = poses
        if is_free:
            closer = se3.fit_rigid(poses[:, :3, 3], solved[:, :3, 3]) @ poses
        turned = se3.log_so3(closer[:, :3, :3] @ np.swapaxes(solved[:, :3, :3], 1, 2))
        tangents.append(np.concatenate([turned, closer[:, :3, 3] - solved[:, :3, 3]], axis=1))
    return np.stack(tangents)


def _by_residuals(
    problem: AdjustmentProblem, folds: Folds, rng: np.random.Generator, shared: SharedError | None
) -> tuple[Float[np.ndarray, "k 6 6"], Float[np.ndarray, "k 6 6"]] | None:
    """What the residuals leave open, without what all frames share and with it; None where there is none to
    go by, or frames that nothing holds."""
    if problem.options.cost == "paper" or problem.odometry is None:
        return None
    n = problem.n_cams
    most = MAX_COVARIANCES if problem.gauge is None else MAX_ALIGNED_COVARIANCES
    some = np.unique(np.linspace(0, n - 1, min(n, most)).astype(int))
    model = error_model(problem, folds.stretch, rng)
    is_free = problem.gauge is not None
    own = pose_covariances(model, problem.unknowns, some, shared if is_free else None)
    whole = own if is_free or shared is None else own + shared.of_poses(some)
    return interpolated(own, np.arange(n), some), interpolated(whole, np.arange(n), some)


def interpolated(
    covariances: Float[np.ndarray, "k 6 6"],
    frames: Int[np.ndarray, " n"],
    known: Int[np.ndarray, " k"],
) -> Float[np.ndarray, "n 6 6"]:
    """Covariances of frames, entry by entry between those that are known; beyond, that of the nearest."""
    entries = covariances.reshape(len(known), 36).T
    return np.column_stack([np.interp(frames, known, e) for e in entries]).reshape(-1, 6, 6)


def error_model(
    problem: AdjustmentProblem, stretch: Int[np.ndarray, " k"], rng: np.random.Generator
) -> ErrorModel:
    """What the residuals tell of all terms, by stretches of the walk."""
    return model_errors(problem, stretch, _misfit(problem, stretch), rng)


def _misfit(problem: AdjustmentProblem, stretch: Int[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """Factor on the variance of each frame: steps that depart by more than their sigma say that the tracker
    was worse than its sigmas in that stretch."""
    odometry = problem.measurements.odometry
    solved = problem.unknowns[: problem.n_cams]
    rotation, translation = step_departures(odometry.cam_from_next, solved)
    squares = (rotation / odometry.sigma_rotation) ** 2
    squares += (translation / odometry.sigma_translation) ** 2
    # Six numbers a step; that one step is torn says little of how the others were measured.
    chi_square = np.minimum(squares / 6, MAX_STEP_SIGMAS**2)
    n_stretches = int(stretch[-1]) + 1
    mean = np.bincount(stretch[:-1], chi_square, n_stretches) / np.maximum(
        np.bincount(stretch[:-1], minlength=n_stretches), 1
    )
    return np.maximum(mean, 1.0)[stretch]


def spread_of_rivals(
    solved: Float[np.ndarray, "k 4 4"], rivals: Sequence[Rival]
) -> Float[np.ndarray, "k 3 3"]:
    """Covariance of camera positions (m^2) about the result, if either it or a rival is right.

    Each is weighed by its cost. Folds begin at the result and do not leave its optimum, so they know nothing
    of another that costs as little: walls that were moved alike hold a scan as firmly as right ones.
    """
    weights = np.array([rival.odds for rival in rivals])
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
