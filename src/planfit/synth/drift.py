"""Odometry drift: a random walk put on the relative motions of any trajectory."""

import numpy as np
from jaxtyping import Float

from planfit.geometry import se3
from planfit.synth.options import DriftOptions

TILT_SHARE, VERTICAL_SHARE = 0.3, 0.3
"""Error about each horizontal axis as a share of that about the vertical, and along the vertical as a share
of that along the horizontal: gravity is known to a tracker. Measured on ConSLAM at its own frame rate."""


def drift_poses(
    world_from_cams: Float[np.ndarray, "n 4 4"],
    options: DriftOptions,
    rng: np.random.Generator,
    up_world: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "n 4 4"]:
    """Poses as odometry would give them: the first is kept, errors accumulate from there.

    Each motion from a frame to the next is preceded by a small error at the earlier frame: a rotation
    about the vertical and the horizontal axes through the camera, and a translation. The axes are those
    of the true pose, and turn with what has drifted before.

    Args:
        world_from_cams: true poses.
        options: standard deviations of the error of each motion.
        rng: source of the errors.
        up_world: unit direction against gravity.
    """
    n = len(world_from_cams)
    axes = se3.rotation_between(np.array([0.0, 0.0, 1.0]), np.asarray(up_world, dtype=float))
    sigma_rotation = np.deg2rad(options.yaw_deg) * np.array([TILT_SHARE, TILT_SHARE, 1.0])
    sigma_translation = options.translation_m * np.array([1.0, 1.0, VERTICAL_SHARE])
    rotation = rng.normal(size=(n - 1, 3)) * sigma_rotation
    translation = rng.normal(size=(n - 1, 3)) * sigma_translation
    if options.jumps_per_100_frames > 0:
        jumps = rng.random(n - 1) < options.jumps_per_100_frames / 100
        rotation[jumps, 2] += rng.normal(size=jumps.sum()) * np.deg2rad(options.jump_yaw_deg)
        translation[jumps, :2] += rng.normal(size=(jumps.sum(), 2)) * options.jump_m
    rotations, translations = se3.exp_so3(rotation @ axes.T), translation @ axes.T
    centres = world_from_cams[:-1, :3, 3]
    about_camera = centres - (rotations @ centres[..., None])[..., 0]
    errors = se3.make_transform(rotations, about_camera + translations)
    result = np.zeros_like(world_from_cams)
    drifted_from_true = np.eye(4)
    result[0] = world_from_cams[0]
    for i in range(1, n):
        drifted_from_true = drifted_from_true @ errors[i - 1]
        result[i] = drifted_from_true @ world_from_cams[i]
    result[:, :3, :3] = se3.project_to_so3(result[:, :3, :3])
    result[0] = world_from_cams[0]
    return result
