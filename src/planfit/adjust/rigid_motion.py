"""How well terms hold some frames that move as one rigid body, seen from above."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from planfit.geometry import se3
from planfit.lsq.blocks import NormalBlocks
from planfit.lsq.term import Term

FREE_TRANSLATION_M, FREE_YAW_DEG = 1.0, 10.0
"""What is less sure than this (standard deviation) is not held."""


def rigid_information(
    parts: Sequence[NormalBlocks],
    target_from_cams: Float[np.ndarray, "n 4 4"],
    frames: np.ndarray,
) -> Float[np.ndarray, "6 6"]:
    """Information (J^T J) of terms on the motion of some frames as one rigid body.

    The motion is (rotation, translation) [rad, m] about the frames' mean; other frames stay where they are.
    """
    lever = target_from_cams[frames, :3, 3] - target_from_cams[frames, :3, 3].mean(axis=0)
    # A body that turns by w and moves by v about its mean: each camera turns by w and moves by v + w x lever.
    rigid = np.zeros((len(target_from_cams), 6, 6))
    rigid[frames] = np.eye(6)
    rigid[frames, 3:, :3] = -se3.skew(lever)
    total = np.zeros((6, 6))
    for part in parts:
        each = np.swapaxes(rigid[part.rows], 1, 2) @ part.blocks @ rigid[part.columns]
        off_diagonal = each[part.rows != part.columns].sum(axis=0)
        total += each.sum(axis=0) + off_diagonal.T  # a block off the diagonal stands for two
    return total


def horizontal_covariance(
    information: Float[np.ndarray, "6 6"],
) -> Float[np.ndarray, "3 3"]:
    """Of x, y (m) and yaw (rad) of a rigid motion, from its information; large where nothing holds it."""
    seen_from_above = information[np.ix_([3, 4, 2], [3, 4, 2])]
    return np.linalg.inv(seen_from_above + 1e-9 * np.eye(3))


def hold_whole(terms: Sequence[Term], target_from_cams: Float[np.ndarray, "n 4 4"]) -> bool:
    """Whether terms hold where the scan is as a whole, seen from above, so that no prior need do it."""
    if not terms:
        return False
    parts = [term.reweight(target_from_cams)[0].normal_blocks(target_from_cams) for term in terms]
    every = np.arange(len(target_from_cams))
    covariance = horizontal_covariance(rigid_information(parts, target_from_cams, every))
    sigma_m = np.sqrt(np.linalg.eigvalsh(covariance[:2, :2])[-1])
    return bool(
        sigma_m < FREE_TRANSLATION_M and np.sqrt(covariance[2, 2]) < np.deg2rad(FREE_YAW_DEG)
    )
