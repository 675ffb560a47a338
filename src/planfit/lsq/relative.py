"""Blocks of residuals that depend on a pair's relative pose alone, as those of matches do.

Each pair is summed in the six numbers of its relative pose, however many matches it has; the step from
there to the two poses is one small product a pair.
"""

import numpy as np

from planfit.geometry import se3
from planfit.lsq.linear.normal_equations import NormalBlocks, sum_by_pose


def relative_poses(target_from_cams: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """first_from_second (k, 4, 4) of pairs (k, 2), contiguous for compiled code."""
    first, second = target_from_cams[pairs[:, 0]], target_from_cams[pairs[:, 1]]
    return np.ascontiguousarray(se3.inverse(first) @ second)


def blocks_of_pairs(
    pairs: np.ndarray, hessians: np.ndarray, gradients: np.ndarray, target_from_cams: np.ndarray
) -> NormalBlocks:
    """Blocks by both poses from blocks by the tangent of first_from_second.

    Args:
        pairs: (k, 2) first and second frame, in any order.
        hessians: (k, 6, 6) J^T J by the tangent (turn, shift) of first_from_second, first's axes.
        gradients: (k, 6) J^T r likewise.
        target_from_cams: (n, 4, 4).
    """
    i, j = pairs[:, 0], pairs[:, 1]
    first, second = _relative_jacobians(target_from_cams, pairs)
    first_t, second_t = np.swapaxes(first, 1, 2), np.swapaxes(second, 1, 2)
    n = len(target_from_cams)
    gradient = sum_by_pose(i, (first_t @ gradients[:, :, None])[:, :, 0], n)
    gradient += sum_by_pose(j, (second_t @ gradients[:, :, None])[:, :, 0], n)
    diagonal = sum_by_pose(i, first_t @ hessians @ first, n)
    diagonal += sum_by_pose(j, second_t @ hessians @ second, n)
    off = first_t @ hessians @ second
    off = np.where((i > j)[:, None, None], np.swapaxes(off, 1, 2), off)
    every = np.arange(n)
    return NormalBlocks(
        np.concatenate([every, np.minimum(i, j)]),
        np.concatenate([every, np.maximum(i, j)]),
        np.concatenate([diagonal, off]),
        gradient,
    )


def _relative_jacobians(
    target_from_cams: np.ndarray, pairs: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Jacobians (k, 6, 6) of first_from_second's tangent by the first and by the second pose's.

    With R = R_i^T R_j and t = R_i^T s, s = t_j - t_i: turning the first pose by w turns R by -R_i^T w
    and moves t by -R_i^T (w x s).
    """
    first_t = np.swapaxes(target_from_cams[pairs[:, 0], :3, :3], 1, 2)
    between = target_from_cams[pairs[:, 1], :3, 3] - target_from_cams[pairs[:, 0], :3, 3]
    first, second = (np.zeros((len(pairs), 6, 6)) for _ in range(2))
    second[:, :3, :3] = second[:, 3:, 3:] = first_t
    first[:, :3, :3] = first[:, 3:, 3:] = -first_t
    first[:, 3:, :3] = first_t @ se3.skew(between)
    return first, second
