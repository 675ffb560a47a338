"""Descriptors of two frames: mutual nearest neighbours, and the ratio test."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from planfit.matching.matchers import match_descriptors


def test_mutual_nearest_neighbours_against_a_loop(rng):
    a = rng.integers(0, 256, (60, 128)).astype(np.uint8)
    b = np.concatenate([a[:30], rng.integers(0, 256, (40, 128)).astype(np.uint8)])
    b = np.clip(b.astype(int) + rng.integers(-20, 21, b.shape), 0, 255).astype(np.uint8)
    expected = []
    distance = np.linalg.norm(a[:, None].astype(float) - b[None], axis=2)
    for i in range(60):
        best, second = np.argsort(distance[i])[:2]
        if distance[:, best].argmin() == i and distance[i, best] < 0.85 * distance[i, second]:
            expected.append((i, best))
    assert_array_equal(match_descriptors(a, b), expected)
    assert len(expected) >= 30


def test_max_ratio_refuses_ambiguous_matches():
    a = np.zeros((2, 128), np.uint8)
    a[1] = 200
    b = np.zeros((3, 128), np.uint8)
    b[0, 0], b[1, 0], b[2] = 8, 10, 200
    assert_array_equal(match_descriptors(a, b), [[0, 0], [1, 2]])
    b[1, 0] = 9
    assert_array_equal(match_descriptors(a, b), [[1, 2]])


@pytest.mark.parametrize("sizes", [(0, 5), (5, 0), (1, 5), (5, 1)])
def test_too_few_descriptors_to_compare(rng, sizes):
    a, b = (rng.integers(0, 256, (n, 128)).astype(np.uint8) for n in sizes)
    assert match_descriptors(a, b).shape == (0, 2)
