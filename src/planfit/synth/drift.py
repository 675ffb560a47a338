"""Odometry drift: a random walk put on the relative motions of any trajectory."""

import numpy as np

from planfit.geometry import se3
from planfit.synth.options import DriftOptions


def drift_poses(
    world_from_cams: np.ndarray,
    options: DriftOptions,
    rng: np.random.Generator,
    up_world: np.ndarray,
) -> np.ndarray:
    """Poses (n, 4, 4) as odometry would give them: the first is kept, errors accumulate from there.

    Each motion from a frame to the next is preceded by a small error at the earlier frame: a turn
    about the vertical and the horizontal axes through the camera, and a shift. The axes are those
    of the true pose, and turn with what has drifted before.

    Args:
        world_from_cams: (n, 4, 4) true poses.
        options: spread of the error of each motion.
        rng: source of the errors.
        up_world: (3,) direction against gravity.
    """
    n = len(world_from_cams)
    axes = se3.rotation_between(np.array([0.0, 0.0, 1.0]), np.asarray(up_world, dtype=float))
    turn_spread = np.deg2rad(options.yaw_deg) * np.array(
        [options.tilt_share, options.tilt_share, 1.0]
    )
    shift_spread = options.shift_m * np.array([1.0, 1.0, options.vertical_share])
    turn = rng.normal(size=(n - 1, 3)) * turn_spread
    shift = rng.normal(size=(n - 1, 3)) * shift_spread
    if options.jumps_per_100_frames > 0:
        jumps = rng.random(n - 1) < options.jumps_per_100_frames / 100
        turn[jumps, 2] += rng.normal(size=jumps.sum()) * np.deg2rad(options.jump_yaw_deg)
        shift[jumps, :2] += rng.normal(size=(jumps.sum(), 2)) * options.jump_m
    turns, shifts = se3.exp_so3(turn @ axes.T), shift @ axes.T
    centres = world_from_cams[:-1, :3, 3]
    about_camera = centres - (turns @ centres[..., None])[..., 0]
    errors = se3.make_transform(turns, about_camera + shifts)
    result = np.zeros_like(world_from_cams)
    drifted_from_true = np.eye(4)
    result[0] = world_from_cams[0]
    for i in range(1, n):
        drifted_from_true = drifted_from_true @ errors[i - 1]
        result[i] = drifted_from_true @ world_from_cams[i]
    result[:, :3, :3] = se3.project_to_so3(result[:, :3, :3])
    result[0] = world_from_cams[0]
    return result
