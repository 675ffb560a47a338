"""Where else a whole scan fits the plan, if other walls were moved: one wall, one vote."""

from dataclasses import replace

import numpy as np
import pytest

from builders import look, make_matches, make_structure
from planfit.adjust import AdjustOptions, Measurements
from planfit.adjust.alternation import PlanTask, alternate
from planfit.adjust.association import AssociationOptions, PatchesOnPlan
from planfit.adjust.competition import best_of_starts, full_cost, limits
from planfit.adjust.moved_walls import PRICE
from planfit.adjust.shifts import on_other_copy, other_places
from planfit.floorplan import Floorplan
from planfit.lsq.pose_terms import PosePriorTerm
from planfit.scan.odometry import OdometryOptions, make_odometry

WIDTH_M = 6.0
MOVED_M = 0.3


def parallel_plan(heights_m, crossing=True):
    """Walls along x at some y, each seen from below; and two across, seen from between."""
    lines = [[[0.0, y], [WIDTH_M, y]] for y in heights_m]
    normals = [[0.0, -1.0]] * len(heights_m)
    if crossing:
        lines += [[[0.0, -4.0], [0.0, 4.0]], [[WIDTH_M, -4.0], [WIDTH_M, 4.0]]]
        normals += [[1.0, 0.0], [-1.0, 0.0]]
    return Floorplan.from_segments(lines, normals)


def seen_walls(heights_m, n_patches=5, n_frames=6):
    """Frames in a row, each of which sees every wall along x where it stands, and those across."""
    poses = np.stack([look([1.5 + 0.5 * k, 0.0, 1.5], 90.0) for k in range(n_frames)])
    rng = np.random.default_rng(1)
    up = rng.uniform(0.3, 2.5, 200)
    x = np.linspace(1.0, 5.0, 200)
    patches = []
    for k in range(n_frames):
        for y in heights_m:
            if k < n_patches:
                patches.append(
                    (k, np.column_stack([x, np.full(200, y), up]), np.array([0.0, -1.0]))
                )
        for wall_x, side in ((0.0, 1.0), (WIDTH_M, -1.0)):
            on_wall = np.column_stack([np.full(200, wall_x), np.linspace(-2, 2, 200), up])
            patches.append((k, on_wall, np.array([side, 0.0])))
    floor = [(k, rng.uniform([0, -2, 0], [6, 2, 0], (60, 3))) for k in range(n_frames)]
    return poses, make_structure(poses, floor, patches)


def on_plan(structure, floorplan, poses):
    return PatchesOnPlan(structure.walls, floorplan, poses, AssociationOptions())


def places(drawn_m, seen_m, moved_face, offset_m=-MOVED_M, **changes):
    floorplan = parallel_plan(drawn_m)
    poses, structure = seen_walls(seen_m, **changes)
    moved_m = np.full(len(floorplan), np.nan)
    moved_m[moved_face] = offset_m  # along the normal, which looks down
    return other_places(on_plan(structure, floorplan, poses), moved_m)


def test_one_wall_against_one():
    (shift,) = places([2.0, 6.0], [2.0, 6.0 + MOVED_M], 1)
    np.testing.assert_allclose(shift.by_m, [0.0, -MOVED_M], atol=1e-9)
    assert (shift.n_for, shift.n_against) == (1, 1)


def test_three_walls_against_one_whichever_was_taken_for_moved():
    drawn, seen = [2.0, 4.0, 6.0, 8.0], [2.0, 4.0, 6.0, 8.0 + MOVED_M]
    (shift,) = places(drawn, seen, 3)
    assert (shift.n_for, shift.n_against) == (1, 3)
    # Put where the one lies as drawn, and the three were taken for moved.
    (back,) = places(drawn, [y - MOVED_M for y in seen], [0, 1, 2], offset_m=MOVED_M)
    np.testing.assert_allclose(back.by_m, [0.0, MOVED_M], atol=1e-9)
    assert (back.n_for, back.n_against) == (3, 1)


