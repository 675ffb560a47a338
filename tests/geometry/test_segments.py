"""2D segments; the compiled distance against its plain twin."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planfit.floorplan import nearest_faces
from planfit.geometry import segments

ENDS = np.array([[[0, 0], [3, 4]], [[2, 2], [2, -2]]], dtype=float)


def test_lengths_directions_normals():
    assert_allclose(segments.lengths(ENDS), [5, 4])
    assert_allclose(segments.directions(ENDS), [[0.6, 0.8], [0, -1]])
    assert_allclose(segments.left_normals(ENDS), [[-0.8, 0.6], [1, 0]])


@pytest.mark.parametrize("spacing_m", [0.1, 0.7, 10.0])
def test_samples_are_on_their_segments_evenly(spacing_m):
    xy, idx = segments.sample(ENDS, spacing_m)
    assert_array_equal(np.unique(idx), [0, 1])
    for n in range(2):
        mine = xy[idx == n]
        assert len(mine) == max(1, np.ceil(segments.lengths(ENDS)[n] / spacing_m))
        assert_allclose(mine.mean(axis=0), ENDS[n].mean(axis=0), atol=1e-12)
        assert_allclose(nearest_faces.nearest_distance(mine, ENDS[n : n + 1]), 0, atol=1e-12)
        gaps = np.linalg.norm(np.diff(mine, axis=0), axis=1)
        assert np.all(gaps <= spacing_m + 1e-9)
        assert_allclose(gaps, segments.lengths(ENDS)[n] / len(mine))
