"""Planes of points."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import random_transforms
from planfit.geometry import se3
from planfit.geometry.planes import fit_plane


def test_finds_the_plane_of_exact_points(rng):
    flat = np.column_stack([rng.normal(size=(20, 2)), np.zeros(20)])
    pose = random_transforms(rng, 1)[0]
    points = se3.transform(pose, flat)
    normal, offset, rms = fit_plane(points)
    assert abs(normal @ pose[:3, 2]) == pytest.approx(1.0)
    assert_allclose(points @ normal, offset, atol=1e-12)
    assert rms == pytest.approx(0.0, abs=1e-7)


def test_rms_is_that_of_the_distances(rng):
    points = rng.normal(size=(500, 3)) * [3.0, 2.0, 0.1]
    normal, offset, rms = fit_plane(points)
    assert rms == pytest.approx(np.sqrt(np.mean((points @ normal - offset) ** 2)))
    assert rms == pytest.approx(0.1, rel=0.1)
    assert np.linalg.norm(normal) == pytest.approx(1.0)


def test_weights_of_zero_leave_points_out(rng):
    points = np.column_stack([rng.normal(size=(20, 2)), np.zeros(20)])
    points[:5] = rng.normal(size=(5, 3)) * 10
    normal, offset, _ = fit_plane(points, np.r_[np.zeros(5), np.ones(15)])
    assert abs(normal[2]) == pytest.approx(1.0)
    assert offset == pytest.approx(0.0, abs=1e-12)


def test_three_points_lie_on_their_plane():
    points = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]])
    normal, offset, rms = fit_plane(points)
    assert_allclose(np.abs(normal), np.sqrt(1 / 3))
    assert abs(offset) == pytest.approx(np.sqrt(1 / 3))
    assert rms == pytest.approx(0.0, abs=1e-7)
