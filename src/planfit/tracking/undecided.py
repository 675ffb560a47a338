"""Jumps that revisits saw and could not place: what the walk would be with the jump at each undecided step.

Where a loop does not close, and several of its steps were measured by nothing, any of these may hold the
jump: revisits say by how much, and not where. The frames between stand differently in each case, so their
walls tell (`pipeline/jumps.py`).
"""

from dataclasses import dataclass, replace

import numpy as np

from planfit.geometry import se3
from planfit.matching import Matches
from planfit.priors import MIN_WITNESSES
from planfit.scan.odometry import unusualness, usual_step
from planfit.tracking.breaks import consensus, is_large, isotropic, votes_on
from planfit.tracking.motions import MAX_SIGMAS, expected_covariance
from planfit.tracking.submaps import motions_between
from planfit.tracking.types import Tracking, describe_jump


@dataclass(frozen=True)
class JumpHypothesis:
    """The walk with a jump at one step that nothing else decides."""

    step: int
    """Frame before the jump."""
    tracking: Tracking
    """With the frames after it where revisits put them."""
    cost: float
    """By how much less like a walk the step is so than as recorded, squared sigmas (`unusualness`)."""


def jump_hypotheses(tracking: Tracking, matches: Matches) -> tuple[JumpHypothesis, ...]:
    """One hypothesis for each undecided step over which revisits ask for a jump.

    Args:
        tracking: as judged, undecided steps as recorded.
        matches: of the whole scan.
    """
    usual = usual_step(tracking.odometry.cam_from_next)
    found = (
        _with_jump_at(int(step), tracking, matches, usual) for step in tracking.undecided_steps
    )
    return tuple(each for each in found if each is not None)


def _with_jump_at(
    step: int,
    tracking: Tracking,
    matches: Matches,
    usual: tuple[float, float],
) -> JumpHypothesis | None:
    poses, odometry = tracking.world_from_cams, tracking.odometry
    is_after = np.arange(len(poses)) > step
    motions = motions_between(matches, is_after.astype(int))
    if len(motions) < MIN_WITNESSES:
        return None
    votes = votes_on(poses, motions, expected_covariance(motions, odometry), is_after)
    agreed = consensus(votes, np.arange(len(motions)), MAX_SIGMAS)
    if agreed is None or not is_large(agreed[0], votes.pivot):
        return None
    displaced, covariance = agreed
    moved = poses.copy()
    moved[is_after] = displaced @ poses[is_after]
    steps = odometry.cam_from_next.copy()
    steps[step] = se3.inverse(moved[step]) @ moved[step + 1]
    # The revisits that say how far the jump went are among the matches, which are to hold the step.
    sigmas = odometry.sigma_rotation.copy(), odometry.sigma_translation.copy()
    rotation, translation = isotropic(covariance)
    size = se3.inverse(odometry.cam_from_next[step]) @ steps[step]
    sigmas[0][step] = max(rotation, float(se3.rotation_angle(size[:3, :3])))
    sigmas[1][step] = max(translation, float(np.linalg.norm(size[:3, 3])))
    agrees = votes.cost(displaced) < MAX_SIGMAS**2
    told = describe_jump(
        tracking.recorded_world_from_cams, moved, step, int(agrees.sum()), "revisits and the plan"
    )
    # What said that the walk jumps somewhere is answered.
    breaks = [b for b in tracking.breaks if b.kind != "jump" or b.n_motions > 0]
    jumped = replace(
        tracking,
        world_from_cams=moved,
        odometry=replace(
            odometry, cam_from_next=steps, sigma_rotation=sigmas[0], sigma_translation=sigmas[1]
        ),
        breaks=tuple(sorted((*breaks, told), key=lambda b: b.first_frame)),
        undecided_steps=np.setdiff1d(tracking.undecided_steps, [step]),
        contradicted_steps=np.zeros(0, dtype=int),
    )
    told, recorded = unusualness(np.stack([steps[step], odometry.cam_from_next[step]]), usual)
    return JumpHypothesis(step, jumped, float(told - recorded))
