"""A term's share of the normal equations, and how residuals that name poses become one.

Each of k rows of residuals names `a` poses; its Jacobian has six columns for each of them, the tangent
(rotation, translation) of `planfit.geometry.se3`. Whatever a term's residuals are, `blocks_of_rows` takes
J^T J and J^T r of its rows to the poses that the rows name. Matches go by `blocks_of_relative_poses`: each
pair is summed in the six numbers of its relative pose first, however many matches it has.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse

from planfit.geometry import se3
from planfit.geometry.se3 import Poses


@dataclass(frozen=True)
class NormalBlocks:
    """A term's share of J^T J and J^T r; tangent vectors as in `planfit.geometry.se3`."""

    rows: Int[np.ndarray, " b"]
    """Pose of each block's rows."""
    columns: Int[np.ndarray, " b"]
    """Pose of each block's columns; rows <= columns."""
    blocks: Float[np.ndarray, "b 6 6"]
    """Blocks off the diagonal also stand for their transpose."""
    gradient: Float[np.ndarray, "n 6"]


def sum_by_pose(
    idx: Int[np.ndarray, " k"], values: Float[np.ndarray, "k ..."], n_poses: int
) -> Float[np.ndarray, "n ..."]:
    """Sum values into the poses they belong to."""
    flat = values.reshape(len(values), int(np.prod(values.shape[1:])))
    # A sparse product adds up rows several times as fast as np.add.at. One entry a column: there is nothing
    # to sort, which takes longer than the product otherwise.
    pick = sparse.csc_array(
        (np.ones(len(idx)), idx, np.arange(len(idx) + 1)), shape=(n_poses, len(idx))
    )
    return (pick @ flat).reshape(n_poses, *values.shape[1:])


def blocks_of_rows(
    pose_idx: Int[np.ndarray, "k a"],
    hessians: Float[np.ndarray, "k c c"],
    gradients: Float[np.ndarray, "k c"],
    n_poses: int,
) -> NormalBlocks:
    """Blocks by pose of rows that each name `a` poses.

    Args:
        pose_idx: poses of each row, in any order; a row may name a pose twice.
        hessians: J^T J of each row by the tangents of its poses, c = 6 a; only the blocks on and above
            the diagonal are read.
        gradients: J^T r likewise.
        n_poses: how many poses there are.
    """
    a = pose_idx.shape[1]
    by_slot = hessians.reshape(len(pose_idx), a, 6, a, 6)
    every = np.arange(n_poses)
    gradient, diagonal = np.zeros((n_poses, 6)), np.zeros((n_poses, 6, 6))
    rows, columns, off_diagonal = [every], [every], []
    for first in range(a):
        i = pose_idx[:, first]
        own = by_slot[:, first, :, first].reshape(len(i), 36)
        both = np.concatenate([gradients[:, 6 * first : 6 * first + 6], own], axis=1)
        summed = sum_by_pose(i, both, n_poses)
        gradient += summed[:, :6]
        diagonal += summed[:, 6:].reshape(n_poses, 6, 6)
        for second in range(first + 1, a):
            j = pose_idx[:, second]
            rows.append(np.minimum(i, j))
            columns.append(np.maximum(i, j))
            off_diagonal.append(_upper(by_slot[:, first, :, second], i, j))
    blocks = np.concatenate([diagonal, *off_diagonal])
    return NormalBlocks(np.concatenate(rows), np.concatenate(columns), blocks, gradient)


def _upper(blocks: np.ndarray, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Blocks (k, 6, 6) of poses (i, j) as blocks of (min, max)."""
    transposed = np.swapaxes(blocks, 1, 2)
    result = np.where((i > j)[:, None, None], transposed, blocks)
    is_same = i == j
    if is_same.any():
        # On the diagonal nothing stands for its transpose, so both halves are added.
        result[is_same] = blocks[is_same] + transposed[is_same]
    return result


def relative_poses(
    target_from_cams: Poses, pairs: Int[np.ndarray, "k 2"]
) -> Float[np.ndarray, "k 4 4"]:
    """first_from_second of each pair, contiguous for compiled code."""
    first, second = target_from_cams[pairs[:, 0]], target_from_cams[pairs[:, 1]]
    return np.ascontiguousarray(se3.inverse(first) @ second)


def blocks_of_relative_poses(
    pairs: Int[np.ndarray, "k 2"],
    hessians: Float[np.ndarray, "k 6 6"],
    gradients: Float[np.ndarray, "k 6"],
    target_from_cams: Poses,
) -> NormalBlocks:
    """Blocks by both poses from blocks by the tangent of first_from_second.

    Args:
        pairs: first and second frame, in any order.
        hessians: J^T J by the tangent (rotation, translation) of first_from_second, first's axes.
        gradients: J^T r likewise.
        target_from_cams: the poses.
    """
    jacobians = relative_pose_jacobians(target_from_cams[pairs])
    first, second = jacobians[:, :, :6], jacobians[:, :, 6:]
    first_t, second_t = np.swapaxes(first, 1, 2), np.swapaxes(second, 1, 2)
    of_rows = np.zeros((len(pairs), 12, 12))
    of_rows[:, :6, :6] = first_t @ hessians @ first
    of_rows[:, :6, 6:] = first_t @ hessians @ second
    of_rows[:, 6:, 6:] = second_t @ hessians @ second
    by_poses = (np.swapaxes(jacobians, 1, 2) @ gradients[:, :, None])[:, :, 0]
    return blocks_of_rows(pairs, of_rows, by_poses, len(target_from_cams))


def relative_pose_jacobians(
    target_from_pairs: Float[np.ndarray, "k 2 4 4"],
) -> Float[np.ndarray, "k 6 12"]:
    """Jacobians of first_from_second's tangent by the first and by the second pose's.

    With R = R_i^T R_j and t = R_i^T s, s = t_j - t_i: rotating the first pose by w rotates R by -R_i^T w
    and moves t by -R_i^T (w x s) = R_i^T [s]x w.
    """
    first_t = np.swapaxes(target_from_pairs[:, 0, :3, :3], 1, 2)
    between = target_from_pairs[:, 1, :3, 3] - target_from_pairs[:, 0, :3, 3]
    jacobians = np.zeros((len(target_from_pairs), 6, 12))
    jacobians[:, :3, :3] = jacobians[:, 3:, 3:6] = -first_t
    jacobians[:, :3, 6:9] = jacobians[:, 3:, 9:] = first_t
    jacobians[:, 3:, :3] = first_t @ se3.skew(between)
    return jacobians
