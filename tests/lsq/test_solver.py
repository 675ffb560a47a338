"""The solver: finds the truth, says why it stopped, never climbs, and leaves the unheld alone."""

from dataclasses import dataclass, replace
from unittest.mock import patch

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import least_squares

from builders import make_matches, make_world, nudged, position_rms_m, random_transforms
from planfit.adjust.terms.between import PointTerm
from planfit.adjust.terms.observation_models import POINTS
from planfit.geometry import se3
from planfit.lsq import solver
from planfit.lsq.blocks import NormalBlocks
from planfit.lsq.pose_terms import PosePriorTerm
from planfit.lsq.robust import Loss, LossKind
from planfit.lsq.solver import SolverOptions, Stop, solve

TIGHT = SolverOptions(max_iterations=200, cost_tolerance=1e-12)


def first_prior(poses, sigma=1e-3):
    return PosePriorTerm(np.array([0]), poses[:1], np.full(6, sigma))


@pytest.fixture
def world(rng):
    return make_world(rng)


@pytest.fixture
def points_and_prior(world):
    return [
        PointTerm(world.matches, POINTS),
        first_prior(world.plan_from_cams),
    ]


def test_finds_the_true_poses(world, points_and_prior, rng):
    start = nudged(rng, world.plan_from_cams, 3.0, 0.2)
    solution = solve(points_and_prior, start, TIGHT)
    assert_allclose(solution.target_from_cams, world.plan_from_cams, atol=1e-4)
    assert solution.cost_by_term["points"].after < 1e-6 < solution.cost_by_term["points"].before


def test_agrees_with_scipy(world, rng):
    # Noisy matches, so that the minimum is not at the truth.
    noisy = replace(
        world.matches,
        points_a=world.matches.points_a + rng.normal(0, 0.02, world.matches.points_a.shape),
    )
    options = replace(POINTS, loss=Loss(LossKind.SQUARED), max_observations=1e9)
    terms = [PointTerm(noisy, options), first_prior(world.plan_from_cams, 0.01)]
    start = nudged(rng, world.plan_from_cams, 1.0, 0.05)
    solution = solve(terms, start, TIGHT)
    pair = np.repeat(np.arange(len(noisy.pairs)), np.diff(noisy.start))
    i, j = noisy.pairs[pair].T

    def residuals(flat):
        poses = se3.retract(start, flat.reshape(-1, 6))
        a = se3.transform(poses[i], noisy.points_a[:, None])[:, 0]
        b = se3.transform(poses[j], noisy.points_b[:, None])[:, 0]
        gap = (a - b) / noisy.sigma[:, None]
        held = se3.difference(poses[0], world.plan_from_cams[0]) / 0.01
        return np.concatenate([gap.ravel(), held])

    other = least_squares(residuals, np.zeros(6 * len(start)), xtol=1e-12, ftol=1e-12, gtol=1e-12)
    total = sum(cost.after for cost in solution.cost_by_term.values())
    assert_allclose(total, other.cost, rtol=1e-6)
    expected = se3.retract(start, other.x.reshape(-1, 6))
    assert_allclose(solution.target_from_cams, expected, atol=1e-4)


def test_does_not_change_its_input(points_and_prior, world, rng):
    start = nudged(rng, world.plan_from_cams, 1.0, 0.1)
    copy = start.copy()
    solve(points_and_prior, start, SolverOptions())
    assert_array_equal(start, copy)


def test_same_input_same_output_bit_for_bit(points_and_prior, world, rng):
    start = nudged(rng, world.plan_from_cams, 1.0, 0.1)
    one, two = (solve(points_and_prior, start, SolverOptions()) for _ in range(2))
    assert_array_equal(one.target_from_cams, two.target_from_cams)


def test_stop_cost(points_and_prior, world, rng):
    solution = solve(points_and_prior, nudged(rng, world.plan_from_cams, 1.0, 0.1), SolverOptions())
    assert solution.stop is Stop.COST
    assert 1 < solution.iterations < SolverOptions().max_iterations


