"""How well terms hold some frames that move as one rigid body, seen from above."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.lsq.blocks import NormalBlocks
from planfit.lsq.term import Term

FREE_TRANSLATION_M, FREE_YAW_DEG = 1.0, 10.0
"""What is less sure than this (standard deviation) is not held."""


FREE_SHARE = 1e-10
"""A motion whose information is this share of what holds each pose to something is a direction that nothing
fixed holds: some 30 m where frames hold each other to 0.3 mm."""


def rigid_tangents(
    positions: Float[np.ndarray, "k 3"], centre: Float[np.ndarray, "3"] | None = None
) -> Float[np.ndarray, "k 6 6"]:
    """How poses move with one rigid motion (rotation, translation) [rad, m] about a centre; None takes the
    positions' mean."""
    lever = positions - (positions.mean(axis=0) if centre is None else centre)
    # A body turns by w about its centre and moves by v: each camera turns by w and moves by v + w x lever.
    rigid = np.zeros((len(positions), 6, 6))
    rigid[:, :3, :3] = rigid[:, 3:, 3:] = np.eye(3)
    rigid[:, 3:, :3] = -se3.skew(lever)
    return rigid


def free_motions(
    parts: Sequence[NormalBlocks], unknowns: Float[np.ndarray, "u 4 4"], n: int
) -> Float[np.ndarray, "6 f"]:
    """Rigid motions of the first n unknowns, the cameras, that no term opposes.

    Columns in the axes of `rigid_tangents`. Height, where the floor takes no part, is the usual one.
    """
    information = rigid_information(parts, unknowns, np.arange(n))
    held = np.zeros((n, 6))
    for part in parts:
        own = (part.rows == part.columns) & (part.rows < n)
        np.add.at(held, part.rows[own], np.diagonal(part.blocks[own], axis1=1, axis2=2))
    held = np.maximum(held, 1e-12 * held.max(initial=1e-300))
    rigid = rigid_tangents(unknowns[:n, :3, 3])
    root = np.linalg.cholesky(np.einsum("nik,ni,nil->kl", rigid, held, rigid))
    half = np.linalg.solve(root, information)
    shares, axes = np.linalg.eigh(np.linalg.solve(root, half.T))
    return np.linalg.solve(root.T, axes[:, shares < FREE_SHARE])


def rigid_information(
    parts: Sequence[NormalBlocks], target_from_cams: Poses, frames: np.ndarray
) -> Float[np.ndarray, "6 6"]:
    """Information (J^T J) of terms on the motion of some frames as one rigid body.

    The motion is (rotation, translation) [rad, m] about the frames' mean; other frames stay where they are.
    """
    rigid = np.zeros((len(target_from_cams), 6, 6))
    rigid[frames] = rigid_tangents(target_from_cams[frames, :3, 3])
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


def hold_whole(terms: Sequence[Term], target_from_cams: Poses) -> bool:
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
