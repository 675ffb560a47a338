"""Cycles of motions between frames: what is needed to say whether one closes.

A verified motion between two frames, the recorded motion between them, and a verified motion of two frames
near by say the same, up to what each may be off.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.matching.types import RelativePoses
from planfit.priors import SAME_MOTION_SIGMAS
from planfit.scan.odometry import Odometry

MAX_SIGMAS = SAME_MOTION_SIGMAS.value
"""Largest departure of a consistent motion, in sigmas, where sigma is small against a building."""
CERTAIN_M = 1.2
"""Pairs between whose ends the motion is known to better than this, m (`MAX_SIGMAS` sigmas and the slack),
are certain: rooms are further apart."""
ROTATION_SLACK_DEG = 3.0
"""Departure in rotation that is always allowed, deg: the error of the verification itself."""
TRANSLATION_SLACK_M = 0.3
"""Departure in translation that is always allowed, m."""
SIGMA_ROTATION_DEG, SIGMA_TRANSLATION_M = 0.5, 0.03
"""Standard deviations of a verified motion's rotation and translation, each axis, where a path leads over
it."""
CERTAIN_SIGMA_M = (CERTAIN_M - TRANSLATION_SLACK_M) / MAX_SIGMAS
"""Standard deviation of a motion's translation, m, below which it is certain."""


def is_near(
    motions: Float[np.ndarray, "p 4 4"],
    predicted: Float[np.ndarray, "p 4 4"],
    sigmas: tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]],
    max_sigmas: float = MAX_SIGMAS,
    times: float = 1.0,
) -> Bool[np.ndarray, " p"]:
    """Whether motions depart from the predicted ones by no more than drift explains.

    Args:
        motions, predicted: between the same frames.
        sigmas: standard deviations of the predicted rotation (rad) and translation (m), each axis.
        max_sigmas: departure that drift explains, besides the slack.
        times: factor on all that is allowed.
    """
    sigma_rotation, sigma_translation = sigmas
    rotation = se3.rotation_angle(np.swapaxes(predicted[:, :3, :3], 1, 2) @ motions[:, :3, :3])
    translation = np.linalg.norm(predicted[:, :3, 3] - motions[:, :3, 3], axis=1)
    return (rotation < times * (max_sigmas * sigma_rotation + np.deg2rad(ROTATION_SLACK_DEG))) & (
        translation < times * (max_sigmas * sigma_translation + TRANSLATION_SLACK_M)
    )


def is_certain(sigma_translation: Float[np.ndarray, " p"]) -> Bool[np.ndarray, " p"]:
    """Whether rooms are further apart than the motion between two frames is uncertain (p,)."""
    return sigma_translation < CERTAIN_SIGMA_M


def by_way_of(
    relative_poses: RelativePoses, pairs: Int[np.ndarray, "p 2"], world_from_cams: Poses
) -> Float[np.ndarray, "p 4 4"]:
    """Motion (p, 4, 4) between the frames of pairs (p, 2), over a relative pose nearby and recorded steps.

    From i to k as recorded, from k to m as verified, from m to j as recorded.
    """
    (i, j), (k, m) = pairs.T, relative_poses.pairs.T
    i_from_k = se3.inverse(world_from_cams[i]) @ world_from_cams[k]
    m_from_j = se3.inverse(world_from_cams[m]) @ world_from_cams[j]
    return i_from_k @ relative_poses.a_from_b @ m_from_j


def told_by(
    relative_poses: RelativePoses,
    pairs: Int[np.ndarray, "p 2"],
    world_from_cams: Poses,
    odometry: Odometry,
) -> tuple[Float[np.ndarray, "p 4 4"], tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]]]:
    """Motions of pairs `by_way_of` a relative pose nearby, and the standard deviations (rotation, rad, and
    translation, m) of the recorded steps to it and from it."""
    (i, j), (k, m) = pairs.T, relative_poses.pairs.T
    sigmas = np.hypot(odometry.sigma_between(i, k), odometry.sigma_between(m, j))
    return by_way_of(relative_poses, pairs, world_from_cams), (sigmas[0], sigmas[1])


def spanned_steps(
    pairs: Int[np.ndarray, "p 2"], n_steps: int, least: int = 1
) -> Bool[np.ndarray, " s"]:
    """Which steps (frame i to i + 1) lie between the frames of a pair, or of so many at least."""
    # Pairs that begin less those that end, up to each step: how many span it.
    begun, ended = (np.bincount(side, minlength=n_steps + 1)[:n_steps] for side in pairs.T)
    return np.cumsum(begun - ended) >= least


def spans_any(
    pairs: Int[np.ndarray, "p 2"], is_marked: Bool[np.ndarray, " s"]
) -> Bool[np.ndarray, " p"]:
    """Whether a marked step (frame i to i + 1) lies between the frames of each pair."""
    n_marked = np.concatenate([[0], np.cumsum(is_marked)])
    return n_marked[pairs[:, 0]] != n_marked[pairs[:, 1]]
