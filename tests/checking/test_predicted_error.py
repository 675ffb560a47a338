"""The part of the predicted error that other optima have."""

import numpy as np
import pytest

from faulty_sensors import make_sensor_world
from planfit.adjust import Rival
from planfit.adjust.competition import RIVAL_COST
from planfit.geometry import se3
from planfit.lsq.covariance import blocks_of_inverse
from planfit.lsq.normal_equations import NormalEquations
from planfit.pipeline.predicted_error import (
    StatedCovariances,
    brought_close,
    frames_compared,
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


def along_x(*moved_m):
    """Moves of three frames by one fold."""
    moves = np.zeros((1, 3, 6))
    moves[0, :, 3] = moved_m
    return moves


def test_a_fold_counts_where_it_moves_a_frame_by_more_than_it_should():
    whole = np.tile(0.01**2 * np.eye(6), (2, 1, 1))
    alone = np.array([[0.1**2 * np.eye(6), 0.01**2 * np.eye(6)]])  # the last frame misses nothing
    stated = StatedCovariances(np.array([0, 2]), whole, alone)
    own = np.tile(0.01**2 * np.eye(6), (3, 1, 1))
    # Positions should move by sqrt(3 (0.1^2 - 0.01^2)) = 0.172 m at the first frame, half its square between.
    below, above = 0.98 * 3 * 0.1724, 1.02 * 3 * 0.1724
    half = np.sqrt(0.5)
    assert stated.are_exceeded(along_x(below, half * below, 0.0), own).tolist() == [[False] * 3]
    assert stated.are_exceeded(along_x(above, half * above, 0.001), own).tolist() == [[True] * 3]
    # Residuals twice as large as stated: so are moves.
    found = stated.are_exceeded(along_x(above, 2.0 * half * above, 0.0), 4.0 * own)
    assert found.tolist() == [[False, True, False]]


def test_stated_covariances_are_blocks_of_the_inverse(rng):
    problem = make_sensor_world(rng, n=8).problem()
    poses = problem.unknowns
    parts = [term.reweight(poses)[0].normal_blocks(poses) for term in problem.terms]
    inverse = np.linalg.inv(NormalEquations(parts, len(poses)).matrix.toarray())
    frames = np.array([0, 3, 7])
    expected = [inverse[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] for k in frames]
    found = blocks_of_inverse(problem.terms, poses, frames)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-12)


def test_frames_compared_are_the_middles_of_stretches_and_both_ends():
    assert frames_compared(np.repeat([0, 1, 2], [3, 2, 5])).tolist() == [0, 1, 4, 7, 9]
    assert frames_compared(np.arange(3)).tolist() == [0, 1, 2]
