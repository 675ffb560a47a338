"""A walk whose neighbouring motions were measured with known noise, for tests of tracking."""

import numpy as np

from planfit.geometry import se3
from planfit.tracking.motions import MeasuredMotions

LAP = 30
"""Frames of a lap."""
SIGMA_RAD, SIGMA_M = np.deg2rad(0.3), 0.02


def walk(rng, n=80):
    """True poses (n, 4, 4): steps of about 0.3 m and 8 degrees, all turned some way in the world."""
    steps = se3.make_transform(
        se3.exp_so3(rng.normal(0.0, np.deg2rad(6.0), (n, 3))),
        np.array([0.05, 0.0, 0.25]) + rng.normal(0.0, 0.08, (n, 3)),
    )
    poses = [se3.make_transform(se3.exp_so3(rng.normal(size=3)), rng.normal(size=3))]
    for step in steps[:-1]:
        poses.append(poses[-1] @ step)
    return np.stack(poses)


def three_laps(rng):
    """True poses of three laps on one circle of 3 m, looking outwards."""
    angle = 2 * np.pi * np.arange(3 * LAP) / LAP
    centres = 3 * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    turned = se3.exp_so3(np.column_stack([0 * angle, 0 * angle, angle]))
    return se3.make_transform(turned, centres + rng.normal(0, 0.05, centres.shape))


def measure(poses, rng, neighbours=4, unmeasured=(), n_inliers=100):
    """Motions between each frame and those that follow it; none over the steps in `unmeasured`."""
    n = len(poses)
    pairs = np.array(
        [
            (i, j)
            for i in range(n)
            for j in range(i + 1, min(i + neighbours + 1, n))
            if not any(i <= step < j for step in unmeasured)
        ]
    )
    true = se3.inverse(poses[pairs[:, 0]]) @ poses[pairs[:, 1]]
    sigma = np.repeat([SIGMA_RAD, SIGMA_M], 3)
    noisy = se3.retract(true, rng.normal(size=(len(pairs), 6)) * sigma)
    covariance = np.tile(np.diag(sigma**2), (len(pairs), 1, 1))
    return MeasuredMotions(pairs, noisy, covariance, np.full(len(pairs), n_inliers))


def tracked(poses, rng, sigma_rad=0.0017, sigma_m=0.01):
    """The poses as a tracker records them: each step errs on its own."""
    steps = se3.inverse(poses[:-1]) @ poses[1:]
    sigma = np.repeat([sigma_rad, sigma_m], 3)
    steps = se3.retract(steps, rng.normal(size=(len(steps), 6)) * sigma)
    result = [poses[0]]
    for step in steps:
        result.append(result[-1] @ step)
    return np.stack(result)


def displaced(poses, first, last, metres, degrees, rng):
    """Frames first..last stand elsewhere by so much, in a direction of their own."""
    way, axis = rng.normal(size=(2, 3))
    rotation = se3.exp_so3(axis / np.linalg.norm(axis) * np.deg2rad(degrees))
    pivot = poses[first, :3, 3]
    moved = pivot + way / np.linalg.norm(way) * metres - rotation @ pivot
    result = poses.copy()
    result[first : last + 1] = se3.make_transform(rotation, moved) @ poses[first : last + 1]
    return result
