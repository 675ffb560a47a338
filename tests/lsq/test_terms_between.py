"""Relative poses that were measured: Jacobians, charts, information, and pose graphs solved with them."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import logm

from builders import nudged, position_rms_m, random_transforms
from lsq.pose_graphs import sphere
from planfit.geometry import se3
from planfit.lsq import BetweenTerm, Loss, LossKind, PosePriorTerm, Problem, SolverOptions
from planfit.lsq.residual_term import jacobian_by_differences

CHARTS = ["so3xr3", "se3"]
PAIRS = np.array([[0, 1], [2, 1], [3, 0], [2, 3]])


def make_term(rng, poses, rotation=0.3, **fields):
    """Measurements that are off by up to `rotation` rad and 0.5 m."""
    exact = se3.inverse(poses[PAIRS[:, 0]]) @ poses[PAIRS[:, 1]]
    measured = exact @ random_transforms(rng, len(PAIRS), rotation, 0.5)
    return BetweenTerm(PAIRS, measured, **fields)


@pytest.fixture
def poses(rng):
    return random_transforms(rng, 4)


@pytest.mark.parametrize("chart", CHARTS)
@pytest.mark.parametrize("rotation", [0.0, 1e-9, 1e-3, 0.099, 0.101, 1.0, 3.0])
def test_jacobian_meets_finite_differences(chart, rotation, poses, rng):
    term = make_term(rng, poses, rotation, chart=chart)
    at = poses[PAIRS]
    assert_allclose(term.jacobian(at), jacobian_by_differences(term.residual, at), atol=2e-8)


def test_se3_is_the_matrix_logarithm(poses, rng):
    term = make_term(rng, poses, 2.0, chart="se3")
    residual = term.residual(poses[PAIRS])
    for k, (i, j) in enumerate(PAIRS):
        error = se3.inverse(term.first_from_second[k]) @ se3.inverse(poses[i]) @ poses[j]
        log = np.real(logm(error))
        assert_allclose(residual[k, 3:], log[:3, 3], atol=1e-9)
        assert_allclose(se3.skew(residual[k, :3]), log[:3, :3], atol=1e-9)


def test_charts_agree_to_first_order(poses, rng):
    one, other = (
        make_term(np.random.default_rng(1), poses, 1e-4, chart=chart).residual(poses[PAIRS])
        for chart in CHARTS
    )
    assert_allclose(one, other, atol=1e-4)
    assert np.abs(one[:, 3:]).max() > 0.1


@pytest.mark.parametrize("chart", CHARTS)
def test_zero_where_it_was_measured(chart, poses):
    exact = se3.inverse(poses[PAIRS[:, 0]]) @ poses[PAIRS[:, 1]]
    assert_allclose(BetweenTerm(PAIRS, exact, chart=chart).residual(poses[PAIRS]), 0.0, atol=1e-12)


@pytest.mark.parametrize("chart", CHARTS)
def test_moving_the_world_changes_nothing(chart, poses, rng):
    term = make_term(rng, poses, chart=chart, loss=Loss(LossKind.CAUCHY, 1.0))
    moved = random_transforms(rng, 1)[0] @ poses
    assert_allclose(term.reweight(moved)[1], term.reweight(poses)[1], rtol=1e-9)


def test_information_of_sigmas_is_their_inverse_square(poses, rng):
    sigma = rng.uniform(0.1, 1.0, (len(PAIRS), 6))
    term = make_term(rng, poses, sigma=sigma, loss=Loss(LossKind.HUBER, 0.5))
    full = replace(term, sigma=None, information=sigma[:, :, None] ** -2.0 * np.eye(6))
    (one, cost), (other, same) = term.reweight(poses), full.reweight(poses)
    assert_allclose(cost, same)
    at = nudged(rng, poses, 1.0, 0.1)
    assert_allclose(one.cost(at), other.cost(at))
    a, b = one.normal_blocks(at), other.normal_blocks(at)
    assert_allclose(a.blocks, b.blocks, atol=1e-9 * np.abs(a.blocks).max())
    assert_allclose(a.gradient, b.gradient, atol=1e-9 * np.abs(a.gradient).max())


@pytest.mark.parametrize("chart", CHARTS)
def test_a_noisy_sphere_is_drawn_together(chart, rng):
    graph, true_poses = sphere(rng)
    between = BetweenTerm(
        graph.pairs, graph.first_from_second, information=graph.information, chart=chart
    )
    prior = PosePriorTerm(np.array([0]), true_poses[:1], np.full(6, 0.01))
    solution = Problem([prior, between], graph.target_from_cams).solve()
    assert solution.cost_by_term["between"].after < 0.1 * solution.cost_by_term["between"].before
    # Six numbers an edge, less six a pose: the cost of the right noise at the minimum.
    freedom = 6 * (len(graph.pairs) - len(true_poses) + 1)
    assert_allclose(2 * solution.cost_by_term["between"].after / freedom, 1.0, atol=0.2)


def test_a_wrong_loop_closure_is_let_go(rng):
    graph, true_poses = sphere(rng, sigma=(0.005, 0.02))
    wrong = np.array([[3, 60]])
    pairs = np.concatenate([graph.pairs, wrong])
    measured = np.concatenate([graph.first_from_second, np.eye(4)[None]])
    information = np.concatenate([graph.information, graph.information[:1]])
    prior = PosePriorTerm(np.array([0]), true_poses[:1], np.full(6, 0.01))

    def error_m(loss):
        term = BetweenTerm(pairs, measured, information=information, loss=loss)
        problem = Problem([prior, term], graph.target_from_cams)
        solution = problem.solve_gnc((100.0, 30.0, 10.0, 3.0, 1.0), SolverOptions(200))
        return position_rms_m(solution.target_from_cams, true_poses)

    assert error_m(Loss(LossKind.GEMAN_MCCLURE, 4.0)) < 0.15
    assert error_m(Loss(LossKind.SQUARED)) > 0.3
