"""Nearest point and iterative nearest wall: the gradient, the motion, and every option."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import (
    faces_plan,
    gradient_by_differences,
    jacobian_by_differences,
    look,
    make_structure,
    make_world,
    moved_plan,
    nudged,
    position_rms_m,
    room_plan,
    twin_nearest,
)
from planfit.adjust.terms.between import PointTerm
from planfit.adjust.terms.nearest import NearestTerm
from planfit.adjust.terms.observation_models import POINTS, WALLS
from planfit.errors import OptionError
from planfit.floorplan import Floorplan
from planfit.geometry import se3, segments
from planfit.lsq.normal_equations import NormalEquations
from planfit.lsq.robust import Loss, LossKind, loss_value
from planfit.lsq.solver import SolverOptions, solve

TARGETS = ["point", "line"]
SQUARED = Loss(LossKind.SQUARED)


@pytest.fixture
def world(rng):
    return make_world(rng)


def make_term(world, **options):
    return nearest_term(world.structure.walls, world.floorplan, **options)


def nearest_term(
    patches, floorplan, nearest_to="line", max_distance_m=1.0, oriented=True, **options
):
    chosen = replace(WALLS, **{"loss": Loss(LossKind.CAUCHY, 2.0), **options})
    return NearestTerm(patches, floorplan, chosen, nearest_to, max_distance_m, oriented)


@pytest.mark.parametrize("nearest_to", TARGETS)
def test_zero_at_truth(nearest_to, world):
    # All wall points lie exactly on their faces.
    quadratic, cost = make_term(world, nearest_to=nearest_to).reweight(world.plan_from_cams)
    assert_allclose(cost, 0.0, atol=1e-18)
    assert_allclose(quadratic.normal_blocks(world.plan_from_cams).gradient, 0.0, atol=1e-8)
    assert np.isfinite(quadratic.normal_blocks(world.plan_from_cams).blocks).all()


@pytest.mark.parametrize("kind", list(LossKind), ids=lambda kind: kind.name)
@pytest.mark.parametrize("nearest_to", TARGETS)
def test_gradient_is_that_of_the_frozen_and_of_the_robust_cost(nearest_to, kind, world, rng):
    at = nudged(rng, world.plan_from_cams, 1.0, 0.05)
    loss = Loss(kind, 0.1 if kind is LossKind.NORM else 2.0)
    term = make_term(world, nearest_to=nearest_to, loss=loss)
    quadratic, _ = term.reweight(at)
    gradient = quadratic.normal_blocks(at).gradient
    robust = gradient_by_differences(lambda here: term.reweight(here)[1], at, 1e-7)
    scale = np.abs(robust).max()
    assert scale > 1.0
    assert_allclose(gradient, robust, atol=1e-4 * scale)
    frozen = gradient_by_differences(quadratic.cost, at)
    assert_allclose(gradient, frozen, atol=1e-6 * scale)


@pytest.mark.parametrize("nearest_to", TARGETS)
def test_blocks_are_those_of_the_residuals(nearest_to, world, rng):
    at = nudged(rng, world.plan_from_cams, 1.0, 0.05)
    options = {
        "sigma": 0.1,
        "loss": SQUARED,
        "max_observations": 1e9,
        "points_per_observation": 1.0,
    }
    quadratic, cost = make_term(world, nearest_to=nearest_to, **options).reweight(at)
    frame = world.structure.walls.point_frame_idx
    towards = np.repeat(world.structure.walls.normals_cam, np.diff(world.structure.walls.start), 0)
    towards = np.einsum("mab,mb->ma", at[frame, :2, :3], towards)
    front = towards @ world.floorplan.normals.T > 0

    def xy(here):
        return se3.transform(here[frame], world.structure.walls.points_cam[:, None])[:, 0, :2]

    face, feet, _ = twin_nearest(xy(at), world.floorplan, front)

    def residuals(here):
        gap = (xy(here) - feet) / 0.1
        across = world.floorplan.normals[face]
        return gap.ravel() if nearest_to == "point" else np.einsum("mi,mi->m", gap, across)

    assert_allclose(cost, 0.5 * np.sum(residuals(at) ** 2))
    assert_allclose(quadratic.cost(at), cost)
    jacobian = jacobian_by_differences(residuals, at)
    blocks = quadratic.normal_blocks(at)
    dense = NormalEquations([blocks], len(at)).matrix.toarray()
    assert_allclose(dense, jacobian.T @ jacobian, atol=1e-7 * dense.max())
    expected = jacobian.T @ residuals(at)
    assert_allclose(blocks.gradient.ravel(), expected, atol=1e-7 * np.abs(expected).max())


@pytest.mark.parametrize("nearest_to", TARGETS)
def test_moving_world_and_plan_together_changes_nothing(nearest_to, world, rng):
    at = nudged(rng, world.plan_from_cams, 1.0, 0.05)
    move = se3.yaw_transform(2.1, np.array([30.0, -12.0, 0.0]))
    term = make_term(world, nearest_to=nearest_to)
    moved = replace(term, floorplan=moved_plan(world.floorplan, move))
    assert_allclose(moved.reweight(move @ at)[1], term.reweight(at)[1], rtol=1e-9)


@pytest.mark.parametrize("distance_m", [0.5, 10.0])
def test_nearest_point_rounds_never_raise_the_cost(distance_m, world, rng):
    at = nudged(rng, world.plan_from_cams, 5.0, 0.3)
    term = make_term(world, nearest_to="point", max_distance_m=distance_m)
    quadratic, cost = term.reweight(at)
    for _ in range(10):
        other = nudged(rng, at, 2.0, 0.2)
        bound = cost + quadratic.cost(other) - quadratic.cost(at)
        assert term.reweight(other)[1] <= bound * (1 + 1e-9)


def one_point(xy, floorplan, normal=(0.0, 1.0), at=(3.0, 2.0, 1.5), **options):
    """A camera in the middle of a room that sees one wall point, its wall facing `normal`."""
    poses = look(at, -90.0)[None]
    structure = make_structure(poses, patches=[(0, np.array([[*xy, 1.0]]), normal)])
    chosen = {"loss": SQUARED, "sigma": 1.0, "points_per_observation": 1.0, **options}
    return poses, nearest_term(structure.walls, floorplan, **chosen)


def test_beyond_the_end_a_point_is_drawn_to_the_end():
    # One face from (0, 0) to (1, 0) looking to +y; the point lies 0.3 past its end and 0.4 above.
    ends = np.array([[[0.0, 0.0], [1.0, 0.0]]])
    floorplan = Floorplan("one", ends, segments.left_normals(ends), np.ones(1, dtype=bool))
    poses, term = one_point((1.3, 0.4), floorplan, nearest_to="point")
    quadratic, cost = term.reweight(poses)
    assert_allclose(cost, 0.5 * 0.25)
    assert_allclose(quadratic.feet, [[1.0, 0.0]], atol=1e-12)
    assert_allclose(quadratic.normal_blocks(poses).gradient[0, 3:], [0.3, 0.4, 0.0], atol=1e-9)
    poses, term = one_point((1.3, 0.4), floorplan, nearest_to="line")
    quadratic, cost = term.reweight(poses)
    assert_allclose(cost, 0.5 * 0.16)
    assert_allclose(quadratic.normal_blocks(poses).gradient[0, 3:], [0.0, 0.4, 0.0], atol=1e-9)


@pytest.mark.parametrize(("nearest_to", "slide"), [("point", 1.0), ("line", 0.0)])
def test_only_nearest_point_holds_along_the_wall(nearest_to, slide):
    poses, term = one_point((3.0, 0.2), room_plan(), nearest_to=nearest_to)
    block = term.reweight(poses)[0].normal_blocks(poses).blocks[0]
    assert_allclose(block[3:, 3:], np.diag([slide, 1.0, 0.0]), atol=1e-12)


def test_walls_move_towards_the_plan_and_not_away(world):
    at = world.plan_from_cams.copy()
    at[:, 0, 3] += 0.03
    for nearest_to, atol in (("line", 0.005), ("point", 0.025)):  # points hold along walls, too
        quadratic, _ = make_term(world, nearest_to=nearest_to).reweight(at)
        step = NormalEquations([quadratic.normal_blocks(at)], len(at)).step(1e-6)
        assert_allclose(step[:, 3], -0.03, atol=atol)


def thick_wall():
    """A wall 0.2 m thick along x: its upper face looks to +y, its lower one to -y."""
    ends = np.array([[[0.0, 0.0], [6.0, 0.0]], [[6.0, -0.2], [0.0, -0.2]]])
    return Floorplan("thick", ends, segments.left_normals(ends), np.ones(2, dtype=bool))


def test_oriented_faces_attract_only_what_was_seen_from_their_side():
    # Seen from +y, drifted so far that the back face is nearer.
    for oriented, foot_y in ((True, 0.0), (False, -0.2)):
        poses, term = one_point((3.0, -0.15), thick_wall(), nearest_to="point", oriented=oriented)
        assert_allclose(term.reweight(poses)[0].feet[0], [3.0, foot_y], atol=1e-12)


def test_faces_without_a_known_side_attract_from_both():
    plan = replace(thick_wall(), is_oriented=np.zeros(2, dtype=bool))
    poses, term = one_point((3.0, -0.15), plan, nearest_to="point", oriented=True)
    assert_allclose(term.reweight(poses)[0].feet[0], [3.0, -0.2], atol=1e-12)


def test_a_point_exactly_on_a_wall_or_corner_is_quiet():
    for xy in ((3.0, 0.0), (0.0, 0.0)):
        for nearest_to in TARGETS:
            poses, term = one_point(
                xy, room_plan(), nearest_to=nearest_to, loss=Loss(LossKind.NORM, 1e-3)
            )
            quadratic, cost = term.reweight(poses)
            assert_allclose(cost, 0.0, atol=1e-15)
            blocks = quadratic.normal_blocks(poses)
            assert_allclose(blocks.gradient, 0.0, atol=1e-9)
            assert np.isfinite(blocks.blocks).all()


@pytest.mark.parametrize("nearest_to", TARGETS)
def test_points_out_of_reach_have_no_gradient_and_cost_the_same_everywhere(nearest_to):
    loss = Loss(LossKind.CAUCHY, 2.0)
    limit = 0.5 * loss_value(np.array([(0.5 / 0.1) ** 2]), loss)[0][0]
    for y in (0.6, 1.0, -50.0):
        poses, term = one_point(
            (3.0, y),
            thick_wall(),
            nearest_to=nearest_to,
            max_distance_m=0.5,
            sigma=0.1,
            loss=loss,
        )
        quadratic, cost = term.reweight(poses)
        assert_allclose(cost, limit)
        assert quadratic.cost(poses) == 0.0
        assert not quadratic.normal_blocks(poses).blocks.any()


def test_max_distance_opens_the_search():
    poses, term = one_point((3.0, 0.6), thick_wall(), nearest_to="point", max_distance_m=0.7)
    assert_allclose(term.reweight(poses)[1], 0.5 * 0.36)


@pytest.mark.parametrize("nearest_to", TARGETS)
def test_weight_multiplies_the_term_and_zero_switches_it_off(nearest_to, world, rng):
    at = nudged(rng, world.plan_from_cams, 1.0, 0.05)
    one, cost = make_term(world, nearest_to=nearest_to).reweight(at)
    for factor in (3.0, 0.0):
        other, other_cost = make_term(world, nearest_to=nearest_to, weight=factor).reweight(at)
        assert_allclose(other_cost, factor * cost)
        expected = one.normal_blocks(at).blocks
        rounding = 1e-12 * expected.max()
        assert_allclose(other.normal_blocks(at).blocks, factor * expected, atol=rounding)


@pytest.mark.parametrize("nearest_to", TARGETS)
def test_sigma_and_observations_and_loss_are_those_given(nearest_to, world, rng):
    at = nudged(rng, world.plan_from_cams, 1.0, 0.1)

    def cost(**options):
        return make_term(world, nearest_to=nearest_to, **{"loss": SQUARED, **options}).reweight(at)[
            1
        ]

    assert_allclose(cost(sigma=0.1), cost(sigma=0.05) / 4)
    assert_allclose(cost(max_observations=0.5), cost(max_observations=1.0) / 2)
    assert_allclose(cost(points_per_observation=40.0), 2 * cost(points_per_observation=80.0))
    assert cost(loss=Loss(LossKind.GEMAN_MCCLURE, 1.0)) < 0.7 * cost()


def test_no_wall_points_cost_nothing(world):
    structure = make_structure(world.plan_from_cams)
    term = nearest_term(structure.walls, world.floorplan)
    quadratic, cost = term.reweight(world.plan_from_cams)
    assert cost == quadratic.cost(world.plan_from_cams) == 0.0
    assert not quadratic.normal_blocks(world.plan_from_cams).blocks.any()


@pytest.mark.parametrize("nearest_to", TARGETS)
def test_brings_a_drifted_walk_back(nearest_to, world, rng):
    terms = [make_term(world, nearest_to=nearest_to), PointTerm(world.matches, POINTS)]
    move = se3.yaw_transform(0.02, np.array([0.1, -0.12, 0.0]))
    start = move @ nudged(rng, world.plan_from_cams, 0.3, 0.02)
    start[:, 2, 3] = world.plan_from_cams[:, 2, 3]
    solution = solve(terms, start, SolverOptions(max_iterations=200, cost_tolerance=1e-9))
    xy = [p[:, :2, 3] - world.plan_from_cams[:, :2, 3] for p in (start, solution.target_from_cams)]
    assert np.abs(xy[1]).max() < 0.1 * np.abs(xy[0]).max()
    assert position_rms_m(solution.target_from_cams, world.plan_from_cams) < 0.1


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("max_distance_m", np.inf),
        ("max_distance_m", 0.0),
    ],
)
def test_refuses_options_that_cannot_work(name, value, world):
    with pytest.raises(OptionError, match=name):
        NearestTerm(world.structure.walls, world.floorplan, WALLS, **{name: value})


def test_a_plan_of_any_size_fits_the_grid():
    plan = faces_plan(np.array([[0, 0], [900, 0], [900, 700], [0, 700]]))
    poses, term = one_point((450.0, 0.3), plan, at=(450.0, 2.0, 1.5), nearest_to="point")
    assert_allclose(term.reweight(poses)[1], 0.5 * 0.09)
    assert np.prod(term.grid.shape) < 170_000
