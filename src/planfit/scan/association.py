"""Frames and poses of two sequences with clocks of their own, associated by time."""

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.geometry import se3


def pair_times(
    times: Float[np.ndarray, " n"], other_times: Float[np.ndarray, " m"], max_gap_s: float
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Indices into both sequences of what belongs together, each at most once, in order of `times`.

    Nearest pairs are taken first, as the tool of the TUM benchmark does. Times in s, in any order.
    """
    order = np.argsort(other_times, kind="stable")
    other = other_times[order]
    # searchsorted gives the first that is not earlier: at -1 and 0 are its neighbours in time, and at -2
    # and 1 one more on each side, since the nearest may be taken by a nearer partner.
    at = np.searchsorted(other, times)[:, None] + np.arange(-2, 2)
    valid = (at >= 0) & (at < len(other))
    gap = np.abs(other[np.clip(at, 0, len(other) - 1)] - times[:, None])
    rows, columns = np.nonzero(valid & (gap <= max_gap_s))
    nearest_first = np.argsort(gap[rows, columns], kind="stable")
    taken, taken_other = set(), set()
    pairs = []
    for k in nearest_first:
        i, j = int(rows[k]), int(order[at[rows[k], columns[k]]])
        if i not in taken and j not in taken_other:
            taken.add(i)
            taken_other.add(j)
            pairs.append((i, j))
    found = np.array(sorted(pairs), dtype=int).reshape(-1, 2)
    return found[:, 0], found[:, 1]


def poses_at(
    times: Float[np.ndarray, " n"],
    poses: Float[np.ndarray, "n 4 4"],
    at: Float[np.ndarray, " k"],
    max_gap_s: float,
) -> tuple[Float[np.ndarray, "k 4 4"], Bool[np.ndarray, " k"]]:
    """Poses at the times `at`, and which of them are known.

    A pose is known where one was recorded within `max_gap_s`. It is interpolated between its neighbours
    unless they are more than five times that apart: a tracker that runs at 100 Hz is off by up to 5 ms
    otherwise, millimetres at a walk. Where none is known the pose is the identity.
    """
    order = np.argsort(times, kind="stable")
    times, poses = times[order], poses[order]
    after = np.clip(np.searchsorted(times, at), 0, len(times) - 1)
    before = np.maximum(after - 1, 0)
    gap_before, gap_after = np.abs(at - times[before]), np.abs(times[after] - at)
    gap = np.minimum(gap_before, gap_after)
    known = gap <= max_gap_s
    is_between = (times[before] <= at) & (at <= times[after]) & (times[before] < times[after])
    is_between &= times[after] - times[before] <= 5 * max_gap_s
    total = np.where(is_between, times[after] - times[before], 1.0)
    # How far on the way from the pose before (0) to that after (1); the nearer of both where that is too far.
    share = np.where(is_between, gap_before / total, np.where(gap_before < gap_after, 0.0, 1.0))
    result = se3.interpolate(poses[before], poses[after], share)
    result[~known] = np.eye(4)
    return result, known
