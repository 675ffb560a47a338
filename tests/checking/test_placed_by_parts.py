"""A jump that nothing but the plan's walls tells: each part of the walk is aligned by itself."""

from dataclasses import replace

import numpy as np
import pytest

from builders import faces_plan, look, make_matches, make_structure
from planfit import RefineOptions
from planfit.adjust import AdjustOptions, Measurements, adjust_to_plan, hold_to_keyframes
from planfit.alignment import Alignment
from planfit.geometry import se3
from planfit.matching.surfaces.types import SurfacePairs
from planfit.pipeline.on_plan import ScanOnPlan
from planfit.pipeline.parts import matched_elsewhere, opened_by_walls, placed_by_parts
from planfit.pipeline.prepare import PreparedScan
from planfit.scan.odometry import OdometryOptions
from planfit.tracking import TrackingOptions
from planfit.tracking.judge import believe

N, STEP = 40, 19
CORNERS = [(0, 0), (14, 0), (14, 5), (9, 5), (9, 9), (3, 9), (3, 6), (0, 6)]


@pytest.fixture
def rng():
    return np.random.default_rng(3)


@pytest.fixture
def truth():
    """A walk along a building of no symmetry, a step of 0.25 m at a time."""
    return np.stack([look([2 + 0.25 * i, 3.0, 1.5], 20 * np.sin(i / 5), 10) for i in range(N)])


def world(truth, recorded, rng, unmatched=(STEP,), corners=CORNERS, reach_m=np.inf):
    """What the scan shows, its poses as recorded, and the whole aligned by its first part."""
    plan = faces_plan(corners)
    patches = []
    for i in range(N):
        for k, (first, last) in enumerate(plan.ends):
            n = 40 if np.isinf(reach_m) else 400
            xy = first + (last - first) * rng.uniform(0.05, 0.95, (n, 1))
            on_wall = np.column_stack([xy, rng.uniform(0.3, 2.5, n)])
            on_wall = on_wall[np.abs(xy - truth[i, :2, 3]).max(axis=1) < reach_m]
            if len(on_wall):
                patches.append((i, on_wall, plan.normals[k]))
    floor = [(i, rng.uniform([1, 1, 0], [13, 5, 0], (40, 3))) for i in range(N)]
    pairs = [(i, i + 1) for i in range(N - 1) if i not in unmatched]
    matches = make_matches(truth, pairs, rng.uniform([0, 0, 0], [14, 9, 2.5], (30, 3)))
    tracking = believe(recorded, "recorded", OdometryOptions())
    measured = Measurements(matches, make_structure(truth, floor, patches), tracking.odometry)
    keyframes = hold_to_keyframes(recorded, np.arange(N))
    prepared = PreparedScan(keyframes, measured, np.eye(4), recorded, recorded)
    on_plan = ScanOnPlan(plan, np.eye(4), Alignment(np.eye(4), 0.5, None), None)
    return prepared, tracking, on_plan


def jumped(truth, metres=3.0, degrees=20.0):
    pivot = truth[STEP + 1, :3, 3]
    turned = se3.yaw_transform(np.deg2rad(degrees), np.zeros(3))
    turned[:3, 3] = pivot + np.array([metres, 0.5, 0.0]) - turned[:3, :3] @ pivot
    poses = truth.copy()
    poses[STEP + 1 :] = turned @ truth[STEP + 1 :]
    return poses


def test_both_parts_stand_to_each_other_as_they_were(truth, rng):
    tracking = placed_by_parts(*world(truth, jumped(truth), rng), RefineOptions())
    assert tracking is not None
    off = np.linalg.norm((tracking.world_from_cams - truth)[:, :3, 3], axis=1)
    assert off.max() < 0.1
    (told,) = tracking.breaks
    assert (told.kind, told.first_frame) == ("jump", STEP)
    assert told.finding.facts["witness"] == "walls of the plan"
    assert told.finding.facts["corrected_m"] < 1.0
    # What the walls alone say holds the step loosely.
    assert tracking.odometry.sigma_translation[STEP] == pytest.approx(0.5)


