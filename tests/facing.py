"""Cameras side by side that face the same points, so that every match is seen from both ends."""

from dataclasses import replace

import numpy as np

from builders import CAMERA, look, make_matches, nudged

WIDE = replace(CAMERA, fx=180.0, fy=150.0, cx=80.5, cy=57.0)


def facing_poses(n=6, step_m=0.4):
    """True poses (n, 4, 4): a zigzag along y, looking along x, each turned a little.

    Not a straight row: there, rays leave the length of each step open.
    """
    return np.stack(
        [
            look([0.5 * (i % 2), step_m * i, 1.3 + 0.2 * (i % 3)], 5.0 * (i % 3) - 5, 4.0 * i)
            for i in range(n)
        ]
    )


def facing_matches(rng, poses, n_points=30, sigma_m=0.03):
    """Exact matches of neighbours, next neighbours and, against the order, last with first."""
    points = rng.uniform([3, -1.5, 0.3], [6, 3.5, 2.5], (n_points, 3))
    n = len(poses)
    pairs = [(i, i + 1) for i in range(n - 1)] + [(i, i + 2) for i in range(n - 2)] + [(n - 1, 0)]
    return make_matches(poses, pairs, points, sigma_m)


def facing_cameras(n):
    """Two kinds of camera, in turn, with fx != fy."""
    return tuple(WIDE if i % 2 else CAMERA for i in range(n))


def drifted(rng, poses, rotation_deg=1.0, translation_m=0.05):
    """The poses, all but the first and last nudged."""
    moved = nudged(rng, poses, rotation_deg, translation_m)
    moved[[0, -1]] = poses[[0, -1]]
    return moved


def with_outliers(rng, matches, share=0.2, size_m=1.0):
    """Some matches moved by up to `size_m` each axis."""
    wrong = rng.random(matches.n_matches) < share
    points_a = matches.points_a + wrong[:, None] * rng.uniform(-size_m, size_m, (len(wrong), 3))
    return replace(matches, points_a=points_a)


def with_noise(rng, matches, noise_m=0.02):
    """Matches with Gaussian noise at both ends."""
    a, b = matches.points_a, matches.points_b
    return replace(
        matches,
        points_a=a + rng.normal(0, noise_m, a.shape),
        points_b=b + rng.normal(0, noise_m, b.shape),
    )
