"""Which frames of two sequences with clocks of their own belong together."""

import numpy as np
from scipy.spatial.transform import Rotation

from planfit.geometry import se3


def pair_times(
    times: np.ndarray, other_times: np.ndarray, max_gap_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Indices (k,) into both sequences of what belongs together, each at most once, in order of `times`.

    Nearest pairs are taken first, as the tool of the TUM benchmark does. Times in s, in any order.
    """
    order = np.argsort(other_times, kind="stable")
    other = other_times[order]
    # Both neighbours and one more on each side: the nearest may be taken by a nearer partner.
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
    times: np.ndarray, poses: np.ndarray, at: np.ndarray, max_gap_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Poses (k, 4, 4) at the times `at` (k,), and which of them are known (k,) bool.

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
    share = np.where(is_between, gap_before / total, np.where(gap_before < gap_after, 0.0, 1.0))
    result = np.repeat(np.eye(4)[None], len(at), axis=0)
    turn = Rotation.from_matrix(
        np.swapaxes(poses[before, :3, :3], -1, -2) @ poses[after, :3, :3]
    ).as_rotvec()
    result[:, :3, :3] = poses[before, :3, :3] @ se3.exp_so3(turn * share[:, None])
    result[:, :3, 3] = (1 - share[:, None]) * poses[before, :3, 3] + share[:, None] * poses[
        after, :3, 3
    ]
    result[~known] = np.eye(4)
    return result, known
