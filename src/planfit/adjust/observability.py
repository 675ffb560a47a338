"""What holds each frame, and the scan as a whole: so that nothing floats without being named."""

from collections.abc import Iterable

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from planfit.adjust.correspondences import PlanCorrespondences, level_and_column_terms, wall_terms
from planfit.adjust.measurements import Measurements
from planfit.adjust.options import AdjustOptions
from planfit.geometry import se3
from planfit.lsq.blocks import sum_by_pose
from planfit.lsq.term import Term

FREE_SHIFT_M, FREE_TURN_DEG = 1.0, 10.0
"""A piece of the scan whose place on the plan is less sure than this is not held by it."""

MAX_SENTENCES = 4
"""Without the trajectory prior a scan may fall into dozens of pieces."""


def describe_observability(
    measurements: Measurements,
    correspondences: PlanCorrespondences,
    plan_from_cams: np.ndarray,
    options: AdjustOptions,
) -> tuple[str, ...]:
    """Sentences on frames and pieces of the scan that matches, floor and plan do not hold.

    Args:
        measurements: the scan's.
        correspondences: what it was held to in the plan.
        plan_from_cams: (n, 4, 4) poses of the solve's end.
        options: the terms that were on.
    """
    n = len(plan_from_cams)
    pairs = (
        measurements.matches.pairs
        if measurements.geometric_terms(options)
        else np.zeros((0, 2), int)
    )
    is_held = np.zeros(n, dtype=bool)
    is_held[pairs] = True
    is_held |= _sees_floor(measurements, options)
    on_plan = level_and_column_terms(measurements, correspondences, options) + wall_terms(
        measurements, correspondences, options
    )
    blocks = _own_blocks(on_plan, plan_from_cams)
    is_held |= np.abs(blocks).max(axis=(1, 2), initial=0.0) > 0
    has_prior = options.odometry.weight > 0
    sentences = []
    if not is_held.all():
        by = (
            "held by the trajectory prior alone"
            if has_prior
            else "not held by anything and stay where they were"
        )
        names = _frame_names(np.flatnonzero(~is_held), measurements.frame_idx)
        sentences.append(
            f"{names} {by}: they match no other frame and see neither floor nor a wall of the plan"
        )
    if wall_terms(measurements, correspondences, options) or correspondences.columns.n_associated:
        for patch in _pieces(pairs, n, has_prior):
            sentences += _free_motions(patch, blocks, plan_from_cams, measurements, len(patch) == n)
    if len(sentences) > MAX_SENTENCES:
        more = len(sentences) - MAX_SENTENCES
        sentences = [
            *sentences[:MAX_SENTENCES],
            f"{more} more pieces of the scan are held as weakly",
        ]
    return tuple(sentences)


def _sees_floor(measurements: Measurements, options: AdjustOptions) -> np.ndarray:
    """(n,) bool."""
    has_points = np.diff(measurements.structure.floor.start) > 0
    is_on_plane = np.isfinite(measurements.structure.floor_heights_m)
    return has_points & is_on_plane & (options.floor.weight > 0)


def _own_blocks(terms: Iterable[Term], poses: np.ndarray) -> np.ndarray:
    """J^T J (n, 6, 6) of each pose on its own, of terms that hold poses to something fixed."""
    total = np.zeros((len(poses), 6, 6))
    for term in terms:
        found = term.reweight(poses)[0].normal_blocks(poses)
        total += sum_by_pose(found.rows, found.blocks, len(poses))
    return total


def _pieces(pairs: np.ndarray, n: int, has_prior: bool) -> list[np.ndarray]:
    """Frames of each piece of the scan that matches, or the recorded motion, hold together."""
    if has_prior:
        return [np.arange(n)]
    links = sparse.coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    _, label = connected_components(links, directed=False)
    order = np.argsort(label, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
    return [np.sort(group) for group in groups if len(group) > 1]


def _free_motions(
    frames: np.ndarray,
    blocks: np.ndarray,
    poses: np.ndarray,
    measurements: Measurements,
    is_all: bool,
) -> list[str]:
    """What the plan leaves free of a piece of the scan that moves as one: shift and turn, seen from above."""
    lever = poses[frames, :3, 3] - poses[frames, :3, 3].mean(axis=0)
    # A piece turned by w and shifted by v about its middle: each camera turns by w and shifts by
    # v + w x lever.
    rigid = np.tile(np.eye(6), (len(frames), 1, 1))
    rigid[:, 3:, :3] = -se3.skew(lever)
    information = np.einsum("kai,kab,kbj->ij", rigid, blocks[frames], rigid)
    seen_from_above = information[np.ix_([3, 4, 2], [3, 4, 2])]  # x, y, turn about the vertical
    spread = np.linalg.inv(seen_from_above + 1e-9 * np.eye(3))
    along, axes = np.linalg.eigh(spread[:2, :2])
    turn_deg = np.rad2deg(np.sqrt(spread[2, 2]))
    who = (
        "the scan" if is_all else _frame_names(frames, measurements.frame_idx).removesuffix(" are")
    )
    free = np.sqrt(along) > FREE_SHIFT_M
    if free.all():
        return [f"no wall of the plan holds {who}: its place follows the recorded one"]
    sentences = []
    if free[1]:
        x, y = axes[:, 1] * (1 if axes[np.argmax(np.abs(axes[:, 1])), 1] > 0 else -1)
        sentences.append(
            f"nothing holds {who} along the plan's direction ({x:.2f}, {y:.2f}): all walls that it "
            "sees run that way, and it keeps the place there where it was put"
        )
    if turn_deg > FREE_TURN_DEG:
        sentences.append(
            f"nothing holds the turn of {who} about the vertical: it keeps the one it had"
        )
    return sentences


def _frame_names(frames: np.ndarray, frame_idx: np.ndarray | None, max_runs: int = 5) -> str:
    """ "frame 3 is", "frames 3, 40-52 and 60-61 are": frames of the scan, runs of neighbours as one."""
    real = frames if frame_idx is None else frame_idx[frames]
    # Frames of a reduced scan that follow each other are a run, however far apart they were recorded.
    runs = np.split(np.arange(len(frames)), np.flatnonzero(np.diff(frames) > 1) + 1)
    names = [
        f"{real[run[0]]}" if len(run) == 1 else f"{real[run[0]]}-{real[run[-1]]}" for run in runs
    ]
    if len(frames) == 1:
        return f"frame {names[0]} is"
    if len(names) > max_runs:
        names = [*names[:max_runs], f"{len(names) - max_runs} more runs"]
    joined = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
    return f"frames {joined} are"
