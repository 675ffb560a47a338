"""Cycles of motions between frames: what is needed to say whether one closes.

A verified motion between two frames, the recorded motion between them, and a verified motion of two frames
near by say the same, up to what each may be off.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.errors import require_positive
from planfit.geometry import se3
from planfit.matching.types import RelativePoses


@dataclass(frozen=True)
class CycleConsistencyOptions:
    """When a relative pose is consistent with all else that is known."""

    max_sigmas: float = 6.0
    """Largest departure, in sigmas, where sigma is small against a building."""
    max_uncertain_sigmas: float = 4.0
    """Largest departure where it is not: there, another room may lie within six sigmas."""
    certain_m: float = 1.2
    """Pairs between whose ends the motion is known to better than this (`max_sigmas` sigmas and the slack)
    are certain: rooms are further apart."""
    rotation_slack_deg: float = 3.0
    """Departure in rotation that is always allowed: the error of the verification itself."""
    translation_slack_m: float = 0.3
    """Departure in translation that is always allowed."""
    sigma_rotation_deg: float = 0.5
    """Standard deviation of a verified motion's rotation, each axis, where a path leads over it."""
    sigma_translation_m: float = 0.03
    """Standard deviation of its translation, each axis."""
    cluster_m: float = 1.0
    """Relative poses whose two ends lie within this much of way from another's stand or fall together if
    they agree: one of them is checked."""
    strong_share: float = 0.1
    """Revisits that explain this share of both views are decided first, by the gates above. What explains
    less may be a poster, and is held to the drift that those show."""
    max_drifts: float = 6.0
    """Largest departure of a strong revisit, in sigmas of the drift that strong revisits show."""
    max_weak_drifts: float = 3.0
    """The same of the others."""
    min_advantage: float = 1.0
    """Of two revisits that contradict each other, the one that asks for less drift is right if the squares of
    both, in sigmas of the recorded motion, differ by this; else neither is used."""
    rival_share: float = 0.33
    """A revisit is no rival of one that explains more than its own share of the views by this factor."""

    def __post_init__(self) -> None:
        require_positive(self, "sigma_rotation_deg", "sigma_translation_m", "cluster_m")


def is_near(
    motions: Float[np.ndarray, "p 4 4"],
    predicted: Float[np.ndarray, "p 4 4"],
    sigmas: tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]],
    options: CycleConsistencyOptions,
    max_sigmas: float | None = None,
) -> Bool[np.ndarray, " p"]:
    """Whether motions depart from the predicted ones by no more than drift explains.

    Args:
        motions, predicted: between the same frames.
        sigmas: standard deviations of the predicted rotation (rad) and translation (m), each axis.
        options: slack, and how many sigmas.
        max_sigmas: in the place of that of the options.
    """
    most = options.max_sigmas if max_sigmas is None else max_sigmas
    sigma_rotation, sigma_translation = sigmas
    rotation = se3.rotation_angle(np.swapaxes(predicted[:, :3, :3], 1, 2) @ motions[:, :3, :3])
    translation = np.linalg.norm(predicted[:, :3, 3] - motions[:, :3, 3], axis=1)
    return (rotation < most * sigma_rotation + np.deg2rad(options.rotation_slack_deg)) & (
        translation < most * sigma_translation + options.translation_slack_m
    )


def is_certain(
    sigma_translation: Float[np.ndarray, " p"], options: CycleConsistencyOptions
) -> Bool[np.ndarray, " p"]:
    """Whether rooms are further apart than the motion between two frames is uncertain (p,)."""
    return sigma_translation < certain_sigma_m(options)


def certain_sigma_m(options: CycleConsistencyOptions) -> float:
    """Standard deviation of a motion's translation (m) below which it is certain; with no sigmas any is, or
    none."""
    left_m = options.certain_m - options.translation_slack_m
    if options.max_sigmas == 0.0:
        return np.inf if left_m > 0.0 else 0.0
    return left_m / options.max_sigmas


def by_way_of(
    relative_poses: RelativePoses,
    pairs: Int[np.ndarray, "p 2"],
    world_from_cams: Float[np.ndarray, "n 4 4"],
) -> Float[np.ndarray, "p 4 4"]:
    """Motion (p, 4, 4) between the frames of pairs (p, 2), over a relative pose nearby and recorded steps.

    From i to k as recorded, from k to m as verified, from m to j as recorded.
    """
    (i, j), (k, m) = pairs.T, relative_poses.pairs.T
    i_from_k = se3.inverse(world_from_cams[i]) @ world_from_cams[k]
    m_from_j = se3.inverse(world_from_cams[m]) @ world_from_cams[j]
    return i_from_k @ relative_poses.a_from_b @ m_from_j


def spanned_steps(pairs: Int[np.ndarray, "p 2"], n_steps: int) -> Bool[np.ndarray, " s"]:
    """Which steps (frame i to i + 1) lie between the frames of a pair."""
    # Pairs that begin less those that end, up to each step: how many span it.
    begun, ended = (np.bincount(side, minlength=n_steps + 1)[:n_steps] for side in pairs.T)
    return np.cumsum(begun - ended) > 0


def spans_any(
    pairs: Int[np.ndarray, "p 2"], is_marked: Bool[np.ndarray, " s"]
) -> Bool[np.ndarray, " p"]:
    """Whether a marked step (frame i to i + 1) lies between the frames of each pair."""
    n_marked = np.concatenate([[0], np.cumsum(is_marked)])
    return n_marked[pairs[:, 0]] != n_marked[pairs[:, 1]]