def test_stop_limit(points_and_prior, world, rng):
    start = nudged(rng, world.plan_from_cams, 5.0, 0.5)
    solution = solve(points_and_prior, start, SolverOptions(max_iterations=1))
    assert solution.stop is Stop.LIMIT
    assert solution.iterations == 1
    assert sum(c.after for c in solution.cost_by_term.values()) < sum(
        c.before for c in solution.cost_by_term.values()
    )


def test_nothing_to_gain_is_a_converged_cost(world):
    pose_prior = first_prior(world.plan_from_cams)
    solution = solve([pose_prior], world.plan_from_cams, SolverOptions())
    assert solution.stop is Stop.COST
    assert_array_equal(solution.target_from_cams, world.plan_from_cams)


class Uphill(PosePriorTerm):
    """A term whose gradient points the wrong way."""

    def normal_blocks(self, target_from_cams):
        right = super().normal_blocks(target_from_cams)
        return replace(right, gradient=-right.gradient)


def test_stop_stuck_where_no_step_helps(world, rng):
    start = nudged(rng, world.plan_from_cams, 5.0, 0.5)
    wrong = Uphill(np.arange(len(start)), world.plan_from_cams, np.ones(6))
    solution = solve([wrong], start, SolverOptions())
    assert solution.stop is Stop.STUCK
    assert_array_equal(solution.target_from_cams, start)


def test_a_wider_cost_tolerance_ends_sooner(points_and_prior, world, rng):
    noise = rng.standard_t(1.5, world.matches.points_a.shape) * 0.05
    noisy = replace(world.matches, points_a=world.matches.points_a + noise)
    terms = [PointTerm(noisy, POINTS), points_and_prior[1]]
    wide, usual, tight = (
        solve(terms, world.plan_from_cams, SolverOptions(cost_tolerance=tolerance))
        for tolerance in (0.05, 1e-4, 1e-7)
    )
    assert wide.iterations < usual.iterations < tight.iterations


def test_more_steps_a_reweighting_go_further_in_one_round(points_and_prior, world, rng):
    start = nudged(rng, world.plan_from_cams, 10.0, 0.5)

    def after(steps):
        with patch.object(solver, "STEPS_PER_REWEIGHTING", steps):
            solution = solve(points_and_prior, start, SolverOptions(max_iterations=1))
        return solution.cost_by_term["points"].after

    assert after(4) < after(1)


def test_initial_damping_shortens_the_first_step(points_and_prior, world, rng):
    start = nudged(rng, world.plan_from_cams, 1.0, 0.1)

    def moved_m(damping):
        with patch.multiple(solver, STEPS_PER_REWEIGHTING=1, INITIAL_DAMPING=damping):
            solution = solve(points_and_prior, start, SolverOptions(max_iterations=1))
        return position_rms_m(solution.target_from_cams, start)

    assert moved_m(100.0) < 0.5 * moved_m(1e-6)


@pytest.mark.parametrize("rotation_deg", [1.0, 10.0, 60.0])
def test_never_raises_the_cost(world, rotation_deg, rng):
    poses = nudged(rng, world.plan_from_cams, rotation_deg, rotation_deg / 20)
    terms = [
        *world.scan_terms,
        first_prior(world.plan_from_cams),
    ]
    total = np.inf
    for _ in range(12):
        solution = solve(terms, poses, SolverOptions(max_iterations=1))
        before = sum(c.before for c in solution.cost_by_term.values())
        after = sum(c.after for c in solution.cost_by_term.values())
        assert after <= before * (1 + 1e-12) + 1e-20  # rounding, where nothing is left
        assert after <= total * (1 + 1e-12) + 1e-20
        total, poses = after, solution.target_from_cams


def test_reports_the_cost_of_every_term(world, rng):
    start = nudged(rng, world.plan_from_cams, 1.0, 0.1)
    terms = [
        *world.scan_terms,
        first_prior(world.plan_from_cams),
    ]
    solution = solve(terms, start, SolverOptions())
    assert set(solution.cost_by_term) == {"points", "floor", "odometry", "pose prior"}
    for term in terms:
        cost = solution.cost_by_term[term.name]
        assert_allclose(cost.before, term.reweight(start)[1])
        assert_allclose(cost.after, term.reweight(solution.target_from_cams)[1])


