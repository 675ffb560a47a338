"""The compiled loops of verification against the same in NumPy, all at once."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from builders import CAMERA
from planfit.geometry import se3
from planfit.matching.verify_kernels import (
    MIN_SIDE_M,
    agreeing,
    best_motion,
    fit_triples,
    rigid_triples,
)


def points_and_motions(rng, m=80, r=40):
    """Points of both frames, half of them off by more than their tolerance, and motions about the true."""
    a_from_b = se3.make_transform(se3.exp_so3(rng.normal(0, 0.2, 3)), rng.normal(0, 0.3, 3))
    points_b = CAMERA.lift(
        rng.uniform([0, 0], [CAMERA.width, CAMERA.height], (m, 2)), rng.uniform(1, 4, m)
    )
    points_a = se3.transform(a_from_b, points_b)
    points_a += rng.normal(0, 1, points_a.shape) * np.where(np.arange(m) % 2, 0.02, 0.4)[:, None]
    tolerance = rng.uniform(0.05, 0.15, m)
    return points_a, points_b, tolerance, se3.retract(a_from_b, rng.normal(0, 0.03, (r, 6)))


@pytest.mark.parametrize("most", [5, 1000])
def test_rigid_triples(rng, most):
    a, b, tolerance, _ = points_and_motions(rng)
    triples = rng.integers(len(a), size=(900, 3))
    triples[0] = 7  # no triangle
    ok = np.ones(len(triples), dtype=bool)
    for j, k in ((0, 1), (1, 2), (2, 0)):
        j, k = triples[:, j], triples[:, k]
        side_a, side_b = (np.linalg.norm(p[j] - p[k], axis=1) for p in (a, b))
        ok &= np.abs(side_a - side_b) < np.hypot(tolerance[j], tolerance[k])
        ok &= side_a > MIN_SIDE_M
    assert 20 < ok.sum() < 880
    assert_array_equal(rigid_triples(triples, a, b, tolerance, most), np.flatnonzero(ok)[:most])


@pytest.mark.parametrize("seed", range(5))
def test_best_motion(seed):
    a, b, tolerance, motions = points_and_motions(np.random.default_rng(seed))
    distance = np.linalg.norm(se3.transform(motions, b) - a, axis=-1)
    score = np.minimum((distance / tolerance) ** 2, 1.0).sum(axis=1)
    assert best_motion(motions, a, b, tolerance) == np.argmin(score)
    assert best_motion(motions[::-1], a, b, tolerance) == len(score) - 1 - np.argmin(score)


def test_the_first_of_equal_motions_is_best(rng):
    a, b, tolerance, motions = points_and_motions(rng)
    assert best_motion(motions[[3, 3, 3]], a, b, tolerance) == 0


def test_fit_triples_is_the_fit_by_singular_values(rng):
    a, b, _, _ = points_and_motions(rng)
    triples = np.array([rng.choice(len(a), 3, replace=False) for _ in range(200)])
    expected = [se3.fit_rigid(b[t], a[t], np.ones(3)) for t in triples]
    np.testing.assert_allclose(fit_triples(triples, a, b), expected, atol=1e-8)


def test_triples_half_a_turn_apart_are_fitted(rng):
    # A real part of 0 in the quaternion, and eigenvalues that the matrix shows on its diagonal already.
    b = np.array([[1.0, 0, 2], [0, 1, 2], [-1, 0, 2]])
    for axis in range(3):
        turn = -np.eye(3)
        turn[axis, axis] = 1
        found = fit_triples(np.arange(3)[None], b @ turn.T, b)[0]
        np.testing.assert_allclose(se3.transform(found, b), b @ turn.T, atol=1e-12)


def test_points_on_a_line_give_a_motion_that_fits_them(rng):
    b = np.array([[0.0, 0, 2], [1, 0, 2], [2, 0, 2]])
    true = se3.make_transform(se3.exp_so3(np.array([0.3, -0.2, 0.5])), np.array([1.0, 2, 3]))
    found = fit_triples(np.arange(3)[None], se3.transform(true, b), b)[0]
    np.testing.assert_allclose(se3.transform(found, b), se3.transform(true, b), atol=1e-9)
    np.testing.assert_allclose(found[:3, :3] @ found[:3, :3].T, np.eye(3), atol=1e-12)


def test_agreeing(rng):
    a, b, tolerance, motions = points_and_motions(rng, m=400)
    b[::40, 2] *= -1  # behind the camera
    uv_a = CAMERA.project(a) + rng.normal(0, 2, (400, 2))
    uv_b = CAMERA.project(np.abs(b)) + rng.normal(0, 2, (400, 2))
    cameras = np.tile([CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy], (2, 1))
    for motion in motions[:5]:
        b_in_a, a_in_b = se3.transform(motion, b), se3.transform(se3.inverse(motion), a)
        in_space = np.linalg.norm(b_in_a - a, axis=1) < tolerance
        in_a = np.linalg.norm(CAMERA.project(b_in_a) - uv_a, axis=1) < 6.0
        in_b = np.linalg.norm(CAMERA.project(a_in_b) - uv_b, axis=1) < 6.0
        for only in (in_space & in_a & ~in_b, in_space & ~in_a & in_b, ~in_space & in_a & in_b):
            assert only.any()  # each condition decides somewhere
        found = agreeing(motion, a, b, uv_a, uv_b, cameras, tolerance, 6.0)
        assert_array_equal(found, in_space & in_a & in_b)
