"""Matches of one's own: grouped by pair, whatever order and direction they come in; and bad ones refused."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import look, make_matches
from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.matching import Matches

POSES = np.stack([look([0.3 * i, 0.1 * i, 1.5], 5.0 * i) for i in range(4)])


def rows(matches):
    """Frame pairs (m, 2), points of both ends and sigma of matches, one row each."""
    pairs = np.repeat(matches.pairs, np.diff(matches.start), axis=0)
    return pairs, matches.points_a, matches.points_b, matches.sigma


def test_shuffled_and_reversed_rows_are_grouped_again(rng):
    expected = make_matches(POSES, [(0, 1), (0, 3), (1, 2)], rng.normal(size=(7, 3)))
    pairs, a, b, _ = rows(expected)
    sigma = rng.uniform(0.01, 0.1, len(a))
    shuffled = rng.permutation(len(a))
    pairs, a, b = pairs[shuffled], a[shuffled], b[shuffled]
    is_reversed = rng.random(len(a)) < 0.5
    pairs[is_reversed] = pairs[is_reversed][:, ::-1]
    a, b = (np.where(is_reversed[:, None], x, y) for x, y in ((b, a), (a, b)))
    found = Matches.from_arrays(pairs, a, b, sigma[shuffled])
    assert_array_equal(found.pairs, expected.pairs)
    assert_array_equal(found.start, expected.start)
    # Within a pair they keep the order they were given in.
    of_pair = np.repeat(np.arange(3), 7)
    order = shuffled[np.argsort(of_pair[shuffled], kind="stable")]
    assert_array_equal(found.points_a, expected.points_a[order])
    assert_array_equal(found.points_b, expected.points_b[order])
    assert_array_equal(found.sigma, sigma[order])
    assert found.n_tried == 3


def test_points_of_a_match_coincide_in_the_world(rng):
    points = rng.normal(size=(20, 3))
    i, j = rng.integers(0, 3, 20), np.full(20, 3)
    cams_from_world = se3.inverse(POSES)
    found = Matches.from_arrays(
        np.column_stack([j, i]),
        se3.transform_each(cams_from_world[j], points),
        se3.transform_each(cams_from_world[i], points),
        0.02,
    )
    pairs, a, b, sigma = rows(found)
    assert np.all(pairs[:, 0] < pairs[:, 1])
    assert_allclose(
        se3.transform_each(POSES[pairs[:, 0]], a), se3.transform_each(POSES[pairs[:, 1]], b)
    )
    assert_array_equal(sigma, 0.02)


def test_no_matches_at_all():
    none = np.zeros((0, 3))
    found = Matches.from_arrays(np.zeros((0, 2), dtype=int), none, none, 0.02)
    assert found.n_matches == 0
    assert found.pairs.shape == (0, 2)
    assert_array_equal(found.start, [0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"points_a": np.full((2, 3), np.nan)}, "finite points"),
        ({"points_b": np.full((2, 3), np.inf)}, "finite points"),
        ({"sigma": 0.0}, "sigma"),
        ({"sigma": np.array([0.1, np.nan])}, "sigma"),
        ({"frame_pairs": np.array([[0, 0], [0, 1]])}, "two different frame"),
        ({"frame_pairs": np.array([[-1, 0], [0, 1]])}, "two different frame"),
    ],
)
def test_rows_that_cannot_be_are_refused(change, message):
    good = {
        "frame_pairs": np.array([[0, 1], [0, 2]]),
        "points_a": np.ones((2, 3)),
        "points_b": np.ones((2, 3)),
        "sigma": 0.02,
    }
    assert Matches.from_arrays(**good).n_matches == 2
    with pytest.raises(ScanError, match=message):
        Matches.from_arrays(**{**good, **change})
