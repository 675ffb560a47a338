"""A hall of four walls, one of which was moved: poses that bent to it are brought back, or it is told that
either of two walls may have been."""

from dataclasses import replace

import numpy as np
import pytest

from builders import faces_plan, look, make_matches, make_structure
from planfit.adjust import AdjustOptions, Measurements, adjust_to_plan, settle_walls
from planfit.adjust.uncertainty import model_errors
from planfit.floorplan import Floorplan
from planfit.scan.odometry import OdometryOptions, make_odometry

N, HALF_M, CORE_M, SLACK = 80, 7.0, 2.0, 8.0
SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
EAST = 1
"""The wall at +x, which looks towards -x."""


def hall_plan():
    """A square room around a square core."""
    room, core = faces_plan(HALF_M * SQUARE), faces_plan(CORE_M * SQUARE[::-1])
    ends = np.concatenate([room.ends, core.ends])
    normals = np.concatenate([room.normals, core.normals])
    return Floorplan("hall", ends, normals, np.ones(len(ends), dtype=bool))


def hall(rng, moved_m, has_core):
    """Truth and measurements of one walk around: every camera sees the wall that it looks at, every other
    the core's. `moved_m`: how far the east wall stands inside of where it is drawn."""
    angle = np.arange(N) * 360.0 / N
    at = np.column_stack([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))])
    at *= 4.5 / np.abs(at).max(axis=1, keepdims=True)
    facing = 90.0 * np.round(angle / 90.0)
    looks_in = (np.arange(N) % 2 == 1) & has_core
    truth = np.stack(
        [look([*p, 1.5], a, 15) for p, a in zip(at, facing + 180.0 * looks_in, strict=True)]
    )
    floor, patches = [], []
    for i in range(N):
        floor.append((i, np.array([*at[i], 0]) + rng.uniform([-2, -2, 0], [2, 2, 0], (60, 3))))
        towards = np.round([np.cos(np.deg2rad(facing[i])), np.sin(np.deg2rad(facing[i]))])
        out_m = HALF_M - moved_m * (towards[0] > 0)
        off_m, widest_m = (CORE_M, CORE_M) if looks_in[i] else (out_m, HALF_M)
        along = np.clip(np.abs(towards[::-1]) * at[i], -widest_m + 1.2, widest_m - 1.2)
        xy = off_m * towards + along + np.abs(towards[::-1]) * rng.uniform(-1.1, 1.1, (240, 1))
        xy = xy + 0.005 * rng.normal(size=(240, 2)) * np.abs(towards)
        normal = towards if looks_in[i] else -towards
        patches.append((i, np.column_stack([xy, rng.uniform(0.3, 2.5, 240)]), normal))
    # Neighbours see the same; where the walk closes it is seen again.
    pairs = [(i, i + 1) for i in range(N - 1)] + [(0, N - 1), (1, N - 1)]
    world = rng.uniform([-6.5, -6.5, 0], [6.5, 6.5, 2.5], (8, 3))
    matches = make_matches(truth, pairs, world)
    # Sigmas are wider than what is measured errs, as they mostly are: poses can bend.
    steps = make_odometry(truth, OdometryOptions())
    odometry = replace(
        steps,
        sigma_rotation=SLACK * steps.sigma_rotation,
        sigma_translation=SLACK * steps.sigma_translation,
    )
    return truth, Measurements(matches, make_structure(truth, floor, patches), odometry)


def bent_adjustment(truth, measured, plan, moved_m):
    """Held to all walls, from poses that bent to the one that was moved."""
    bent = truth.copy()
    bent[:, 0, 3] += moved_m * np.clip((truth[:, 0, 3] - 2.0) / 2.5, 0.0, 1.0)
    options = AdjustOptions(starts=("aligned",))
    held = replace(options, finds_moved_walls=False)
    return adjust_to_plan(measured, plan, bent, held)


def settled(measured, plan, adjustment, options=None):
    def errors(problem):
        return model_errors(problem, np.arange(N) // 8, np.ones(N), np.random.default_rng(0))

    return settle_walls(measured, plan, adjustment, options or AdjustOptions(), errors)


def error_m(adjustment, truth):
    off = adjustment.solution.target_from_cams[:, :3, 3] - truth[:, :3, 3]
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))


@pytest.mark.parametrize("moved_m", [0.15, -0.2])
def test_poses_that_bent_to_a_moved_wall_are_brought_back(rng, moved_m):
    truth, measured = hall(rng, moved_m, has_core=True)
    bent = bent_adjustment(truth, measured, hall_plan(), moved_m)
    assert error_m(bent, truth) > 0.2 * abs(moved_m)
    again = settled(measured, hall_plan(), bent)
    assert error_m(again, truth) < 0.02
    assert [wall.face_idx for wall in again.moved_walls] == [EAST]
    assert again.moved_walls[0].offset_m == pytest.approx(moved_m, abs=0.03)


def test_nothing_is_let_go_of_where_walls_stand_as_drawn(rng):
    truth, measured = hall(rng, 0.0, has_core=True)
    found = bent_adjustment(truth, measured, hall_plan(), 0.0)
    again = settled(measured, hall_plan(), found)
    assert not again.moved_walls
    assert not again.rivals
    assert again.solution is found.solution


@pytest.mark.parametrize("moved_m", [0.3, -0.2])
def test_which_of_two_walls_that_face_each_other_was_moved_is_left_open(rng, moved_m):
    plan = faces_plan(HALF_M * SQUARE)
    truth, measured = hall(rng, moved_m, has_core=False)
    bent = bent_adjustment(truth, measured, plan, moved_m)
    again = settled(measured, plan, bent)
    assert not again.moved_walls
    likely = [rival for rival in again.rivals if rival.odds > 0.5]
    off_m = [
        np.abs((rival.plan_from_cams - again.solution.target_from_cams)[:, 0, 3]).max()
        for rival in likely
    ]
    # With either wall drawn elsewhere, the hall is elsewhere by as much, or bends the other way.
    assert len(likely) == 2
    assert max(off_m) > 0.7 * abs(moved_m)


def test_where_walls_may_not_have_been_moved_nothing_changes(rng):
    truth, measured = hall(rng, 0.3, has_core=True)
    bent = bent_adjustment(truth, measured, hall_plan(), 0.3)
    held = AdjustOptions()
    held = replace(held, finds_moved_walls=False)
    assert settled(measured, hall_plan(), bent, held) is bent
    assert settled(measured, None, bent) is bent
