"""A problem: what it refuses, GNC, covariances on demand."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import nudged, position_rms_m, random_transforms
from lsq.pose_graphs import sphere
from planfit.errors import OptionError
from planfit.geometry import se3
from planfit.lsq import (
    BetweenTerm,
    Loss,
    LossKind,
    PosePriorTerm,
    Problem,
    ResidualTerm,
    SolverOptions,
)
from planfit.lsq.solver import solve


@pytest.fixture
def problem(rng):
    graph, true_poses = sphere(rng)
    between = BetweenTerm(graph.pairs, graph.first_from_second, information=graph.information)
    prior = PosePriorTerm(np.array([0]), true_poses[:1], np.full(6, 0.01))
    return Problem([prior, between], graph.target_from_cams)


def test_a_pose_that_is_not_there_is_named(problem):
    n = len(problem.initial_target_from_cams)
    term = ResidualTerm(np.array([[0], [n]]), lambda at: at[:, 0, :3, 3], name="heights")
    with pytest.raises(OptionError, match=rf"'heights': expected indices of {n} poses.*found {n}"):
        Problem([term], problem.initial_target_from_cams)


def test_poses_that_are_not_finite_are_refused(problem):
    poses = problem.initial_target_from_cams.copy()
    poses[3, 0, 3] = np.nan
    with pytest.raises(OptionError, match="expected finite initial poses"):
        Problem(problem.terms, poses)


def test_two_terms_of_one_name_are_refused(problem):
    with pytest.raises(OptionError, match=r"a name of its own for each term, found \['between'\]"):
        Problem([*problem.terms, problem.terms[1]], problem.initial_target_from_cams)


def test_residuals_that_are_not_finite_are_named(problem):
    term = ResidualTerm(np.array([[0]]), lambda _: np.full((1, 1), np.nan), name="mine")
    with pytest.raises(OptionError, match=r"'mine': expected a finite cost.*found nan"):
        Problem([term], problem.initial_target_from_cams).solve()


def test_cost_is_the_sum_over_terms(problem, rng):
    poses = nudged(rng, problem.initial_target_from_cams, 1.0, 0.1)
    expected = sum(term.reweight(poses)[1] for term in problem.terms)
    assert_allclose(problem.cost(poses), expected)


def test_covariances_are_those_of_the_prior_where_it_alone_holds(problem):
    solution = problem.solve()
    covariances = problem.covariances(solution.target_from_cams, [0, 5])
    sigma = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    assert_allclose(sigma[0], 0.01, rtol=0.2)
    assert np.all(sigma[1] > sigma[0])


def robust_problem(rng):
    """One pose, thirty priors at a place and twenty elsewhere, begun at the wrong ones."""
    places = np.concatenate([rng.normal(0, 0.01, (30, 3)), rng.normal(5, 0.01, (20, 3))])
    term = ResidualTerm(
        np.zeros((50, 1), dtype=int),
        lambda at: at[:, 0, :3, 3] - places,
        sigma=0.1,
        loss=Loss(LossKind.GEMAN_MCCLURE, 3.0),
    )
    return Problem([term], se3.make_transform(np.eye(3)[None], np.full((1, 3), 5.0)))


def test_gnc_leaves_a_minimum_that_is_not_the_best(rng):
    problem = robust_problem(rng)
    stuck = problem.solve()
    assert np.abs(stuck.target_from_cams[0, :3, 3]).max() > 4.9
    found = problem.solve_gnc((100.0, 30.0, 10.0, 3.0, 1.0))
    assert_allclose(found.target_from_cams[0, :3, 3], 0.0, atol=0.01)
    assert problem.cost(found.target_from_cams) < problem.cost(stuck.target_from_cams)


def test_gnc_of_one_factor_is_a_plain_solve(problem):
    one, other = problem.solve_gnc((1.0,)), problem.solve()
    assert_array_equal(one.target_from_cams, other.target_from_cams)


def test_gnc_is_solves_of_wider_losses_one_after_the_other(rng):
    problem = robust_problem(rng)
    poses = problem.initial_target_from_cams
    for factor in (20.0, 5.0):
        wide = [problem.terms[0].with_wider_loss(factor)]
        poses = solve(wide, poses, SolverOptions()).target_from_cams
    assert_array_equal(problem.solve_gnc((20.0, 5.0)).target_from_cams, poses)


@pytest.mark.parametrize("schedule", [(), (2.0, 0.0)])
def test_a_schedule_that_cannot_work_is_refused(problem, schedule):
    with pytest.raises(OptionError, match="GNC schedule of factors above 0"):
        problem.solve_gnc(schedule)


def test_the_gauge_may_be_moved(problem, rng):
    """The same graph elsewhere in the world is solved to the same shape."""
    move = random_transforms(rng, 1)[0]
    prior, between = problem.terms
    there = PosePriorTerm(np.array([0]), move @ prior.target_from_priors, prior.sigma)
    moved = Problem([there, between], move @ problem.initial_target_from_cams)
    options = SolverOptions(200, cost_tolerance=1e-13)
    one, other = problem.solve(options), moved.solve(options)
    assert position_rms_m(move @ one.target_from_cams, other.target_from_cams) < 1e-5
