"""IBA: geometry never beyond its bound, at any iterate, whatever the other terms want."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import gradient_by_differences, make_world, nudged, room_plan
from facing import drifted, facing_cameras, facing_matches, facing_poses, with_noise, with_outliers
from planfit.adjust.association import AssociationOptions, associate
from planfit.adjust.terms.between import PointTerm
from planfit.adjust.terms.levels import floor_term
from planfit.adjust.terms.observation_models import FLOOR, POINTS, REPROJECTION, WALLS
from planfit.adjust.terms.reprojection import ReprojectionTerm
from planfit.adjust.terms.walls import WallTerm
from planfit.errors import OptionError
from planfit.lsq import bounded, problem, solver
from planfit.lsq.bounded import Allowance, BarrierTerm, growth_power, solve_bounded
from planfit.lsq.normal_equations import NormalEquations
from planfit.lsq.pose_terms import PosePriorTerm
from planfit.lsq.robust import Loss, LossKind
from planfit.lsq.solver import SolverOptions, Stop, solve
from planfit.lsq.term import robust_cost

QUICK = SolverOptions(max_iterations=30)


def disagreeing(world, weight=1.0):
    """Floor and walls of a plan that is 0.4 m wider and 0.2 m deeper than the room is."""
    poses, structure = world.plan_from_cams, world.structure
    association = associate(structure.walls, world.floorplan, poses, 0.5, AssociationOptions())
    options = replace(
        WALLS, weight=weight, sigma=0.05, loss=Loss(LossKind.CAUCHY, 2.0), max_observations=4.0
    )
    walls = WallTerm(structure.walls, room_plan(6.4, 4.2), association, options)
    return [floor_term(structure, FLOOR), walls]


def noisy_points(world, rng, loss=None, outliers=0.1):
    matches = with_outliers(rng, with_noise(rng, world.matches), outliers)
    return PointTerm(matches, replace(POINTS, loss=loss) if loss else POINTS)


@pytest.fixture
def accepted(monkeypatch):
    """Poses that the second round's solver accepted, one round at a time."""
    path = []

    def solve_and_record(terms, poses, options):
        if not any(isinstance(term, BarrierTerm) for term in terms):
            return solve(terms, poses, options)
        # One step a round, one round a solve: every accepted iterate comes by.
        one = SolverOptions(1, options.cost_tolerance)
        with patch.object(solver, "STEPS_PER_REWEIGHTING", 1):
            for _ in range(2 * options.max_iterations):
                path.append(poses)
                poses = solve(terms, poses, one).target_from_cams
            path.append(poses)
            return solve(terms, poses, one)

    monkeypatch.setattr(problem, "solve", solve_and_record)
    return path


LOSSES = [
    Loss(LossKind.SQUARED),
    Loss(LossKind.CAUCHY, 2.0),
    Loss(LossKind.GEMAN_MCCLURE, 2.0),
    Loss(LossKind.NORM, 1e-3),
]


@pytest.mark.parametrize("loss", LOSSES, ids=lambda loss: loss.kind.name)
@pytest.mark.parametrize(
    ("weight", "share"),
    [
        (1.0, 0.1),
        pytest.param(30.0, 1e-3, marks=pytest.mark.slow),
        pytest.param(1000.0, 1e-6, marks=pytest.mark.slow),
    ],
)
def test_point_error_never_exceeds_the_bound_at_any_iterate(accepted, loss, weight, share, rng):
    world = make_world(rng)
    points = noisy_points(world, rng, loss)
    start = nudged(rng, world.plan_from_cams, 0.5, 0.1)
    with patch.object(bounded, "BARRIER_SHARE", share):
        others = disagreeing(world, weight)
        result = solve_bounded([points], others, start, Allowance(), QUICK)
    costs = [robust_cost([points], poses) for poses in accepted]
    assert len(costs) > 10
    assert max(costs) < result.bound
    assert max(costs) > costs[0]  # the others do use the room there is


@pytest.mark.parametrize("seed", range(3))
def test_reprojection_never_exceeds_the_bound_at_any_iterate(accepted, seed):
    rng = np.random.default_rng(seed)
    poses = facing_poses()
    matches = with_outliers(rng, with_noise(rng, facing_matches(rng, poses), 0.005), 0.1)
    term = ReprojectionTerm(matches, facing_cameras(len(poses)), REPROJECTION)
    # Priors where the poses are not.
    wrong = PosePriorTerm(np.arange(len(poses)), nudged(rng, poses, 3.0, 0.2), np.full(6, 0.02))
    start = drifted(rng, poses)
    result = solve_bounded([term], [wrong], start, Allowance(), QUICK)
    costs = [robust_cost([term], at) for at in accepted]
    assert max(costs) < result.bound
    assert result.bounded_cost.after > result.bounded_cost.before
    assert wrong.cost(accepted[-1]) < wrong.cost(accepted[0])


