"""What holds each frame, and the scan as a whole: so that nothing floats without being named."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from planfit.adjust.problem import AdjustmentProblem
from planfit.adjust.rigid_motion import (
    FREE_TRANSLATION_M,
    FREE_YAW_DEG,
    horizontal_covariance,
    rigid_information,
)
from planfit.findings import Finding, ResultKind
from planfit.findings.finding import FEW_NAMED
from planfit.geometry.se3 import Poses
from planfit.lsq.blocks import NormalBlocks


def observability_findings(
    problem: AdjustmentProblem, plan_from_cams: Poses
) -> tuple[Finding, ...]:
    """Frames and pieces of the scan that matches, floor and plan do not hold."""
    n, measurements = len(plan_from_cams), problem.measurements
    # What holds poses to something fixed, and what the user's terms hold, linearised at these poses.
    parts = _fixed_parts(problem, plan_from_cams)
    links = _links(problem, parts)
    is_held = _held(problem, parts, links)
    has_odometry = problem.odometry is not None
    found = []
    if not is_held.all():
        kind = ResultKind.HELD_BY_ODOMETRY if has_odometry else ResultKind.NOT_HELD
        has_plan = problem.correspondences is not None
        runs = _frame_runs(np.flatnonzero(~is_held), measurements.frame_idx)
        found.append(Finding(kind, {"has_plan": has_plan}, runs))
    if problem.gauge is None:
        submaps = [np.arange(n)] if has_odometry or n == 1 else _submaps(links, n)
        for frames in submaps:
            covariance = horizontal_covariance(rigid_information(parts, plan_from_cams, frames))
            is_whole = len(frames) == n
            runs = () if is_whole else _frame_runs(frames, measurements.frame_idx)
            found += _free_motions(covariance, runs)
    if len(found) > FEW_NAMED:  # without the odometry term a scan may fall into dozens of pieces
        more = Finding(ResultKind.MORE_HELD_WEAKLY, {"piece_count": len(found) - FEW_NAMED})
        found = [*found[:FEW_NAMED], more]
    return tuple(found)


def frames_held(problem: AdjustmentProblem, plan_from_cams: Poses) -> Bool[np.ndarray, " n"]:
    """Frames that anything measured holds: a match, the floor, the plan, a point or a term of the user's."""
    parts = _fixed_parts(problem, plan_from_cams)
    return _held(problem, parts, _links(problem, parts))


def _fixed_parts(problem: AdjustmentProblem, plan_from_cams: Poses) -> list[NormalBlocks]:
    """What holds poses to something that does not move, linearised at these poses."""
    return [
        term.reweight(plan_from_cams)[0].normal_blocks(plan_from_cams)
        for term in problem.fixed_terms
    ]


def _held(
    problem: AdjustmentProblem, parts: Sequence[NormalBlocks], links: Int[np.ndarray, "p 2"]
) -> Bool[np.ndarray, " n"]:
    """Frames that floor, links or something fixed hold."""
    is_held = _sees_floor(problem)
    is_held[links] = True
    for part in parts:
        is_held[part.rows[np.abs(part.blocks).max(axis=(1, 2), initial=0.0) > 0]] = True
    return is_held


def _links(problem: AdjustmentProblem, parts: Sequence[NormalBlocks]) -> Int[np.ndarray, "p 2"]:
    """Pairs of frames that matches or the user's terms hold to each other."""
    matched = problem.measurements.matches.pairs
    pairs = [matched if problem.geometric is not None else np.zeros((0, 2), dtype=int)]
    if problem.surfaces is not None:
        pairs.append(problem.surfaces.pairs)
    for part in parts:
        off_diagonal = part.rows != part.columns
        pairs.append(np.column_stack([part.rows, part.columns])[off_diagonal])
    return np.concatenate(pairs)


def _sees_floor(problem: AdjustmentProblem) -> Bool[np.ndarray, " n"]:
    """Frames that the floor holds."""
    if problem.floor is None:
        return np.zeros(problem.n_cams, dtype=bool)
    has_points = np.diff(problem.floor.points.start) > 0
    return has_points & np.isfinite(problem.floor.heights_m)


def _submaps(pairs: Int[np.ndarray, "p 2"], n: int) -> list[Int[np.ndarray, " k"]]:
    """Frames of each piece of the scan that pairs hold together; of single frames none."""
    links = sparse.coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    _, label = connected_components(links, directed=False)
    # Sorted by label, a component is a run; a new run begins where the label changes.
    order = np.argsort(label, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
    return [np.sort(group) for group in groups if len(group) > 1]


def _free_motions(
    covariance: Float[np.ndarray, "3 3"], runs: tuple[tuple[int, int], ...]
) -> list[Finding]:
    """What the plan leaves free of a piece of the scan that moves as one, seen from above (x, y, yaw).

    `runs` are its frames; none where it is the whole scan.
    """
    variances, axes = np.linalg.eigh(covariance[:2, :2])
    free = np.sqrt(variances) > FREE_TRANSLATION_M
    if free.all():
        return [Finding(ResultKind.NO_WALL_HOLDS, frames=runs)]
    found = []
    if free[1]:
        # Of an axis and its opposite, the one whose larger entry is positive.
        x, y = axes[:, 1] * (1 if axes[np.argmax(np.abs(axes[:, 1])), 1] > 0 else -1)
        found.append(
            Finding(ResultKind.NOTHING_HOLDS_ALONG, {"direction": (float(x), float(y))}, runs)
        )
    if np.rad2deg(np.sqrt(covariance[2, 2])) > FREE_YAW_DEG:
        found.append(Finding(ResultKind.NOTHING_HOLDS_YAW, frames=runs))
    return found


def _frame_runs(
    frames: Int[np.ndarray, " k"], frame_idx: Int[np.ndarray, " n"] | None
) -> tuple[tuple[int, int], ...]:
    """Frames as runs of neighbours, first and last as numbered in the scan."""
    real = frames if frame_idx is None else frame_idx[frames]
    # Frames of a reduced scan that follow each other are a run, however far apart they were recorded.
    runs = np.split(np.arange(len(frames)), np.flatnonzero(np.diff(frames) > 1) + 1)
    return tuple((int(real[run[0]]), int(real[run[-1]])) for run in runs)
