"""Covariances against the dense inverse, and against the scatter of repeated solves."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import make_world
from planfit.errors import OptionError
from planfit.geometry import se3
from planfit.lsq.covariance import covariances, factorised
from planfit.lsq.normal_equations import NormalEquations
from planfit.lsq.pose_terms import PosePriorTerm
from planfit.lsq.solver import SolverOptions, solve


@pytest.fixture
def world(rng):
    return make_world(rng)


def test_blocks_are_those_of_the_dense_inverse(world):
    poses = world.plan_from_cams
    terms = [
        *world.scan_terms,
        PosePriorTerm(np.array([0]), poses[:1], np.full(6, 0.01)),
    ]
    quadratics = [t.reweight(poses)[0] for t in terms]
    equations = NormalEquations([q.normal_blocks(poses) for q in quadratics], len(poses))
    inverse = np.linalg.inv(equations.matrix.toarray())
    found = covariances(terms, poses, np.array([0, 5]))
    for k, i in enumerate((0, 5)):
        expected = inverse[6 * i : 6 * i + 6, 6 * i : 6 * i + 6]
        assert_allclose(found[k], expected, rtol=1e-5, atol=1e-12)


def test_scatter_of_poses_with_priors_is_what_covariances_say(rng):
    """Two priors that disagree at random: the pose between them scatters as predicted."""
    truth = np.eye(4)[None]
    sigma = np.array([0.01, 0.02, 0.03, 0.1, 0.2, 0.3])
    ends = []
    for _ in range(300):
        priors = se3.retract(np.tile(np.eye(4), (2, 1, 1)), rng.normal(size=(2, 6)) * sigma)
        terms = [PosePriorTerm(np.zeros(2, dtype=int), priors, sigma)]
        solution = solve(terms, truth, SolverOptions(cost_tolerance=1e-12))
        ends.append(se3.difference(solution.target_from_cams[0], truth[0]))
    predicted = covariances([PosePriorTerm(np.zeros(2, dtype=int), np.tile(truth, (2, 1, 1)), sigma)],
                            truth, np.array([0]))[0]  # fmt: skip
    assert_allclose(np.std(ends, axis=0), np.sqrt(np.diagonal(predicted)), rtol=0.15)


def test_a_pose_that_nothing_holds_is_named(world):
    poses = world.plan_from_cams
    pose_prior = PosePriorTerm(np.array([1]), poses[1:2], np.full(6, 0.01))
    with pytest.raises(OptionError, match="pose 3"):
        covariances([pose_prior], poses, np.array([3]))


def test_equations_that_hold_nothing_at_all_are_factorised_and_say_so(world):
    """Matches alone leave the whole free: singular, up to rounding that may be of either sign."""
    poses = world.plan_from_cams
    blocks = [
        t.reweight(poses)[0].normal_blocks(poses) for t in world.scan_terms if t.name == "points"
    ]
    assert blocks
    equations = NormalEquations(blocks, len(poses))
    factors = factorised(equations)
    assert np.diagonal(factors.inverse(np.arange(3, 6))).min() > 1e6
    held = NormalEquations([*blocks, prior_blocks(poses)], len(poses))
    found = factorised(held).inverse(np.arange(12, 18))
    expected = np.linalg.inv(held.matrix.toarray())[12:18, 12:18]
    assert_allclose(found, expected, rtol=1e-5, atol=1e-12)


def prior_blocks(poses):
    prior = PosePriorTerm(np.array([0]), poses[:1], np.full(6, 0.01))
    return prior.reweight(poses)[0].normal_blocks(poses)