def start_of(result):
    """Where the second round began: the minimum of the bounded terms."""
    return result.alone.target_from_cams


def cost_of_larger_residuals(term, poses, factor):
    """Residual by residual: the cost of a points term, were all its residuals `factor` times as large."""
    matches, model, total = term.matches, term.model, 0.0
    for k, (i, j) in enumerate(matches.pairs):
        n = matches.start[k + 1] - matches.start[k]
        for row in range(matches.start[k], matches.start[k + 1]):
            a = poses[i, :3, :3] @ matches.points_a[row] + poses[i, :3, 3]
            b = poses[j, :3, :3] @ matches.points_b[row] + poses[j, :3, 3]
            r = factor * np.linalg.norm(a - b) / matches.sigma[row]
            c = model.loss.scale
            rho = {
                LossKind.SQUARED: r**2,
                LossKind.HUBER: r**2 if r < c else 2 * c * r - c**2,
                LossKind.CAUCHY: c**2 * np.log1p((r / c) ** 2),
                LossKind.NORM: 2 * (np.hypot(r, c) - c),
            }[model.loss.kind]
            total += 0.5 * model.weight * min(n, model.max_observations) / n * rho
    return total


@pytest.mark.parametrize(
    "loss",
    [
        Loss(LossKind.SQUARED),
        Loss(LossKind.HUBER, 1.0),
        Loss(LossKind.CAUCHY, 2.0),
        Loss(LossKind.NORM, 1e-6),
    ],
    ids=lambda loss: loss.kind.name,
)
def test_the_bound_is_the_cost_of_residuals_a_twentieth_larger(loss, rng):
    world = make_world(rng)
    points, others = noisy_points(world, rng, loss), disagreeing(world)
    start = nudged(rng, world.plan_from_cams, 0.5, 0.1)
    result = solve_bounded([points], others, start, Allowance(slack=1e-9), QUICK)
    least = cost_of_larger_residuals(points, start_of(result), 1.0)
    larger = cost_of_larger_residuals(points, start_of(result), 1.05)
    assert_allclose(result.bounded_cost.before, least, rtol=1e-4)
    # The power of the growth is taken at the minimum; the loss bends a little within a twentieth.
    assert_allclose(result.bound - least, larger - least, rtol=0.05)
    growth = {LossKind.SQUARED: 1.05**2, LossKind.NORM: 1.05}.get(loss.kind)
    if growth is not None:
        assert_allclose(result.bound, growth * least, rtol=1e-4)
    else:
        assert least < result.bound < 1.05**2 * least


def test_terms_without_any_cost_grow_as_squares(rng):
    world = make_world(rng)
    assert (
        growth_power(
            [floor_term(world.structure, replace(FLOOR, weight=0.0))], world.plan_from_cams
        )
        == 2
    )


def test_without_the_bound_the_same_terms_exceed_it(rng):
    world = make_world(rng)
    points, others = noisy_points(world, rng), disagreeing(world, 30.0)
    start = nudged(rng, world.plan_from_cams, 0.5, 0.1)
    result = solve_bounded([points], others, start, Allowance(), QUICK)
    free = solve([points, *others], start, QUICK)
    assert free.cost_by_term["points"].after > 1.5 * result.bound


def test_reports_bound_and_both_rounds(rng):
    world = make_world(rng)
    points, others = noisy_points(world, rng), disagreeing(world)
    start = nudged(rng, world.plan_from_cams, 0.5, 0.1)
    options = Allowance(error_factor=1.1, slack=0.5)
    result = solve_bounded([points], others, start, options, QUICK)
    alone = solve([points], start, QUICK)
    assert_array_equal(result.alone.target_from_cams, alone.target_from_cams)
    least = alone.cost_by_term["points"].after
    assert_allclose(result.bounded_cost.before, least)
    assert_allclose(result.bound, 1.1 ** growth_power([points], start_of(result)) * least + 0.5)
    assert set(result.solution.cost_by_term) == {"floor", "walls", "barrier"}
    after = robust_cost([points], result.solution.target_from_cams)
    assert_allclose(result.bounded_cost.after, after)
    assert result.solution.stop is Stop.COST
    total = [
        sum(getattr(c, at) for c in result.solution.cost_by_term.values())
        for at in ("before", "after")
    ]
    assert total[1] < total[0]


def test_exact_matches_leave_the_slack_to_reach_the_plan(rng):
    # The true plan: geometry and plan agree, so the gauge is found without any geometric error.
    world = make_world(rng)
    association = associate(
        world.structure.walls, world.floorplan, world.plan_from_cams, 0.5, AssociationOptions()
    )
    walls = WallTerm(world.structure.walls, world.floorplan, association, WALLS)
    others = [floor_term(world.structure, FLOOR), walls]
    points = PointTerm(world.matches, POINTS)
    start = nudged(rng, world.plan_from_cams, 1.0, 0.05)
    tight = SolverOptions(max_iterations=200, cost_tolerance=1e-10)
    with patch.object(bounded, "BARRIER_SHARE", 1e-3):
        result = solve_bounded([points], others, start, Allowance(), tight)
    assert result.bounded_cost.after < result.bound < 2e-3
    assert_allclose(result.solution.target_from_cams, world.plan_from_cams, atol=5e-3)


