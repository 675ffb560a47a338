"""Points of groups, some at a time: every point once, with its group."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from planfit.geometry.se3 import groups_in_parts, points_in_parts


@pytest.mark.parametrize("at_a_time", [1, 4, 100])
@pytest.mark.parametrize("sizes", [[3, 0, 0, 5, 1], [0, 2], [2, 0], [0], []])
def test_every_point_comes_once_with_its_group(monkeypatch, at_a_time, sizes):
    monkeypatch.setattr("planfit.geometry.se3.POINTS_AT_A_TIME", at_a_time)
    start = np.cumsum([0, *sizes])
    points, groups = [np.zeros(0, int)], [np.zeros(0, int)]
    for part, group in points_in_parts(start):
        assert len(group) == part.stop - part.start <= at_a_time
        points.append(np.arange(part.start, part.stop))
        groups.append(group)
    assert_array_equal(np.concatenate(points), np.arange(start[-1]))
    assert_array_equal(np.concatenate(groups), np.repeat(np.arange(len(sizes)), sizes))


@pytest.mark.parametrize("at_a_time", [1, 4, 100])
@pytest.mark.parametrize("sizes", [[3, 0, 0, 5, 1], [0, 2], [2, 0], [0], [], [9, 9]])
def test_whole_groups_come_once_and_no_more_points_than_one_group_or_a_part_has(
    monkeypatch, at_a_time, sizes
):
    monkeypatch.setattr("planfit.geometry.se3.POINTS_AT_A_TIME", at_a_time)
    start = np.cumsum([0, *sizes])
    parts = list(groups_in_parts(start))
    every = [np.arange(len(sizes))[part] for part in parts]
    assert_array_equal(np.concatenate([np.zeros(0, int), *every]), np.arange(len(sizes)))
    for part in parts:
        n_points = start[part.stop] - start[part.start]
        assert part.stop - part.start == 1 or n_points <= at_a_time