def test_pieces_in_one_line_are_one_wall():
    floorplan = Floorplan.from_segments(
        [[[0.0, 2.0], [2.6, 2.0]], [[3.4, 2.0], [WIDTH_M, 2.0]], [[0.0, 6.0], [WIDTH_M, 6.0]]],
        [[0.0, -1.0]] * 3,
    )
    poses = np.stack([look([3.0, 0.0, 1.5], 90.0)] * 4)
    up = np.linspace(0.3, 2.5, 100)
    patches = [
        (k, np.column_stack([np.linspace(*x, 100), np.full(100, y), up]), np.array([0.0, -1.0]))
        for k in range(4)
        for x, y in (((0.5, 2.0), 2.0), ((4.0, 5.5), 2.0), ((1.0, 5.0), 6.0 + MOVED_M))
    ]
    structure = make_structure(poses, (), patches)
    moved_m = np.array([np.nan, np.nan, -MOVED_M])
    (shift,) = other_places(on_plan(structure, floorplan, poses), moved_m)
    assert (shift.n_for, shift.n_against) == (1, 1)


def test_a_vote_counts_for_less_where_many_walls_were_moved():
    """Two walls for, three against: alone, and beside four that were moved each in its own way."""

    def unlikeliness(beside_m):
        drawn = [2.0, 4.0, 6.0, -2.0, -4.0, *8.0 + 2.0 * np.arange(len(beside_m))]
        off = np.array([0.0, 0.0, 0.0, MOVED_M, MOVED_M, *beside_m])
        is_moved = np.flatnonzero(off)
        shift = places(drawn, drawn + off, is_moved, offset_m=-off[is_moved])[0]
        assert (shift.n_for, shift.n_against) == (2, 3)
        return shift.unlikeliness

    assert unlikeliness([0.45, -0.15, -0.3, 0.6]) < unlikeliness([]) - 0.3


def test_few_patches_are_no_vote():
    assert not places([2.0, 6.0], [2.0, 6.0 + MOVED_M], 1, n_patches=2)


def test_a_thin_thing_behind_a_pane_is_no_wall_as_drawn():
    """Its front would come to lie on one face of the pane's wall, but its back not on the other."""

    def placed(thickness_m):
        lines = [[[0.0, y], [WIDTH_M, y]] for y in (2.0, 2.16, -3.0)]
        floorplan = Floorplan.from_segments(lines, [[0.0, -1.0], [0.0, 1.0], [0.0, 1.0]])
        poses = np.stack([look([3.0, y, 1.5], yaw) for y, yaw in ((0.0, 90.0), (5.0, -90.0))])
        seen = [(0, 2.4, -1.0), (1, 2.4 + thickness_m, 1.0), (0, -3.0, 1.0)]
        line = np.column_stack(
            [np.linspace(1.0, 5.0, 200), np.zeros(200), np.linspace(0.3, 2.5, 200)]
        )
        patches = [
            (frame, line + np.array([0.0, y, 0.0]), np.array([0.0, side]))
            for frame, y, side in seen
            for _ in range(4)
        ]
        structure = make_structure(poses, (), patches)
        moved_m = np.array([-0.4, 0.24 + thickness_m, np.nan])
        return other_places(on_plan(structure, floorplan, poses), moved_m)

    (shift,) = placed(0.16)  # the wall itself, moved
    assert (shift.n_for, shift.n_against) == (1, 1)
    assert not placed(0.0)


@pytest.mark.parametrize(("apart_m", "n_walls"), [(1.01, 1), (1.6, 2)])
def test_a_moved_wall_has_one_price_however_doors_cut_it(apart_m, n_walls):
    left, right = 3.0 - apart_m / 2, 3.0 + apart_m / 2
    floorplan = Floorplan.from_segments(
        [[[0.0, 2.0], [left, 2.0]], [[right, 2.0], [WIDTH_M, 2.0]], [[0.0, 6.0], [WIDTH_M, 6.0]]],
        [[0.0, -1.0]] * 3,
    )
    poses = np.stack([look([3.0, 0.0, 1.5], 90.0)] * 4)
    up = np.linspace(0.3, 2.5, 100)
    patches = [
        (k, np.column_stack([np.linspace(*x, 100), np.full(100, y), up]), np.array([0.0, -1.0]))
        for k in range(4)
        for x, y in (((0.5, left), 2.3), ((right, 5.5), 2.3), ((1.0, 5.0), 6.0))
    ]
    structure = make_structure(poses, (), patches)
    measured = Measurements(
        make_matches(poses, [], np.zeros((0, 3))),
        structure,
        make_odometry(poses, OdometryOptions()),
    )
    task = PlanTask(measured, floorplan, AdjustOptions(), np.full(len(poses), np.nan))
    task = replace(task, moved_m=np.array([-0.3, -0.3, np.nan]))
    end = alternate(task, poses, (0.35,))
    lost = end.problem.correspondences.walls.face_idx < 0
    explained = sum(cost.after for cost in end.solution.cost_by_term.values())
    assert full_cost(task, end) - explained - limits(task)[lost].sum() == pytest.approx(
        n_walls * PRICE
    )