def test_no_part_is_put_where_the_walk_would_leap_to(truth, rng):
    # What the walls show of the second part fits best 4.9 m back, as a room behind a mirror does.
    seen = truth.copy()
    seen[STEP + 1 :, 0, 3] -= 4.9
    assert placed_by_parts(*world(seen, truth, rng), RefineOptions()) is None


def test_a_walk_that_fits_stays_as_recorded(truth, rng):
    assert placed_by_parts(*world(truth, truth, rng), RefineOptions()) is None


def test_a_step_that_keypoints_bridge_is_not_cut(truth, rng):
    assert placed_by_parts(*world(truth, jumped(truth), rng, unmatched=()), RefineOptions()) is None


def test_a_part_that_drift_has_turned_is_no_jump_along_a_corridor(rng):
    # Its walls fit alike wherever it is put along the corridor; no step would be shorter than usual.
    truth = np.stack([look([4 + 1.2 * i, 1.0, 1.5], 0, 10) for i in range(N)])
    corridor = [(0, 0), (56, 0), (56, 2), (0, 2)]
    turned = truth.copy()
    pivot = se3.make_transform(np.eye(3), truth[STEP, :3, 3])
    about = pivot @ se3.yaw_transform(np.deg2rad(5.0), np.zeros(3)) @ se3.inverse(pivot)
    turned[STEP + 1 :] = about @ truth[STEP + 1 :]
    seen = world(truth, turned, rng, corners=corridor, reach_m=3.0)
    assert placed_by_parts(*seen, RefineOptions()) is None


@pytest.mark.parametrize("option", ["is_judged", "mend"])
def test_poses_that_are_to_stay_as_recorded_do(truth, rng, option):
    kept = RefineOptions(tracking=TrackingOptions(**{option: False}))
    assert placed_by_parts(*world(truth, jumped(truth), rng), kept) is None


def test_parts_without_enough_wall_stay_with_the_part_before(truth, rng):
    prepared, tracking, on_plan = world(truth, jumped(truth), rng)
    structure = prepared.measurements.structure
    few = structure.with_walls_of(np.arange(N) <= STEP)
    measured = replace(prepared.measurements, structure=few)
    few_walls = replace(prepared, measurements=measured)
    assert placed_by_parts(few_walls, tracking, on_plan, RefineOptions()) is None


def with_few_walls(prepared, frames):
    """Walls of these frames alone, besides those before the jump."""
    measured = prepared.measurements
    seen = measured.structure.with_walls_of((np.arange(N) <= STEP) | np.isin(np.arange(N), frames))
    return replace(prepared, measurements=replace(measured, structure=seen))


def test_frames_beyond_a_step_that_nothing_measured_whose_few_walls_fit_nowhere_have_no_place(
    truth, rng
):
    unmatched = (3, STEP, STEP + 2, STEP + 9)
    prepared, tracking, on_plan = world(truth, jumped(truth), rng, unmatched)
    few_walls = with_few_walls(prepared, [STEP + 6])
    undecided = replace(tracking, undecided_steps=np.array([3, STEP]))
    assert placed_by_parts(few_walls, undecided, on_plan, RefineOptions()) is None
    poses = few_walls.level_from_keys
    opened = opened_by_walls(few_walls, undecided, on_plan, RefineOptions(), poses)
    assert opened is not None
    # Nothing tells which of the two steps between the walls that are explained and those that are not.
    assert opened.open_steps.tolist() == [STEP, STEP + 2]
    assert opened.undecided_steps.tolist() == [3]
    assert opened.unplaced == ((STEP + 1, N - 1),)
    length = np.linalg.norm(tracking.odometry.cam_from_next[STEP, :3, 3])
    assert opened.odometry.sigma_translation[STEP] == pytest.approx(length / 2)
    assert np.array_equal(opened.world_from_cams, tracking.world_from_cams)


@pytest.mark.parametrize("unmatched", [(), (STEP + 9,)])
def test_nothing_is_opened_where_all_steps_to_the_walls_were_measured(truth, rng, unmatched):
    prepared, tracking, on_plan = world(truth, jumped(truth), rng, unmatched)
    few_walls = with_few_walls(prepared, [STEP + 6])
    walk = few_walls, tracking, on_plan, RefineOptions(), few_walls.level_from_keys
    assert opened_by_walls(*walk) is None


