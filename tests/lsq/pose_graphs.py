"""Pose graphs whose truth is known, and files of them."""

import numpy as np

from planfit.geometry import se3
from planfit.lsq import PoseGraph


def sphere(rng, n_rings=8, per_ring=10, radius_m=10.0, sigma=(0.02, 0.1)):
    """Walk a spiral on a sphere, see the ring below: noisy edges, poses by their chain; and the truth."""
    n = n_rings * per_ring
    azimuth = 2 * np.pi * np.arange(n) / per_ring
    polar = np.linspace(0.15, 0.85, n) * np.pi
    yaw = se3.exp_so3(azimuth[:, None] * [0.0, 0.0, 1.0])
    rotations = yaw @ se3.exp_so3(polar[:, None] * [0.0, 1.0, 0.0])
    true_poses = se3.make_transform(rotations, radius_m * rotations[:, :, 2])
    i = np.arange(n)
    pairs = np.concatenate(
        [np.stack([i[:-1], i[1:]], axis=1), np.stack([i[:-per_ring], i[per_ring:]], axis=1)]
    )
    sigmas = np.repeat(sigma, 3)
    exact = se3.inverse(true_poses[pairs[:, 0]]) @ true_poses[pairs[:, 1]]
    measured = se3.retract(exact, sigmas * rng.normal(size=(len(pairs), 6)))
    poses = true_poses.copy()
    for k in range(n - 1):
        poses[k + 1] = poses[k] @ measured[k]
    information = np.tile(np.diag(sigmas**-2), (len(pairs), 1, 1))
    return PoseGraph(poses, pairs, measured, information), true_poses


def random_information(rng, n):
    """Positive definite matrices (n, 6, 6)."""
    root = rng.normal(size=(n, 6, 6))
    return root @ np.swapaxes(root, 1, 2) + 6.0 * np.eye(6)
