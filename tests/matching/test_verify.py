"""Verification: the true motion among outliers, and nothing among chance matches."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import CAMERA, look, with_constants
from planfit.geometry import se3
from planfit.matching import verify as verify_module
from planfit.matching.verify import point_sigma, verify

A_FROM_B = se3.make_transform(
    se3.exp_so3(np.array([0.05, 0.3, -0.02])), np.array([0.4, -0.05, 0.2])
)


def case(rng, n=100, outliers=0.0, noise_m=0.0, a_from_b=A_FROM_B):
    """Points and pixels of n matches, the first share of them wrong."""
    uv_b = rng.uniform([0, 0], [CAMERA.width, CAMERA.height], (n, 2))
    points_b = CAMERA.lift(uv_b, rng.uniform(1.5, 4.0, n))
    points_a = se3.transform(a_from_b, points_b)
    n_wrong = int(n * outliers)
    uv = rng.uniform([0, 0], [CAMERA.width, CAMERA.height], (n_wrong, 2))
    points_a[:n_wrong] = CAMERA.lift(uv, rng.uniform(1.5, 4.0, n_wrong))
    uv_a = CAMERA.project(points_a)
    points_a = points_a + rng.normal(0, noise_m, points_a.shape)
    return points_a, points_b, uv_a, uv_b


def verified(matches, seed=0, **options):
    points_a, points_b, uv_a, uv_b = matches
    rng = np.random.default_rng(seed)
    with with_constants(verify_module, **options):
        return verify(points_a, points_b, uv_a, uv_b, CAMERA, CAMERA, rng)


def test_exact_matches_give_the_exact_motion(rng):
    found = verified(case(rng))
    assert_allclose(found.a_from_b, A_FROM_B, atol=1e-9)
    assert found.is_inlier.all()


@pytest.mark.parametrize("seed", range(5))
def test_half_of_the_matches_may_be_wrong(seed):
    rng = np.random.default_rng(seed)
    found = verified(case(rng, outliers=0.5, noise_m=0.005))
    off = se3.inverse(A_FROM_B) @ found.a_from_b
    assert np.rad2deg(se3.rotation_angle(off[:3, :3])) < 0.3
    assert np.linalg.norm(off[:3, 3]) < 0.02
    assert found.is_inlier[50:].mean() > 0.9
    assert found.is_inlier[:50].mean() < 0.05


@pytest.mark.parametrize("seed", range(10))
def test_chance_matches_are_refused(seed):
    assert verified(case(np.random.default_rng(seed), n=60, outliers=1.0)) is None


def test_matches_on_one_wall_are_enough(rng):
    points_a, points_b, _, uv_b = case(rng)
    points_b[:, 2] = 2.5
    points_b[:, :2] = CAMERA.rays(uv_b)[:, :2] * 2.5
    points_a = se3.transform(A_FROM_B, points_b)
    found = verified((points_a, points_b, CAMERA.project(points_a), uv_b))
    assert_allclose(found.a_from_b, A_FROM_B, atol=1e-8)


def test_a_mirrored_scene_is_no_motion(rng):
    _, points_b, _, uv_b = case(rng)
    flip = np.array([-1.0, 1.0, 1.0])
    mirrored = points_b * flip, points_b, CAMERA.project(points_b * flip), uv_b
    assert verified(mirrored) is None


def test_the_same_seed_gives_the_same_motion(rng):
    matches = case(rng, outliers=0.5, noise_m=0.01)
    one, two = verified(matches), verified(matches)
    assert np.array_equal(one.a_from_b, two.a_from_b)


def test_too_few(rng):
    assert verified(case(rng, n=14)) is None
    assert verified(case(rng, n=15)) is not None
    assert verified(case(rng, n=0)) is None
    assert verified(case(rng, n=2), min_inliers=0) is None


def test_points_at_one_place_say_nothing(rng):
    points_a, points_b, uv_a, uv_b = (np.repeat(part[:1], 40, axis=0) for part in case(rng))
    assert verified((points_a, points_b, uv_a, uv_b)) is None


def test_min_inliers(rng):
    matches = case(rng, n=40, outliers=0.5)
    assert verified(matches) is not None
    assert verified(matches, min_inliers=30) is None


def test_min_inlier_ratio(rng):
    matches = case(rng, n=200, outliers=0.7)
    assert verified(matches) is not None
    assert verified(matches, min_inlier_ratio=0.5) is None


def test_sigmas_bound_the_distance_in_space(rng):
    points_a, points_b, uv_a, uv_b = case(rng)
    far = points_a.copy()
    ray = far[:30] / np.linalg.norm(far[:30], axis=1, keepdims=True)
    far[:30] += 0.15 * ray  # along the ray, so that the pixel stays
    matches = far, points_b, uv_a, uv_b
    wide = {"max_reprojection_px": 1e3}
    assert verified(matches, max_sigmas=8.0, **wide).is_inlier.all()
    for tight in ({"max_sigmas": 1.0}, {"sigma_base_m": 0.0, "sigma_per_m": 0.003},
                  {"sigma_base_m": 0.005, "sigma_per_m": 0.0}):  # fmt: skip
        inlier = verified(matches, **wide, **tight).is_inlier
        assert not inlier[:30].any()
        assert inlier[30:].mean() > 0.9


def test_reprojection_bounds_the_distance_in_the_images(rng):
    points_a, points_b, uv_a, uv_b = case(rng)
    for moved in ((uv_a + np.array([6.0, 0]), uv_b), (uv_a, uv_b + np.array([0, 6.0]))):
        assert verified((points_a, points_b, *moved)) is None
        found = verified((points_a, points_b, *moved), max_reprojection_px=7.0)
        assert found.is_inlier.all()


def test_more_rounds_find_rarer_motions():
    found = {rounds: 0 for rounds in (1, 300)}
    for seed in range(10):
        matches = case(np.random.default_rng(seed), n=80, outliers=0.7)
        for rounds in found:
            found[rounds] += verified(matches, seed, rounds=rounds) is not None
    assert found[300] == 10
    assert found[1] < 10


def test_sigma_grows_with_depth():
    assert_allclose(point_sigma(np.array([0.0, 2.0])), [0.02, 0.04])


def test_points_behind_the_other_camera_are_no_inliers(rng):
    rotated = se3.inverse(look([0, 0, 0], 0)) @ look([0, 0, 0], 180)
    points_a, points_b, _, uv_b = case(rng, a_from_b=rotated)
    uv_a = rng.uniform(0, 100, (100, 2))
    assert verified((points_a, points_b, uv_a, uv_b)) is None
