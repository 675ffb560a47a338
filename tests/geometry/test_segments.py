"""2D segments; the compiled distance against its plain twin."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planfit.geometry import segments

ENDS = np.array([[[0, 0], [3, 4]], [[2, 2], [2, -2]]], dtype=float)


def nearest_distance_twin(xy, ends):
    """Every point against every segment, in NumPy."""
    along = ends[:, 1] - ends[:, 0]
    relative = xy[:, None] - ends[None, :, 0]
    length_sq = np.sum(along**2, axis=1)
    t = np.sum(relative * along, axis=2) / np.where(length_sq > 0, length_sq, 1.0)
    foot = np.clip(t, 0, 1)[..., None] * along
    return np.linalg.norm(relative - foot, axis=2).min(axis=1)


def test_lengths_directions_normals():
    assert_allclose(segments.lengths(ENDS), [5, 4])
    assert_allclose(segments.directions(ENDS), [[0.6, 0.8], [0, -1]])
    assert_allclose(segments.left_normals(ENDS), [[-0.8, 0.6], [1, 0]])


def test_nearest_distance_equals_its_twin(rng):
    ends = rng.uniform(-5, 5, (30, 2, 2))
    ends[4, 1] = ends[4, 0]  # a point
    xy = np.concatenate([rng.uniform(-8, 8, (300, 2)), ends.reshape(-1, 2), ends.mean(axis=1)])
    expected = nearest_distance_twin(xy, ends)
    assert_allclose(segments.nearest_distance(xy, ends), expected, atol=1e-12)


def test_ends_belong_to_a_segment():
    xy = np.array([[-3.0, -4.0], [6.0, 8.0], [0.0, 0.0]])
    assert_allclose(segments.nearest_distance(xy, ENDS[:1]), [5, 5, 0])


@pytest.mark.parametrize("turn", [lambda a: a, np.asfortranarray, lambda a: a[::-1][::-1]])
def test_memory_layout_does_not_matter(rng, turn):
    xy, ends = rng.uniform(-5, 5, (20, 2)), rng.uniform(-5, 5, (4, 2, 2))
    expected = nearest_distance_twin(xy, ends)
    assert_allclose(segments.nearest_distance(turn(xy), turn(ends)), expected)
    found = segments.nearest_distance(xy.astype(np.float32), ends)
    assert_allclose(found, expected, atol=1e-5)


def test_no_points_and_no_segments():
    assert segments.nearest_distance(np.zeros((0, 2)), ENDS).shape == (0,)
    assert_array_equal(segments.nearest_distance(np.zeros((1, 2)), np.zeros((0, 2, 2))), [np.inf])


@pytest.mark.parametrize("spacing_m", [0.1, 0.7, 10.0])
def test_samples_are_on_their_segments_evenly(spacing_m):
    xy, idx = segments.sample(ENDS, spacing_m)
    assert_array_equal(np.unique(idx), [0, 1])
    for n in range(2):
        mine = xy[idx == n]
        assert len(mine) == max(1, np.ceil(segments.lengths(ENDS)[n] / spacing_m))
        assert_allclose(mine.mean(axis=0), ENDS[n].mean(axis=0), atol=1e-12)
        assert_allclose(segments.nearest_distance(mine, ENDS[n : n + 1]), 0, atol=1e-12)
        gaps = np.linalg.norm(np.diff(mine, axis=0), axis=1)
        assert np.all(gaps <= spacing_m + 1e-9)
        assert_allclose(gaps, segments.lengths(ENDS)[n] / len(mine))
