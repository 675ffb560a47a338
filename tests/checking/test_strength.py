"""What fixes a direction is what resists when a stretch of the walk is moved along it."""

from dataclasses import replace

import numpy as np
import pytest

from builders import make_matches, make_world
from planfit.adjust import AdjustOptions, Measurements, adjust_to_plan
from planfit.adjust.problem import build_problem
from planfit.geometry import se3
from planfit.pipeline.strength import DIRECTIONS, LOOPS, NEIGHBOURS, directions_held

STRETCH = np.array([0, 0, 1, 1, 2, 2, 3, 3])


@pytest.fixture
def world(rng):
    return make_world(rng)


def held(world, measurements, stretch=STRETCH):
    poses = world.plan_from_cams
    adjusted = adjust_to_plan(measurements, world.floorplan, poses.copy(), AdjustOptions())
    problem = build_problem(measurements, AdjustOptions(), poses, adjusted.correspondences)
    covariances = np.tile(np.diag([0, 0, 0.01, 0.02, 0.03, 0.04]) ** 2, (len(poses), 1, 1))
    frames = 10 * np.arange(len(poses))
    return problem, directions_held(problem, poses, stretch, covariances, frames)


def resisted(quadratic, poses, own, axis):
    """Second difference of a cost when some frames move as one about their middle."""
    middle, step, costs = poses[own, :3, 3].mean(axis=0), 1e-4, []
    for amount in (-step, 0.0, step):
        tangent = np.zeros(6)
        tangent[axis] = amount
        turned, moved = se3.exp_so3(tangent[:3]), poses.copy()
        moved[own, :3, :3] = turned @ poses[own, :3, :3]
        moved[own, :3, 3] = (poses[own, :3, 3] - middle) @ turned.T + middle + tangent[3:]
        costs.append(quadratic.cost(moved))
    return (costs[0] - 2 * costs[1] + costs[2]) / step**2


def test_shares_are_those_of_costs_when_stretches_are_moved(world, rng):
    pairs = [(i, i + 1) for i in range(7)]
    points = rng.uniform([0, 0, 0], [6, 4, 2.5], (25, 3))
    both = make_matches(world.plan_from_cams, [*pairs, (0, 5), (1, 6)], points)
    measurements = replace(world.measurements, matches=both)
    problem, found = held(world, measurements)
    poses = world.plan_from_cams
    for each in found:
        axis = DIRECTIONS[each.direction]
        shares = []
        for k in range(4):
            own = np.flatnonzero(np.equal(STRETCH, k))
            frozen = {term.name: term.reweight(poses)[0] for term in problem.terms}
            amounts = {name: resisted(q, poses, own, axis) for name, q in frozen.items()}
            total = sum(amounts.values())
            shares.append((amounts[problem.geometric.name] / total, amounts["walls"] / total))
        told = dict(each.shares)
        matched, walls = np.mean(shares, axis=0)
        assert told[LOOPS] + told[NEIGHBOURS] == pytest.approx(matched, abs=2e-3)
        assert told.get("walls", 0.0) == pytest.approx(walls, abs=2e-3)
        assert sum(told.values()) == pytest.approx(1.0)
        assert told[LOOPS] > 0.01
    sigmas = {each.direction: (each.sigma, each.unit) for each in found}
    assert sigmas["z"] == (pytest.approx(0.04), "m")
    assert sigmas["heading"] == (pytest.approx(np.rad2deg(0.01)), "deg")


def test_walls_of_one_direction_fix_what_lies_across_them(world):
    normals = world.structure.walls.normals_cam
    rotations = world.plan_from_cams[world.structure.walls.frame_idx][:, :3, :3]
    along_y = np.abs(np.einsum("pij,pj->pi", rotations, normals)[:, 1]) > 0.9
    structure = replace(world.structure, walls=world.structure.walls.of(along_y))
    measurements = replace(world.measurements, structure=structure)
    _, found = held(world, measurements)
    told = {each.direction: dict(each.shares) for each in found}
    assert told["x"].get("walls", 0.0) < 1e-6
    assert told["y"]["walls"] > 0.01
    assert "floor" not in told["x"] or told["x"]["floor"] < 1e-6
    assert told["z"]["floor"] > 0.01


def test_pairs_of_stretches_that_follow_each_other_are_no_loops(world):
    poses = world.plan_from_cams
    chain = make_matches(poses, [(i, i + 1) for i in range(7)], np.ones((9, 3)) * [[3, 2, 1]])
    measurements = Measurements(chain, world.structure, world.odometry)
    _, found = held(world, measurements)
    for each in found:
        assert LOOPS not in dict(each.shares)
    # The frames of a loop's end, once they are called a stretch of their own, are.
    ring = replace(measurements, matches=world.matches)
    assert LOOPS in dict(held(world, ring)[1][0].shares)
    weakest = found[0].weakest_frames
    assert weakest in {(0, 10), (20, 30), (40, 50), (60, 70)}
