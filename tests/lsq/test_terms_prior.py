"""Pose priors: which pose, which directions, several of one pose."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import gradient_by_differences, nudged, random_transforms
from planfit.geometry import se3
from planfit.lsq import PosePriorTerm


@pytest.fixture
def poses(rng):
    return random_transforms(rng, 5)


def test_moving_poses_and_priors_together_changes_no_cost(poses, rng):
    term = PosePriorTerm(np.array([0, 3]), poses[[0, 3]], np.full(6, 0.1))
    at = nudged(rng, poses, 1.0, 0.05)
    move = random_transforms(rng, 1)[0]
    moved = replace(term, target_from_priors=move @ term.target_from_priors)
    assert_allclose(moved.reweight(move @ at)[1], term.reweight(at)[1], rtol=1e-9)


def test_an_infinite_sigma_leaves_a_direction_free(poses):
    sigma = np.array([np.inf, np.inf, 0.1, 0.1, 0.1, np.inf])
    term = PosePriorTerm(np.array([2]), poses[2:3], sigma)
    for axis, costs in enumerate([False, False, True, True, True, False]):
        delta = np.zeros((len(poses), 6))
        delta[2, axis] = 0.3
        cost = term.cost(se3.retract(poses, delta))
        assert_allclose(cost, 0.5 * 9.0 if costs else 0.0, atol=1e-12)


def test_a_prior_acts_on_its_own_pose_only(poses):
    term = PosePriorTerm(np.array([2]), poses[2:3], np.full(6, 0.1))
    moved = poses.copy()
    moved[:, 0, 3] += 0.1
    gradient = term.normal_blocks(moved).gradient
    assert_allclose(gradient[2], [0, 0, 0, 10.0, 0, 0], atol=1e-9)
    assert_array_equal(np.delete(gradient, 2, axis=0), 0.0)


def test_two_priors_of_one_pose_add_up(poses):
    there = poses[[2, 2]].copy()
    there[0, 0, 3] += 0.1
    there[1, 0, 3] += 0.3
    term = PosePriorTerm(np.array([2, 2]), there, np.full(6, 0.1))
    expected = gradient_by_differences(term.cost, poses)
    gradient = term.normal_blocks(poses).gradient
    assert_allclose(gradient, expected, atol=1e-4)