def test_nothing_moved_is_nothing_elsewhere():
    floorplan = parallel_plan([2.0, 6.0])
    poses, structure = seen_walls([2.0, 6.0])
    nothing = np.full(len(floorplan), np.nan)
    assert not other_places(on_plan(structure, floorplan, poses), nothing)


@pytest.fixture
def one_against_one():
    floorplan = parallel_plan([2.0, 6.0])
    poses, structure = seen_walls([2.0, 6.0 + MOVED_M])
    measured = Measurements(
        make_matches(poses, [], np.zeros((0, 3))),
        structure,
        make_odometry(poses, OdometryOptions()),
    )
    return PlanTask(measured, floorplan, AdjustOptions(), np.full(len(poses), np.nan)), poses


def test_a_place_as_likely_is_a_rival_that_costs_nothing_more(one_against_one):
    task, poses = one_against_one
    found = best_of_starts(task, poses)
    excess = [rival.excess_cost for rival in found.rivals]
    apart = [
        np.abs(rival.plan_from_cams[:, 1, 3] - found.best.plan_from_cams[:, 1, 3]).mean()
        for rival in found.rivals
    ]
    assert min(excess) == pytest.approx(0.0)
    assert apart[int(np.argmin(excess))] == pytest.approx(MOVED_M, abs=0.02)


def test_control_points_speak_against_another_place(one_against_one):
    task, poses = one_against_one
    held = PosePriorTerm(np.arange(len(poses)), poses, np.full(6, 0.01))
    found = best_of_starts(replace(task, extra_terms=(held,)), poses)
    assert all(rival.odds < 0.1 for rival in found.rivals)


@pytest.mark.parametrize("by_m", [(0.0, MOVED_M), (-0.8, 0.0), (-0.25, -0.2)])
def test_a_plan_that_is_drawn_twice_has_two_places(by_m):
    drawn = [2.0, 4.0, 6.0]
    poses, structure = seen_walls(drawn)
    once = parallel_plan(drawn)
    assert on_other_copy(on_plan(structure, once, poses)) is None
    twice = Floorplan.from_segments(
        np.concatenate([once.ends, once.ends + by_m]), np.concatenate([once.normals] * 2)
    )
    np.testing.assert_allclose(on_other_copy(on_plan(structure, twice, poses)), by_m, atol=0.01)
    measured = Measurements(
        make_matches(poses, [], np.zeros((0, 3))),
        structure,
        make_odometry(poses, OdometryOptions()),
    )
    task = PlanTask(measured, twice, AdjustOptions(), np.full(len(poses), np.nan))
    found = best_of_starts(task, poses)
    places = [found.best, *(rival for rival in found.rivals if rival.odds > 0.5)]
    off_m = [(each.plan_from_cams - poses)[:, :2, 3].mean(axis=0) for each in places]
    # Both explain all alike, so that rounding says which is the best.
    for copy_m in ((0.0, 0.0), by_m):
        assert any(np.allclose(each, copy_m, atol=0.03) for each in off_m)


def test_walls_that_stand_for_themselves_have_no_other_copy():
    """A second line before one of three walls, as of cupboards, is no copy of the plan."""
    drawn = [2.0, 4.0, 6.0]
    poses, structure = seen_walls(drawn)
    cupboards = parallel_plan([*drawn, 6.0 - MOVED_M])
    assert on_other_copy(on_plan(structure, cupboards, poses)) is None


def test_the_one_wall_that_is_drawn_elsewhere_is_no_other_copy():
    """Nothing of the scan lies on the plan across the shift that would bring it there."""
    poses, structure = seen_walls([2.0])
    assert on_other_copy(on_plan(structure, parallel_plan([2.9]), poses)) is None
