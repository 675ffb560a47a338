"""Flat upright patches among wall points."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planfit.segmentation import patches
from planfit.segmentation.patches import WALL_PATCH, find_patches


def wall(rng, first, last, n=200, noise_m=0.01):
    t = rng.uniform(0, 1, (n, 1))
    xy = np.array(first) * (1 - t) + np.array(last) * t
    return xy + rng.normal(0, noise_m, xy.shape)


def found(xy, seed=0, **sizes):
    size = replace(WALL_PATCH, **sizes)
    return find_patches(xy, size, np.random.default_rng(seed))


def test_a_wall_ahead(rng):
    xy = wall(rng, [-1, 3], [2, 3])
    (patch,) = found(xy)
    assert_allclose(patch.normal, [0, -1], atol=0.01)
    assert np.linalg.norm(patch.normal) == pytest.approx(1.0)
    assert len(patch.point_idx) > 190
    ends = patch.ends[np.argsort(patch.ends[:, 0])]
    # Two in a hundred points are cut off at each end.
    assert_allclose(ends, [[-1, 3], [2, 3]], atol=0.2)
    assert np.all(np.abs(ends[:, 0] - 0.5) < 1.52)


@pytest.mark.parametrize("angle_deg", range(0, 360, 45))
def test_normals_point_to_the_camera(rng, angle_deg):
    c, s = np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))
    rotation = np.array([[c, -s], [s, c]])
    (patch,) = found(wall(rng, [-1, 3], [2, 3]) @ rotation.T)
    assert_allclose(patch.normal, rotation @ [0, -1], atol=0.01)


def test_a_corner_is_two_patches_and_no_point_is_in_both(rng):
    xy = np.concatenate([wall(rng, [-2, 3], [1, 3], 300), wall(rng, [1, 3], [1, 0], 200)])
    parts = found(xy)
    assert len(parts) == 2
    assert_allclose(parts[0].normal, [0, -1], atol=0.02)
    assert_allclose(parts[1].normal, [-1, 0], atol=0.02)
    assert not set(parts[0].point_idx) & set(parts[1].point_idx)
    assert np.mean(parts[0].point_idx < 300) > 0.97


def test_a_gap_ends_a_patch(rng):
    xy = np.concatenate([wall(rng, [-3, 3], [-1, 3], 300), wall(rng, [0, 3], [1, 3], 100)])
    patch = found(xy)[0]
    assert patch.ends[:, 0].max() < -0.9
    assert np.all(patch.point_idx < 300)


def test_clutter_makes_no_patch(rng):
    blob = rng.normal([0, 3], 0.1, (300, 2))
    assert all(np.ptp(patch.ends, axis=0).max() > 0.5 for patch in found(blob))
    assert found(rng.uniform(-4, 4, (150, 2))) == []


def test_nothing_and_next_to_nothing(rng):
    assert found(np.zeros((0, 2))) == []
    assert found(rng.normal(size=(1, 2)), min_points=1) == []
    assert found(np.tile([1.0, 2.0], (100, 1))) == []


def test_the_same_seed_gives_the_same_patches(rng):
    xy = np.concatenate([wall(rng, [-2, 3], [1, 3], 300), wall(rng, [1, 3], [1, 0], 200)])
    for one, two in zip(found(xy, 3), found(xy, 3), strict=True):
        assert_array_equal(one.point_idx, two.point_idx)
        assert_array_equal(one.ends, two.ends)


def test_min_points(rng):
    xy = wall(rng, [-1, 3], [1, 3], 100)
    assert len(found(xy, min_points=90)) == 1
    assert found(xy, min_points=101) == []


def test_min_length_m(rng):
    xy = wall(rng, [-0.5, 3], [0.5, 3], 200)
    assert len(found(xy, min_length_m=0.8)) == 1
    assert found(xy, min_length_m=1.1) == []


def test_max_per_frame(rng):
    xy = np.concatenate([wall(rng, [-3, y], [3, y]) for y in (1, 2, 3, 4)])
    assert len(found(xy)) == 4
    with patch.object(patches, "_MAX_PER_FRAME", 2):
        assert len(found(xy)) == 2


def test_tolerance_m_and_its_growth(rng):
    xy = wall(rng, [-2, 4], [2, 4], 400, noise_m=0.0)
    xy[:100, 1] += 0.06

    def n_points(tolerance_m, per_m):
        with patch.multiple(patches, _TOLERANCE_M=tolerance_m, _TOLERANCE_PER_M=per_m):
            return len(found(xy)[0].point_idx)

    assert n_points(0.03, 0.0) <= 300
    assert n_points(0.1, 0.0) == 400
    assert n_points(0.03, 0.02) == 400


def test_more_rounds_find_smaller_patches(rng):
    clutter = rng.uniform([-4, 1], [4, 5], (500, 2))
    xy = np.concatenate([clutter, wall(rng, [-2, 3], [2, 3], 100, 0.003)])

    def hits(rounds):
        with patch.object(patches, "_ROUNDS", rounds):
            return sum(
                any(np.mean(p.point_idx >= 500) > 0.6 for p in found(xy, seed))
                for seed in range(10)
            )

    assert hits(400) >= 9
    assert hits(3) <= 7