@pytest.mark.parametrize("kind", [LossKind.CAUCHY, LossKind.GEMAN_MCCLURE])
def test_resists_outliers_where_squares_do_not(world, kind, rng):
    # A third of the matches of every pair are off by a metre in one direction.
    points_a = world.matches.points_a.copy()
    wrong = np.arange(len(points_a)) % 3 == 0
    points_a[wrong] += [1.0, 0.0, 0.0]
    bad = replace(world.matches, points_a=points_a)
    start = nudged(rng, world.plan_from_cams, 0.5, 0.05)

    def error_m(loss):
        term = PointTerm(bad, replace(POINTS, loss=loss))
        solution = solve([term, first_prior(world.plan_from_cams)], start, TIGHT)
        return position_rms_m(solution.target_from_cams, world.plan_from_cams)

    assert error_m(Loss(kind, 2.0)) < 0.02
    assert error_m(Loss(LossKind.SQUARED)) > 0.2


def test_the_prior_holds_the_gauge(world, rng):
    start = random_transforms(rng, 1)[0] @ nudged(rng, world.plan_from_cams, 1.0, 0.05)
    terms = [PointTerm(world.matches, POINTS), first_prior(start, 1e-6)]
    solution = solve(terms, start, TIGHT)
    assert_allclose(solution.target_from_cams[0], start[0], atol=1e-5)
    move = start[0] @ se3.inverse(world.plan_from_cams[0])
    assert_allclose(solution.target_from_cams, move @ world.plan_from_cams, atol=1e-3)


def test_a_free_gauge_is_solved_too(world, rng):
    start = nudged(rng, world.plan_from_cams, 1.0, 0.05)
    solution = solve([PointTerm(world.matches, POINTS)], start, TIGHT)
    assert solution.cost_by_term["points"].after < 1e-6
    assert position_rms_m(solution.target_from_cams, start) < 0.3


def test_poses_that_nothing_holds_do_not_move(world, rng):
    start = nudged(rng, world.plan_from_cams, 1.0, 0.1)
    points = rng.uniform(0, 4, (20, 3))
    some = make_matches(world.plan_from_cams, [(0, 1), (1, 2)], points)
    terms = [PointTerm(some, POINTS), first_prior(world.plan_from_cams)]
    solution = solve(terms, start, TIGHT)
    assert_array_equal(solution.target_from_cams[3:], start[3:])
    assert_allclose(solution.target_from_cams[:3], world.plan_from_cams[:3], atol=1e-4)


def test_rotations_stay_rotations(points_and_prior, world, rng):
    start = nudged(rng, world.plan_from_cams, 10.0, 0.5)
    rotation = solve(points_and_prior, start, TIGHT).target_from_cams[:, :3, :3]
    assert_allclose(
        np.swapaxes(rotation, 1, 2) @ rotation, np.tile(np.eye(3), (8, 1, 1)), atol=1e-12
    )


@dataclass(frozen=True)
class UphillTerm:
    """A term whose gradient points the wrong way, so that no step ever helps."""

    name: str = "uphill"

    def reweight(self, target_from_cams):
        return self, self.cost(target_from_cams)

    def cost(self, target_from_cams):
        return float(np.exp(target_from_cams[0, 0, 3]))

    def normal_blocks(self, target_from_cams):
        gradient = np.zeros((len(target_from_cams), 6))
        gradient[0, 3] = -1.0
        idx = np.arange(len(target_from_cams))
        return NormalBlocks(idx, idx, np.tile(np.eye(6), (len(idx), 1, 1)), gradient)


def test_a_wrong_gradient_ends_stuck_and_not_worse(world):
    solution = solve([UphillTerm()], world.plan_from_cams, SolverOptions())
    assert solution.stop is Stop.STUCK
    assert_array_equal(solution.target_from_cams, world.plan_from_cams)
