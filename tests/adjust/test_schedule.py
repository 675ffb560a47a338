"""The order of the adjustment: loops, then walls; what holds the gauge; when the rounds end."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import make_matches, make_structure, make_world, position_rms_m, room_plan
from planfit.adjust import AdjustOptions, Measurements, adjust_to_plan, close_loops, costs
from planfit.adjust.options import TermOptions
from planfit.errors import OptionError
from planfit.geometry import se3
from planfit.scan.odometry import OdometryOptions, make_odometry


@pytest.fixture
def world(rng):
    return make_world(rng)


@pytest.fixture
def drifted(world, rng):
    """The walk as a tracker records it, the first frame in its true place; with its odometry."""
    steps = se3.inverse(world.plan_from_cams[:-1]) @ world.plan_from_cams[1:]
    steps = se3.retract(steps, rng.normal(size=(7, 6)) * ([0.01] * 3 + [0.03] * 3))
    poses = [world.plan_from_cams[0]]
    for step in steps:
        poses.append(poses[-1] @ step)
    poses = np.stack(poses)
    return poses, replace(
        world.measurements, odometry=make_odometry(poses, OdometryOptions(0.03, 0.0, 0.6, 0.0))
    )


def test_loops_are_closed_and_the_first_frame_held(world, drifted):
    poses, measurements = drifted
    assert position_rms_m(poses, world.plan_from_cams) > 0.05
    solution = close_loops(measurements, poses, AdjustOptions())
    assert position_rms_m(solution.target_from_cams, world.plan_from_cams) < 0.01
    assert_allclose(solution.target_from_cams[0], poses[0], atol=2e-3)


def test_the_floor_sets_height_and_tilt_of_the_first_frame(world, drifted):
    poses, measurements = drifted
    tilt = se3.make_transform(se3.exp_so3(np.array([0.03, -0.02, 0.0])), np.array([0, 0, 0.2]))
    solution = close_loops(measurements, tilt @ poses, AdjustOptions())
    height = solution.target_from_cams[:, 2, 3]
    assert_allclose(height, 1.5, atol=0.02)
    assert_allclose(solution.target_from_cams[0, :2, 3], (tilt @ poses)[0, :2, 3], atol=2e-3)


def test_without_floor_the_whole_first_frame_is_held(world, drifted):
    poses, measurements = drifted
    options = AdjustOptions(floor=TermOptions(0.0))
    poses = se3.make_transform(np.eye(3), np.array([0, 0, 0.2])) @ poses
    solution = close_loops(measurements, poses, options)
    assert "floor" not in solution.cost_by_term
    assert_allclose(solution.target_from_cams[0], poses[0], atol=2e-3)


def test_walls_bring_the_scan_onto_the_plan(world, drifted):
    poses, measurements = drifted
    translation = se3.yaw_transform(0.02, np.array([0.15, -0.1, 0.0]))
    plan_adjustment = adjust_to_plan(
        measurements, world.floorplan, translation @ poses, AdjustOptions()
    )
    assert position_rms_m(plan_adjustment.solution.target_from_cams, world.plan_from_cams) < 0.01
    assert plan_adjustment.converged
    assert plan_adjustment.association.n_associated == len(world.structure.walls)
    assert_allclose(plan_adjustment.association.distance_m, 0.0, atol=0.01)


def test_a_wall_that_the_plan_has_elsewhere_does_not_deform_the_scan(world, drifted):
    poses, measurements = drifted
    ends = world.floorplan.ends.copy()
    ends[2, :, 1] += 0.9  # moved further than the last association distance
    moved = replace(world.floorplan, ends=ends)
    plan_adjustment = adjust_to_plan(measurements, moved, poses, AdjustOptions())
    assert position_rms_m(plan_adjustment.solution.target_from_cams, world.plan_from_cams) < 0.05


def test_each_weight_of_zero_switches_its_term_off(world, drifted):
    poses, measurements = drifted
    off = {
        "points": AdjustOptions(points=TermOptions(0.0)),
        "floor": AdjustOptions(floor=TermOptions(0.0)),
        "odometry": AdjustOptions(odometry=TermOptions(0.0)),
        "walls": AdjustOptions(walls=TermOptions(0.0)),
    }
    for name, options in off.items():
        used = set(
            adjust_to_plan(measurements, world.floorplan, poses, options).solution.cost_by_term
        )
        assert used - {"gauge"} == set(off) - {name}
        assert ("gauge" in used) == (name == "walls")


def test_without_walls_the_alignment_is_kept(world, drifted):
    poses, measurements = drifted
    nowhere = room_plan(name="far away")
    nowhere = replace(nowhere, ends=nowhere.ends + 500.0)
    plan_adjustment = adjust_to_plan(measurements, nowhere, poses, AdjustOptions())
    assert plan_adjustment.association.n_associated == 0
    assert "gauge" in plan_adjustment.solution.cost_by_term
    assert position_rms_m(plan_adjustment.solution.target_from_cams, world.plan_from_cams) < 0.02


def test_the_walls_alone_are_enough_for_a_frame(world, rng):
    # No matches, no floor, no trajectory: two walls at right angles fix x, y and yaw.
    empty = make_matches(world.plan_from_cams, [], np.zeros((0, 3)))
    options = AdjustOptions(odometry=TermOptions(0.0), floor=TermOptions(0.0))
    delta = np.zeros((8, 6))
    delta[:, 2], delta[:, 3:5] = 0.03, rng.uniform(-0.1, 0.1, (8, 2))
    start = se3.retract(world.plan_from_cams, delta)
    measurements = Measurements(empty, world.structure, world.odometry)
    plan_adjustment = adjust_to_plan(measurements, world.floorplan, start, options)
    assert_allclose(
        plan_adjustment.solution.target_from_cams[:, :2, 3],
        world.plan_from_cams[:, :2, 3],
        atol=0.01,
    )


def test_a_single_frame_is_adjusted(rng):
    world = make_world(rng, n=2)
    one = world.plan_from_cams[:1]
    floor = [(0, rng.uniform([1, 1, 0], [5, 3, 0], (100, 3)))]
    structure = make_structure(one, floor)
    measurements = Measurements(
        make_matches(one, [], np.zeros((0, 3))), structure, make_odometry(one, OdometryOptions())
    )
    raised = se3.make_transform(np.eye(3), np.array([0, 0, 0.05])) @ one
    solution = close_loops(measurements, raised, AdjustOptions())
    assert_allclose(solution.target_from_cams[0, 2, 3], 1.5, atol=1e-3)
    plan_adjustment = adjust_to_plan(measurements, world.floorplan, one, AdjustOptions())
    assert_allclose(plan_adjustment.solution.target_from_cams, one, atol=1e-3)


def test_no_measurements_at_all_changes_nothing(world):
    nothing = Measurements(
        make_matches(world.plan_from_cams, [], np.zeros((0, 3))),
        make_structure(world.plan_from_cams),
        world.odometry,
    )
    options = AdjustOptions(odometry=TermOptions(0.0))
    solution = close_loops(nothing, world.plan_from_cams, options)
    assert_array_equal(solution.target_from_cams, world.plan_from_cams)


def test_rounds_are_bounded(world, drifted):
    poses, measurements = drifted
    options = AdjustOptions(
        wall_distances_m=(1.0, 0.5), max_alternations=1, wall_strategy="iterative"
    )
    plan_adjustment = adjust_to_plan(measurements, world.floorplan, poses, options)
    assert plan_adjustment.rounds == 2


def test_wall_distances_limit_what_is_associated(world):
    away = se3.make_transform(np.eye(3), np.array([0.5, 0.5, 0.0])) @ world.plan_from_cams
    near = AdjustOptions(wall_distances_m=(0.3,), starts=("aligned",))
    far = AdjustOptions(wall_distances_m=(0.8,), starts=("aligned",))
    measurements = world.measurements
    assert adjust_to_plan(measurements, world.floorplan, away, near).association.n_associated == 0
    assert adjust_to_plan(measurements, world.floorplan, away, far).association.n_associated == 16


@pytest.mark.parametrize("distances", [(), (0.5, 0.0), (-1.0,)])
def test_impossible_distances_are_refused(distances):
    with pytest.raises(OptionError, match="wall_distances_m"):
        AdjustOptions(wall_distances_m=distances)


def test_costs_for_reports_are_those_of_the_terms(world, drifted):
    poses, measurements = drifted
    plan_adjustment = adjust_to_plan(measurements, world.floorplan, poses, AdjustOptions())
    final = plan_adjustment.solution.target_from_cams
    found = costs(measurements, final, AdjustOptions(), plan_adjustment.correspondences)
    assert set(found) == {"points", "floor", "odometry", "walls"}
    for name, cost in found.items():
        assert_allclose(cost, plan_adjustment.solution.cost_by_term[name].after, rtol=1e-6)
    assert set(costs(measurements, final, AdjustOptions())) == {"points", "floor", "odometry"}