def test_a_step_that_nothing_measured_to_walls_that_fit_stays_as_recorded(truth, rng):
    prepared, tracking, on_plan = world(truth, truth, rng)
    assert opened_by_walls(prepared, tracking, on_plan, RefineOptions(), truth) is None


def test_walls_that_no_plan_draws_between_measured_steps_open_nothing(truth, rng):
    """Frames 16 to 19 see a wall that the plan lacks; they are held to those before, and the ones beyond the
    step that nothing measured lie on the plan."""
    prepared, tracking, on_plan = world(truth, truth, rng)
    measured = prepared.measurements
    walls = measured.structure.walls
    lost = (walls.frame_idx >= 16) & (walls.frame_idx <= STEP)
    moved = walls.points_cam.copy(), walls.ends_cam.copy()
    moved[0][np.repeat(lost, np.diff(walls.start))] *= 0.6
    moved[1][lost] *= 0.6
    walls = replace(walls, points_cam=moved[0], ends_cam=moved[1])
    structure = replace(measured.structure, walls=walls)
    seen = replace(prepared, measurements=replace(measured, structure=structure))
    assert opened_by_walls(seen, tracking, on_plan, RefineOptions(), truth) is None


def test_a_part_that_fits_worst_has_no_place_on_a_plan_that_lacks_most_walls(truth, rng):
    """Of the whole walk most walls are not drawn: that none had a place used to be the likeliest, and so
    nothing was opened."""
    prepared, tracking, on_plan = world(truth, jumped(truth), rng)
    plan = on_plan.floorplan
    few = np.arange(len(plan)) % 3 == 0
    few_faces = replace(
        plan, ends=plan.ends[few], normals=plan.normals[few], is_oriented=plan.is_oriented[few]
    )
    walk = prepared, tracking, replace(on_plan, floorplan=few_faces), RefineOptions()
    opened = opened_by_walls(*walk, prepared.level_from_keys)
    assert opened is not None
    assert opened.open_steps.tolist() == [STEP]


def test_surfaces_brought_together_elsewhere_than_the_walls_have_them_are_found_out(truth, rng):
    """Two frames before the jump, led astray together, confirm each other; the third is as far off where it
    leaves the motion free: its surfaces are others."""
    prepared, tracking, on_plan = world(truth, jumped(truth), rng)
    placed = placed_by_parts(prepared, tracking, on_plan, RefineOptions())
    pairs = np.array(
        [[STEP - 2, STEP + 1], [STEP - 1, STEP + 2], [STEP, STEP + 2], [3, 5], [STEP, STEP + 1]]
    )
    motions = se3.inverse(truth[pairs[:, 0]]) @ truth[pairs[:, 1]]
    motions[:3, :3, 3] += [2.6, 0.0, 0.3]  # a direction that the third leaves free
    motions[3, :3, 3] += 5.0
    information = np.tile(np.diag([1e4] * 3 + [1e4] * 3), (5, 1, 1))
    information[2, 3, 3] = information[2, 5, 5] = 0.0
    surfaces = SurfacePairs(
        pairs, motions, information, np.ones(5), np.zeros((5, 6, 7)), np.ones(5)
    )
    found = matched_elsewhere(surfaces, tracking, placed)
    assert found.tolist() == [True, True, True, False, False]


def test_drift_that_walls_take_back_opens_nothing(truth, rng):
    shifted = truth.copy()
    shifted[STEP + 1 :, :2, 3] += np.linspace(0.2, 0.5, N - STEP - 1)[:, None]
    prepared, tracking, on_plan = world(truth, shifted, rng)
    walk = prepared, tracking, on_plan, RefineOptions()
    assert opened_by_walls(*walk, prepared.level_from_keys) is not None
    pulled = adjust_to_plan(prepared.measurements, on_plan.floorplan, shifted, AdjustOptions())
    assert opened_by_walls(*walk, pulled.solution.target_from_cams[:N]) is None
