"""Covariances of neighbourhoods against all pairs, and what must not change them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from planfit.errors import OptionError
from planfit.evaluation.neighbour_kernels import smallest_eigenvalues
from planfit.evaluation.neighbourhoods import as_matrices, covariances, make_grid


def all_covariances(points, radius_m, cells_per_radius=None, workers=1):
    counts, result = np.full(len(points), -1), np.full((len(points), 3, 3), np.nan)
    for idx, n, found in covariances(make_grid(points, radius_m, cells_per_radius), workers):
        counts[idx], result[idx] = n, as_matrices(found)
    return counts, result


def slow_covariances(points, radius_m):
    near = np.linalg.norm(points[:, None] - points[None], axis=2) <= radius_m
    covariance = [np.cov(points[row].T) if row.sum() > 1 else np.zeros((3, 3)) for row in near]
    return near.sum(axis=1), np.array(covariance)


def surfaces(rng, n):
    """A floor and a wall with noise, dense here and thin there, and a few points in the air."""
    points = rng.uniform(-1.0, 1.0, (n, 3)) * [1.0, 1.5, 1.0]
    points[: n // 2, 2] = 0.01 * rng.normal(size=n // 2)
    points[n // 2 : -n // 10, 0] = 0.4 + 0.02 * rng.normal(size=len(points[n // 2 : -n // 10]))
    points[: n // 4, :2] *= 0.3
    return points


@pytest.mark.parametrize("cells_per_radius", [None, 1, 2, 3, 5, 8])
@pytest.mark.parametrize("radius_m", [0.05, 0.2, 3.0])
def test_all_pairs_give_the_same(rng, cells_per_radius, radius_m):
    points = surfaces(rng, 700)
    expected_counts, expected = slow_covariances(points, radius_m)
    counts, found = all_covariances(points, radius_m, cells_per_radius)
    assert_array_equal(counts, expected_counts)
    assert_allclose(found, expected, atol=1e-13)


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    n=st.integers(1, 60),
    extent=st.floats(0.01, 5.0),
    offset=st.floats(-100, 100),
)
def test_any_cloud_anywhere(seed, n, extent, offset):
    points = np.random.default_rng(seed).uniform(-extent, extent, (n, 3)) + offset
    expected_counts, expected = slow_covariances(points, 0.2)
    counts, found = all_covariances(points, 0.2)
    assert_array_equal(counts, expected_counts)
    assert_allclose(found, expected, atol=1e-12)


def test_far_from_the_origin_nothing_is_lost(rng):
    points = surfaces(rng, 500)
    near, far = (all_covariances(points + offset, 0.2)[1] for offset in (0.0, 5e5))
    assert_allclose(far, near, atol=1e-9)  # coordinates themselves have 1e-10 m there


def test_threads_and_blocks_change_no_bit(rng, monkeypatch):
    points = surfaces(rng, 3000)
    one = all_covariances(points, 0.2)
    monkeypatch.setattr("planfit.evaluation.neighbourhoods.ROWS_AT_A_TIME", 100)
    for workers in (1, 4):
        again = all_covariances(points, 0.2, workers=workers)
        assert_array_equal(again[0], one[0])
        assert_array_equal(again[1], one[1])


def test_points_on_one_spot(rng):
    counts, found = all_covariances(np.zeros((9, 3)), 0.2)
    assert_array_equal(counts, 9)
    assert_array_equal(found, 0.0)


def test_stray_points_and_a_radius_of_zero_are_refused():
    points = np.array([[0.0, 0, 0], [1e6, 0, 0]])
    with pytest.raises(OptionError, match="stray points"):
        make_grid(points, 0.2)
    with pytest.raises(OptionError, match=r"radius_m: expected a length above 0, found 0"):
        make_grid(points, 0.0)


def test_smallest_eigenvalues_of_planes_lines_and_blobs(rng):
    rotations = np.linalg.qr(rng.normal(size=(400, 3, 3)))[0]
    sizes = 10.0 ** rng.uniform(-12, 0, (400, 3))
    sizes[:50, 1] = sizes[:50, 0]  # double roots, and the same thrice
    sizes[:10] = sizes[:10, :1]
    matrices = rotations @ (sizes[:, :, None] * np.swapaxes(rotations, 1, 2))
    entries = matrices[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    found = np.zeros(400)
    smallest_eigenvalues(entries, found)
    expected = np.linalg.eigvalsh(as_matrices(entries))[:, 0]
    assert np.all(np.abs(found - expected) <= 1e-12 * sizes.sum(axis=1))
