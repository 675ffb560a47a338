"""The part of the predicted error that other optima have."""

import numpy as np
import pytest

from planfit.adjust import Rival
from planfit.adjust.competition import RIVAL_COST
from planfit.geometry import se3
from planfit.pipeline.predicted_error import (
    brought_close,
    interpolated,
    larger_of,
    spread_of_rivals,
)


def aside(x_m, excess_cost, n=4):
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, 0, 3] = x_m
    return Rival(poses, excess_cost)


def sigma_x(*rivals):
    spread = spread_of_rivals(np.tile(np.eye(4), (4, 1, 1)), rivals)
    assert np.all(spread[:, 1:] == 0)
    return np.sqrt(spread[:, 0, 0])


def test_a_rival_that_costs_as_much_is_as_likely():
    assert sigma_x(aside(0.4, 0.0)) == pytest.approx(0.4 / np.sqrt(2))


def test_a_dear_rival_says_little():
    assert sigma_x(aside(0.4, 6 * RIVAL_COST)).max() < 0.02
    assert sigma_x().max() == 0


def test_several_rivals_in_one_place_are_no_worse_than_that_place():
    one, three = sigma_x(aside(0.4, 2.0)), sigma_x(*[aside(0.4, 2.0)] * 3)
    assert np.all((one < three) & (three < 0.4))


def test_positions_are_brought_close_by_one_rigid_motion(rng):
    positions = rng.normal(size=(10, 3))
    moved = se3.transform(se3.yaw_transform(30.0, np.array([1.0, 2.0, 0.0])), positions)
    np.testing.assert_allclose(brought_close(moved, positions), positions, atol=1e-9)


def test_the_larger_of_two_covariances_is_below_neither(rng):
    roots = 0.01 * rng.normal(size=(2, 5, 6, 6))
    one, other = (r @ np.swapaxes(r, 1, 2) for r in roots)
    other[:, :, :2] = other[:, :2] = 0.0  # of less than full rank, as of a few folds
    found = larger_of(one, other)
    for each in (one, other):
        assert np.linalg.eigvalsh(found - each).min() > -1e-12
    np.testing.assert_allclose(larger_of(one, 0.0 * other), one, atol=1e-15)
    np.testing.assert_allclose(larger_of(one, 4.0 * one), 4.0 * one, atol=1e-14)


def test_between_known_frames_covariances_are_interpolated():
    known = np.array([1.0, 3.0])[:, None, None] * np.eye(6)
    found = interpolated(known, np.arange(6), np.array([1, 3]))
    assert found[:, 0, 0].tolist() == [1.0, 1.0, 2.0, 3.0, 3.0, 3.0]
    assert not found[:, 0, 1].any()
