"""Control points left out one by one: where all other evidence puts each.

A blunder draws the poses to itself, and points beside it along: residuals of the fit spread it over all. So
each point is left out in turn. No solve is needed: near the result, all evidence but the control points is as
the normal equations have it, and those, with their robust weights, are solved anew in the space of the marks,
a few hundred numbers (Woodbury's identity):

    v = r + K (W - W') v,    K = J H^-1 J^T

r are the residuals of marks in the result, J their Jacobian, W their weights there; H holds all terms; v are
the residuals with other weights W', 0 for what is left out, else by the loss at v. Wall associations stay as
they are.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from planfit.adjust.problem import AdjustmentProblem
from planfit.adjust.rigid_motion import FREE_TRANSLATION_M
from planfit.geometry.se3 import Poses
from planfit.lsq.covariance import factorised
from planfit.lsq.normal_equations import NormalEquations
from planfit.lsq.robust import loss_value

MAX_MARKS = 150
"""Of points that more marks show, evenly taken ones stand for all: their residuals are nearly alike."""
NEGLIGIBLE = 1e-3
"""Of a weight, that a change is not followed below: of many points few are concerned by one."""
MAX_ITERATIONS, TOLERANCE_M = 20, 1e-5
"""Weights are chosen anew until no residual moves by more."""
CONTRADICTED_SIGMAS = 5.0
"""A point that the rest puts further off than so many standard deviations contradicts it."""


@dataclass(frozen=True)
class PointLeftOut:
    """A control point that takes no part."""

    point_idx: int
    """Number in the survey."""
    shift_m: Float[np.ndarray, "3"]
    """How much further from where it was surveyed it is found than in the result, target axes."""
    sigma_m: float
    """Standard deviation of where the rest puts it, each coordinate; infinite where it says nothing."""
    sigmas: float
    """How far that is from where it was surveyed, in standard deviations of both."""
    is_contradicted: bool
    """Whether it is one of those that the rest contradicts, once the worst are left out together."""


@dataclass(frozen=True)
class _Marks:
    """Control points near a result; m marks, rows of three numbers."""

    residuals: Float[np.ndarray, "m 3"]
    inverse_variance: Float[np.ndarray, "m 3"]
    """Of each coordinate; 0 of one that is not known."""
    stands_for: Float[np.ndarray, " m"]
    """Factor on that in the cost: the weight of the term, and how many marks each stands for."""
    weights: Float[np.ndarray, " m"]
    """By the loss, in the result."""
    covariance: Float[np.ndarray, "r r"]
    """K; r = 3 m."""
    point_idx: Int[np.ndarray, " m"]
    sigma_m: Float[np.ndarray, " m"]
    """Of a mark alone."""
    targets: Float[np.ndarray, "m 3"]
    problem: AdjustmentProblem

    def without(
        self, points: Iterable[int], mean: Float[np.ndarray, "3 r"]
    ) -> tuple[Float[np.ndarray, "m 3"], Float[np.ndarray, "3 3"]]:
        """Residuals of all marks where some points take no part, and the covariance of what the rest says of
        a mean of marks."""
        control = self.problem.control
        assert control is not None
        is_in = ~np.isin(self.point_idx, list(points))
        right = np.column_stack([self.residuals.ravel(), self.covariance @ mean.T])
        solved = self._solved(self.weights * is_in, right)
        for _ in range(MAX_ITERATIONS):
            v = solved[:, 0].reshape(-1, 3)
            squared = np.sum(self.inverse_variance * v**2, axis=1)
            solved = self._solved(is_in * loss_value(squared, control.loss)[1], right)
            if np.abs(solved[:, 0] - v.ravel()).max() < TOLERANCE_M:
                break
        return solved[:, 0].reshape(-1, 3), mean @ solved[:, 1:]

    def _solved(
        self, weights: Float[np.ndarray, " m"], right: Float[np.ndarray, "r c"]
    ) -> Float[np.ndarray, "r c"]:
        """x of x = right + K (W - W') x, for other weights W': a system of the marks whose weights change."""
        change = ((self.weights - weights) * self.stands_for)[:, None] * self.inverse_variance
        is_changed = np.abs(self.weights - weights) > NEGLIGIBLE * self.weights
        own = np.flatnonzero(np.repeat(is_changed, 3))
        by = self.covariance[:, own] * change.ravel()[own]
        return right + by @ np.linalg.solve(np.eye(len(own)) - by[own], right[own])


def leave_out_control(
    problem: AdjustmentProblem, target_from_cams: Poses
) -> tuple[PointLeftOut, ...]:
    """Each control point that takes part, in the order of the survey; none where there are none."""
    marks = _marks_of(problem, target_from_cams)
    if marks is None:
        return ()
    points = np.unique(marks.point_idx)
    alone = {int(k): _judged(marks, int(k), (int(k),)) for k in points}
    out = _contradicted(marks, {k: told[2] for k, told in alone.items()})
    return tuple(PointLeftOut(k, *alone[k], is_contradicted=k in out) for k in alone)


def _marks_of(problem: AdjustmentProblem, target_from_cams: Poses) -> _Marks | None:
    control, given = problem.control, problem.measurements.control
    if control is None or given.targets is None:
        return None
    poses = problem.unknowns.copy()
    poses[: len(target_from_cams)] = target_from_cams
    kept, factor = _thinned(given.point_idx)
    residuals, jacobians = control.residuals(poses)[kept], control.jacobians(poses)[kept]
    sigma = np.broadcast_to(np.asarray(control.sigma), control.residuals(poses).shape)[kept]
    inverse_variance = np.where(np.isfinite(given.targets[kept]), sigma**-2.0, 0.0)
    weights = loss_value(np.sum(inverse_variance * residuals**2, axis=1), control.loss)[1]
    blocks = [term.reweight(poses)[0].normal_blocks(poses) for term in problem.terms]
    factors = factorised(NormalEquations(blocks, len(poses)))
    frames, own = np.unique(given.pose_idx[kept], return_inverse=True)
    inverse = factors.inverse((6 * frames[:, None] + np.arange(6)).ravel())
    rows = np.zeros((len(kept), 3, len(frames), 6))
    rows[np.arange(len(kept)), :, own] = jacobians
    by = rows.reshape(3 * len(kept), -1)
    return _Marks(
        residuals,
        inverse_variance,
        control.weight * factor,
        weights,
        by @ inverse @ by.T,
        given.point_idx[kept],
        given.sigma_m[kept],
        given.targets[kept],
        problem,
    )


def _thinned(
    point_idx: Int[np.ndarray, " a"],
) -> tuple[Int[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Marks that stand for all, and how many each stands for."""
    points, counts = np.unique(point_idx, return_counts=True)
    most = max(MAX_MARKS // len(points), 1) if len(point_idx) > MAX_MARKS else int(counts.max())
    kept, factor = [], []
    for point, count in zip(points, counts, strict=True):
        own = np.flatnonzero(point_idx == point)
        some = own[np.linspace(0, count - 1, min(count, most)).astype(int)]
        kept.append(some)
        factor.append(np.full(len(some), count / len(some)))
    return np.concatenate(kept), np.concatenate(factor)


def _judged(
    marks: _Marks, point: int, out: tuple[int, ...]
) -> tuple[Float[np.ndarray, "3"], float, float]:
    """Shift, sigma and distance in sigmas of a point where some, itself among them, take no part."""
    own = np.flatnonzero(marks.point_idx == point)
    share = marks.sigma_m[own] ** -2.0 / np.sum(marks.sigma_m[own] ** -2.0)
    mean = np.zeros((3, marks.residuals.size))
    for axis in range(3):
        mean[axis, 3 * own + axis] = share
    v, of_rest = marks.without(out, mean)
    off_m, before_m = share @ v[own], share @ marks.residuals[own]
    known = np.isfinite(marks.targets[own[0]])
    # Marks share the point, whose sigma is the least that any of them has: depth adds to it.
    both = of_rest + np.min(marks.sigma_m[own]) ** 2 * np.eye(3)
    sigma_m = float(np.sqrt(np.mean(np.diagonal(of_rest)[known])))
    if not sigma_m < FREE_TRANSLATION_M:  # the rest says nothing of it
        return np.full(3, np.nan), np.inf, 0.0
    which = np.ix_(known, known)
    squared = off_m[known] @ np.linalg.solve(both[which], off_m[known])
    shift_m = np.where(known, off_m - before_m, np.nan)
    return shift_m, sigma_m, float(np.sqrt(max(squared, 0.0)))


def _contradicted(marks: _Marks, sigmas: Mapping[int, float]) -> tuple[int, ...]:
    """Points that the rest contradicts, the worst first (data snooping, Baarda 1968): a blunder makes good
    points beside it look bad, until it is left out.

    Args:
        sigmas: how far each is off where it alone is left out.
    """
    out: list[int] = []
    left = dict(sigmas)
    while len(out) < len(sigmas) // 2:
        worst = max(left, key=lambda k: left[k])
        if left.pop(worst) <= CONTRADICTED_SIGMAS:
            break
        out.append(worst)
        left = {k: _judged(marks, k, (*out, k))[2] for k in left}
    return tuple(out)
