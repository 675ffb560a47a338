"""Each term: zero at truth, gradients by differences, rigid invariance, and every option."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import (
    gradient_by_differences,
    jacobian_by_differences,
    make_world,
    moved_plan,
    nudged,
    random_transforms,
)
from planfit.adjust.association import Association, AssociationOptions, associate
from planfit.adjust.terms.between import OdometryTerm, PointTerm
from planfit.adjust.terms.levels import floor_term
from planfit.adjust.terms.observation_models import (
    FLOOR,
    ODOMETRY,
    POINTS,
    WALLS,
    ObservationModel,
)
from planfit.adjust.terms.walls import WallTerm
from planfit.geometry import se3
from planfit.lsq.normal_equations import NormalEquations
from planfit.lsq.pose_terms import PosePriorTerm
from planfit.lsq.robust import Loss, LossKind
from planfit.scan.odometry import OdometryOptions, make_odometry

NAMES = ["points", "floor", "walls", "odometry", "pose prior"]
SQUARED = Loss(LossKind.SQUARED)


@pytest.fixture
def world(rng):
    return make_world(rng)


@pytest.fixture
def terms(world):
    association = associate(
        world.structure.walls, world.floorplan, world.plan_from_cams, 0.5, AssociationOptions()
    )
    assert association.n_associated == len(world.structure.walls)
    made = [
        PointTerm(world.matches, POINTS),
        floor_term(world.structure, FLOOR),
        WallTerm(world.structure.walls, world.floorplan, association, WALLS),
        OdometryTerm(world.odometry, ODOMETRY),
        PosePriorTerm(np.array([0, 3]), world.plan_from_cams[[0, 3]], np.full(6, 0.1)),
    ]
    return {term.name: term for term in made}


@pytest.mark.parametrize("name", NAMES)
def test_zero_at_truth(name, terms, world):
    quadratic, cost = terms[name].reweight(world.plan_from_cams)
    assert_allclose(cost, 0.0, atol=1e-12)
    assert_allclose(quadratic.cost(world.plan_from_cams), 0.0, atol=1e-9)
    assert_allclose(quadratic.normal_blocks(world.plan_from_cams).gradient, 0.0, atol=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_costs_more_away_from_truth(name, terms, world, rng):
    assert terms[name].reweight(nudged(rng, world.plan_from_cams, 1.0, 0.05))[1] > 0.1


@pytest.mark.parametrize("name", NAMES)
def test_gradient_is_that_of_the_robust_cost_where_the_weights_were_taken(name, terms, world, rng):
    # rho'(s) are the weights, so the frozen squares and the robust cost share their slope.
    rotation_deg = (
        0.1 if name in ("odometry", "pose prior") else 2.0
    )  # their log is taken as linear
    poses = nudged(rng, world.plan_from_cams, rotation_deg, 0.08)
    quadratic, _ = terms[name].reweight(poses)
    gradient = quadratic.normal_blocks(poses).gradient
    robust = gradient_by_differences(lambda at: terms[name].reweight(at)[1], poses)
    frozen = gradient_by_differences(quadratic.cost, poses)
    scale = np.abs(robust).max()
    assert scale > 0.1
    assert_allclose(gradient, robust, atol=2e-3 * scale)
    assert_allclose(gradient, frozen, atol=2e-3 * scale)


@pytest.mark.parametrize("name", NAMES)
def test_frozen_squares_bound_the_robust_cost(name, terms, world, rng):
    poses = nudged(rng, world.plan_from_cams, 1.0, 0.05)
    quadratic, cost = terms[name].reweight(poses)
    for _ in range(5):
        other = nudged(rng, poses, 1.0, 0.05)
        bound = cost + quadratic.cost(other) - quadratic.cost(poses)
        assert terms[name].reweight(other)[1] <= bound + 1e-9 * bound


@pytest.mark.parametrize("name", ["points", "odometry"])
def test_moving_the_world_changes_nothing(name, terms, world, rng):
    poses = nudged(rng, world.plan_from_cams, 1.0, 0.05)
    moved = random_transforms(rng, 1)[0] @ poses
    assert_allclose(terms[name].reweight(moved)[1], terms[name].reweight(poses)[1], rtol=1e-9)


def test_floor_cost_does_not_change_with_yaw_and_level_translations(terms, world, rng):
    poses = nudged(rng, world.plan_from_cams, 1.0, 0.05)
    moved = se3.yaw_transform(1.2, np.array([7.0, -3.0, 0.0])) @ poses
    expected = terms["floor"].reweight(poses)[1]
    assert_allclose(terms["floor"].reweight(moved)[1], expected, rtol=1e-9)
    raised = se3.yaw_transform(0.0, np.array([0.0, 0.0, 0.1])) @ poses
    assert abs(terms["floor"].reweight(raised)[1] - expected) > 1.0


def test_moving_world_and_plan_together_changes_no_wall_cost(terms, world, rng):
    poses = nudged(rng, world.plan_from_cams, 1.0, 0.05)
    move = se3.yaw_transform(2.1, np.array([30.0, -12.0, 0.0]))
    moved = replace(terms["walls"], floorplan=moved_plan(world.floorplan, move))
    expected = terms["walls"].reweight(poses)[1]
    assert_allclose(moved.reweight(move @ poses)[1], expected, rtol=1e-9)


def rebuilt(term, **options):
    return replace(term, model=replace(term.model, **options))


@pytest.mark.parametrize("name", ["points", "floor", "walls", "odometry"])
def test_weight_multiplies_the_term(name, terms, world, rng):
    poses = nudged(rng, world.plan_from_cams, 0.5, 0.02)
    one, cost = terms[name].reweight(poses)
    three, triple = rebuilt(terms[name], weight=3.0).reweight(poses)
    assert_allclose(triple, 3 * cost)
    blocks = one.normal_blocks(poses).blocks
    rounding = 1e-12 * np.abs(blocks).max()
    assert_allclose(three.normal_blocks(poses).blocks, 3 * blocks, atol=rounding)
    assert_allclose(three.normal_blocks(poses).gradient, 3 * one.normal_blocks(poses).gradient)


@pytest.mark.parametrize("name", ["floor", "walls"])
def test_sigma_divides_the_residual(name, terms, world, rng):
    poses = nudged(rng, world.plan_from_cams, 0.5, 0.02)
    term = rebuilt(terms[name], loss=SQUARED)
    wide = rebuilt(term, sigma=2 * term.model.sigma)
    assert_allclose(wide.reweight(poses)[1], term.reweight(poses)[1] / 4)


@pytest.mark.parametrize("name", ["points", "floor", "walls", "odometry"])
def test_loss_is_the_one_chosen(name, terms, world, rng):
    poses = nudged(rng, world.plan_from_cams, 5.0, 0.5)
    kinds = [kind for kind in LossKind if kind != LossKind.NORM]
    costs = [rebuilt(terms[name], loss=Loss(kind, 2.0)).reweight(poses)[1] for kind in kinds]
    assert costs == sorted(costs, reverse=True)
    assert costs[0] > 2 * costs[-1]
    wider = rebuilt(terms[name], loss=Loss(LossKind.CAUCHY, 4.0)).reweight(poses)[1]
    assert wider > costs[LossKind.CAUCHY]


@pytest.mark.parametrize("name", ["points", "floor", "walls"])
def test_max_observations_bounds_what_a_bundle_of_points_is_worth(name, terms, world, rng):
    poses = nudged(rng, world.plan_from_cams, 0.5, 0.02)
    one = rebuilt(terms[name], max_observations=1.0).reweight(poses)[1]
    half = rebuilt(terms[name], max_observations=0.5).reweight(poses)[1]
    assert_allclose(half, one / 2)


@pytest.mark.parametrize("name", ["floor", "walls"])
def test_points_per_observation_thins_small_bundles(name, terms, world, rng):
    poses = nudged(rng, world.plan_from_cams, 0.5, 0.02)
    # 80 points a bundle: one effective observation, and two.
    one, two = (
        rebuilt(terms[name], points_per_observation=n, max_observations=4.0).reweight(poses)[1]
        for n in (80.0, 40.0)
    )
    assert_allclose(two, 2 * one)


def test_weighting_counts_effective_observations():
    points = np.array([0, 1, 10, 100])
    model = ObservationModel(SQUARED, max_observations=4.0, points_per_observation=10.0)
    observations = points * model.weight_per_point(points)
    assert_allclose(observations, [0.0, 0.1, 1.0, 4.0])


def test_wall_patches_without_a_face_have_no_weight(terms, world, rng):
    poses = nudged(rng, world.plan_from_cams, 1.0, 0.05)
    n = len(world.structure.walls)
    nothing = replace(terms["walls"], association=Association(np.full(n, -1), np.full(n, np.nan)))
    quadratic, cost = nothing.reweight(poses)
    assert cost == 0.0
    assert not np.any(quadratic.normal_blocks(poses).blocks)


def test_walls_are_moved_towards_the_plan_and_not_away(terms, world):
    # One camera moved by +x: the gradient step must go back by -x.
    poses = world.plan_from_cams.copy()
    poses[:, 0, 3] += 0.03
    quadratic, _ = terms["walls"].reweight(poses)
    step = NormalEquations([quadratic.normal_blocks(poses)], len(poses)).step(1e-6)
    assert_allclose(step[:, 3], -0.03, atol=0.005)


def test_odometry_blocks_are_those_of_the_residuals(world, terms, rng):
    poses = nudged(rng, world.plan_from_cams, 0.5, 0.05)
    term = terms["odometry"]
    quadratic, _ = term.reweight(poses)
    weight = np.sqrt(quadratic.information)
    residuals = term.between.rows.residuals
    jacobian = jacobian_by_differences(lambda at: (weight * residuals(at)).ravel(), poses)
    residual = (weight * residuals(poses)).ravel()
    blocks = quadratic.normal_blocks(poses)
    dense = NormalEquations([blocks], len(poses)).matrix.toarray()
    assert_allclose(dense, jacobian.T @ jacobian, rtol=1e-4, atol=1e-4 * np.abs(dense).max())
    assert_allclose(
        blocks.gradient.ravel(), jacobian.T @ residual, atol=1e-4 * np.abs(blocks.gradient).max()
    )


def test_a_recorded_jump_is_not_spread_over_the_path(world):
    # With the robust loss the one wrong step has next to no weight.
    poses = world.plan_from_cams.copy()
    poses[4:, 0, 3] += 3.0
    term = OdometryTerm(make_odometry(poses, OdometryOptions()), ODOMETRY)
    quadratic, _ = term.reweight(world.plan_from_cams)
    sure = quadratic.information[:, 3] * term.odometry.sigma_translation**2
    assert sure[3] < 0.05
    assert_allclose(np.delete(sure, 3), 1.0)
