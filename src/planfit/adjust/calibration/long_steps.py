"""Recorded motion over a distance that tells a scale: of short steps, most is the noise of the matches."""

from dataclasses import replace
from itertools import accumulate

import numpy as np
from jaxtyping import Float, Int

from planfit.adjust.problem import AdjustmentProblem
from planfit.adjust.terms.odometry import OdometryTerm

MIN_BASELINE_M = 0.25
"""What is usual between keyframes of a walk."""
LOOSE = 10.0
"""Standard deviations of shorter translations, times: what they alone hold remains held."""


def with_long_steps(
    problem: AdjustmentProblem, target_from_cams: Float[np.ndarray, "u 4 4"]
) -> AdjustmentProblem:
    """The problem with recorded translations between frames that are far enough apart to tell a scale.

    The scale of depth against recorded motion is a regression where both err. As sigmas of steps are larger
    than a good tracker's errors, solved motion is in effect the regressor, and its noise makes depth look too
    long by noise^2 / step^2 (attenuation: Fuller, Measurement Error Models, 1987): steps of 16 mm solved to
    3 mm asked for 4 to 8 %, at 2.3 to 4 standard deviations. Over k steps noise grows with sqrt(k) and motion
    with k, while all of them together tell the scale as well as before.
    """
    short = problem.odometry
    if short is None:
        return problem
    recorded = short.odometry
    poses = target_from_cams[: len(recorded.cam_from_next) + 1]
    frame_idx = _far_apart(poses[:, :3, 3])
    if len(frame_idx) == len(poses):
        return problem
    walked = np.stack(list(accumulate(recorded.cam_from_next, np.matmul, initial=np.eye(4))))
    loose = replace(recorded, sigma_translation=LOOSE * recorded.sigma_translation)
    # Rotations are told by the steps already.
    long = replace(
        recorded.between(frame_idx, walked[frame_idx]),
        sigma_rotation=np.full(len(frame_idx) - 1, np.inf),
    )
    of_long = OdometryTerm(long, short.model, "odometry, long steps", frame_idx)
    return replace(
        problem, odometry=replace(short, odometry=loose), extra=(*problem.extra, of_long)
    )


def _far_apart(positions: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " k"]:
    """The first position, each one that is far enough from the one before it here, and the last."""
    chosen = [0]
    for k in range(1, len(positions) - 1):
        if np.linalg.norm(positions[k] - positions[chosen[-1]]) >= MIN_BASELINE_M:
            chosen.append(k)
    return np.array([*chosen, len(positions) - 1])