def test_a_larger_factor_gives_the_others_more(rng):
    world = make_world(rng)
    points, others = noisy_points(world, rng), disagreeing(world, 30.0)
    start = nudged(rng, world.plan_from_cams, 0.5, 0.1)
    results = [
        solve_bounded([points], others, start, Allowance(error_factor=factor), QUICK)
        for factor in (1.01, 1.05, 1.3)
    ]
    walls = [r.solution.cost_by_term["walls"].after for r in results]
    assert walls == sorted(walls, reverse=True)
    assert walls[0] > 1.1 * walls[-1]


def test_a_smaller_barrier_comes_closer_to_the_bound(rng):
    world = make_world(rng)
    points, others = noisy_points(world, rng), disagreeing(world, 30.0)
    start = nudged(rng, world.plan_from_cams, 0.5, 0.1)
    used = []
    for share in (1.0, 0.1, 0.01):
        with patch.object(bounded, "BARRIER_SHARE", share):
            result = solve_bounded([points], others, start, Allowance(), QUICK)
        cost = result.bounded_cost
        used.append((cost.after - cost.before) / (result.bound - cost.before))
    assert used == sorted(used)
    assert used[-1] > 0.5


def make_barrier(points, poses, room):
    least = robust_cost([points], poses)
    return BarrierTerm((points,), least, least + room, 3.0)


def test_barrier_gradient_meets_finite_differences(rng):
    world = make_world(rng)
    points = noisy_points(world, rng)
    at = nudged(rng, world.plan_from_cams, 0.2, 0.01)
    barrier = make_barrier(points, at, 20.0)
    expected = gradient_by_differences(barrier.cost, at)
    gradient = barrier.normal_blocks(at).gradient
    assert_allclose(gradient, expected, atol=1e-4 * np.abs(expected).max())


def test_barrier_hessian_bounds_the_curvature_from_above(rng):
    # Squares, so that geometry is nearly a parabola, and from its minimum.
    world = make_world(rng)
    points = noisy_points(world, rng, LOSSES[0], outliers=0.0)
    least = solve([points], world.plan_from_cams, SolverOptions(200, cost_tolerance=1e-12))
    barrier = make_barrier(points, least.target_from_cams, 10.0)
    at = nudged(rng, least.target_from_cams, 0.02, 0.001)
    assert robust_cost([points], at) - barrier.least > 1.0
    blocks = barrier.normal_blocks(at)
    hessian = NormalEquations([blocks], len(at)).matrix.toarray()
    quadratic, cost = points.reweight(at)
    room = barrier.bound - cost
    inner = quadratic.normal_blocks(at)
    gradient = inner.gradient.ravel()
    plain = 3.0 / room**2 * NormalEquations([inner], len(at)).matrix.toarray()
    exact = plain + 6.0 / room**3 * np.outer(gradient, gradient)
    rounding = 2e-4 * np.abs(hessian).max()  # points turn: not quite a parabola
    assert np.linalg.eigvalsh(hessian - exact).min() > -rounding
    assert np.linalg.eigvalsh(plain - exact).min() < -100 * rounding
    assert np.linalg.eigvalsh(hessian).min() > -1e-9 * np.abs(hessian).max()


def test_barrier_is_infinite_at_and_beyond_the_bound(rng):
    world = make_world(rng)
    points = noisy_points(world, rng)
    barrier = make_barrier(points, world.plan_from_cams, 5.0)
    assert_allclose(barrier.cost(world.plan_from_cams), 3.0 / 5.0)
    assert barrier.cost(nudged(rng, world.plan_from_cams, 5.0, 0.5)) == np.inf
    assert make_barrier(points, world.plan_from_cams, 0.0).cost(world.plan_from_cams) == np.inf


def test_others_that_cost_nothing_change_nothing_much(rng):
    world = make_world(rng)
    points = noisy_points(world, rng)
    weightless = floor_term(world.structure, replace(FLOOR, weight=0.0))
    start = nudged(rng, world.plan_from_cams, 0.5, 0.05)
    result = solve_bounded([points], [weightless], start, Allowance(), QUICK)
    assert result.bounded_cost.after <= result.bounded_cost.before * (1 + 1e-9)


@pytest.mark.parametrize(("name", "value"), [("error_factor", 0.9), ("slack", 0.0)])
def test_refuses_options_that_cannot_work(name, value):
    with pytest.raises(OptionError, match=name):
        Allowance(**{name: value})
