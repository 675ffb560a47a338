"""Doubled walls on built truth: what drift doubles is counted, and what really has two surfaces is not."""

import numpy as np
import pytest

from builders import look, make_structure
from planfit.evaluation import wall_layers

N_FRAMES = 32
FIRST = N_FRAMES // 2  # frames of the first visit


def true_poses():
    """Two visits of as many frames each to a wall along x, seen from y < 0."""
    x = np.tile(np.linspace(1.0, 5.0, FIRST), 2)
    return np.stack([look([at, -2.0, 1.4], 90) for at in x])


def bit_of_wall(rng, x, y_m, half_m=1.0, heights=(0.2, 2.2), n=400):
    """Points on a wall along x at y_m, around x."""
    along = rng.uniform(max(x - half_m, 0), min(x + half_m, 6.0), n)
    return np.stack([along, np.full(n, y_m), rng.uniform(*heights, n)], axis=1)


def wall_patches(rng, poses, y_m=0.0):
    return [(i, bit_of_wall(rng, pose[0, 3], y_m), [0.0, -1.0]) for i, pose in enumerate(poses)]


def drifted(poses, translation_m, frames=slice(FIRST, None)):
    moved = poses.copy()
    moved[frames, 1, 3] += translation_m
    return moved


def test_true_poses_double_nothing(rng):
    poses = true_poses()
    layers = wall_layers(make_structure(poses, patches=wall_patches(rng, poses)).walls, poses)
    assert layers.n_windows > 30
    assert layers.double_share == 0.0
    assert np.isnan(layers.gap_median_m)


@pytest.mark.parametrize("translation_m", [0.05, -0.1, 0.2])
def test_a_second_visit_that_drifted_doubles_the_whole_wall(rng, translation_m):
    poses = true_poses()
    structure = make_structure(poses, patches=wall_patches(rng, poses))
    layers = wall_layers(structure.walls, drifted(poses, translation_m))
    assert layers.double_share > 0.97
    assert layers.gap_median_m == pytest.approx(abs(translation_m), abs=0.005)
    assert np.all(np.abs(layers.windows[:, 1]) <= abs(translation_m) + 0.01)


def test_the_share_is_that_of_the_wall_that_is_double(rng):
    # The wall along x drifts by 8 cm across itself; the one along y, as long, only along itself.
    poses = true_poses()
    second = [(i, p[:, [1, 0, 2]] + [6.0, -3.0, 0], [-1.0, 0.0])
              for i, p, _ in wall_patches(rng, poses)]  # fmt: skip
    structure = make_structure(poses, patches=wall_patches(rng, poses) + second)
    layers = wall_layers(structure.walls, drifted(poses, 0.08))
    assert layers.double_share == pytest.approx(0.5, abs=0.04)
    assert np.mean(layers.is_double[layers.windows[:, 1] > 0.5]) == 0.0


def test_an_offset_below_the_gap_is_noise_and_beyond_the_largest_another_wall(rng):
    poses = true_poses()
    walls = make_structure(poses, patches=wall_patches(rng, poses)).walls
    assert wall_layers(walls, drifted(poses, 0.02)).double_share == 0.0
    assert wall_layers(walls, drifted(poses, 0.5)).double_share == 0.0


def test_drift_that_grows_makes_walls_thick_and_not_double(rng):
    # All frames see the same wall, each a little further off: one smear, no gap in it.
    poses = np.stack([look([3.0, -2.0, 1.4], 90)] * N_FRAMES)
    walls = make_structure(poses, patches=wall_patches(rng, poses)).walls
    smeared = poses.copy()
    smeared[:, 1, 3] += np.linspace(0, 0.2, N_FRAMES)
    assert wall_layers(walls, smeared).double_share == 0.0


def test_a_niche_seen_with_its_wall_is_two_surfaces(rng):
    poses = true_poses()
    niche = wall_patches(rng, poses, 0.12)
    walls = make_structure(poses, patches=wall_patches(rng, poses) + niche).walls
    layers = wall_layers(walls, poses)
    assert layers.n_windows > 30
    assert layers.double_share == 0.0


def test_the_other_side_of_a_wall_is_another_wall(rng):
    poses = true_poses()
    poses[FIRST:] = np.stack([look([x, 2.1, 1.4], 270) for x in poses[FIRST:, 0, 3]])
    patches = [
        (
            i,
            bit_of_wall(rng, pose[0, 3], 0.0 if i < FIRST else 0.1),
            [0.0, -1.0 if i < FIRST else 1.0],
        )
        for i, pose in enumerate(poses)
    ]
    layers = wall_layers(make_structure(poses, patches=patches).walls, poses)
    assert layers.double_share == 0.0


def test_a_radiator_below_a_window_is_no_layer_of_the_wall_above(rng):
    # The first visit looks up and sees the wall, the second looks down and sees what stands before it.
    poses = true_poses()
    patches = [
        (i, bit_of_wall(rng, pose[0, 3], *((0.0, 1.0, (1.3, 2.2)) if i < FIRST else (-0.1, 1.0, (0.1, 0.7)))),
         [0.0, -1.0])
        for i, pose in enumerate(poses)
    ]  # fmt: skip
    layers = wall_layers(make_structure(poses, patches=patches).walls, poses)
    assert layers.double_share == 0.0


def test_one_stray_frame_is_no_layer(rng):
    poses = true_poses()
    walls = make_structure(poses, patches=wall_patches(rng, poses)).walls
    assert wall_layers(walls, drifted(poses, 0.1, slice(3, 4))).double_share == 0.0


def test_frames_that_see_both_layers_tell_two_surfaces(rng):
    poses = true_poses()
    noisy = drifted(poses, 0.08)
    noisy[:, 1, 3] += 0.012 * np.array([-1, 1] * FIRST)
    walls = make_structure(poses, patches=wall_patches(rng, poses)).walls
    assert wall_layers(walls, noisy).double_share > 0.5
    both = wall_patches(rng, poses) + wall_patches(rng, poses, 0.12)[:8]
    niche = make_structure(poses, patches=both).walls
    assert wall_layers(niche, drifted(poses, 0.12)).double_share < 1.0


def test_no_walls():
    poses = true_poses()
    layers = wall_layers(make_structure(poses).walls, poses)
    assert layers.n_windows == 0
    assert np.isnan(layers.double_share)
