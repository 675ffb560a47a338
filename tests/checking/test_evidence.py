"""Evidence of a walk whose truth is known: what is right agrees, what is wrong is seen where it is."""

from dataclasses import replace

import numpy as np
import pytest

from builders import look, make_matches, make_structure, nudged, room_plan
from planfit.adjust import AdjustOptions, Measurements, adjust_to_plan, hold_to_keyframes
from planfit.alignment import Alignment, AlignOptions
from planfit.geometry import se3
from planfit.pipeline.evidence import gather_evidence
from planfit.pipeline.on_plan import ScanOnPlan
from planfit.pipeline.prepare import PreparedScan
from planfit.scan.odometry import OdometryOptions, make_odometry

N, LAP = 60, 30


@pytest.fixture
def truth():
    """Two laps round a room of 12 x 8 m, 15 m each."""
    angle = 2 * np.pi * np.arange(N) / LAP
    return np.stack(
        [look([6 + 3 * np.cos(a), 4 + 2 * np.sin(a), 1.5], np.rad2deg(a), 15) for a in angle]
    )


def world(truth, rng, sees_walls=None, steps=None):
    """Prepared scan and plan; each camera sees two walls and the floor, and is matched with its neighbours
    and with the other lap."""
    floorplan = room_plan(12.0, 8.0)
    floor, patches = [], []
    for i in range(N):
        floor.append((i, rng.uniform([1, 1, 0], [11, 7, 0], (60, 3))))
        for wall in (i % 4, (i + 1) % 4):
            first, last = floorplan.ends[wall]
            xy = first + (last - first) * rng.uniform(0.2, 0.8, (60, 1))
            on_wall = np.column_stack([xy, rng.uniform(0.3, 2.5, 60)])
            if sees_walls is None or sees_walls[i]:
                patches.append((i, on_wall, floorplan.normals[wall]))
    pairs = [(i, i + 1) for i in range(N - 1)] + [(i, i + LAP) for i in range(LAP)]
    matches = make_matches(truth, sorted(pairs), rng.uniform([0, 0, 0], [12, 8, 2.5], (30, 3)))
    odometry = make_odometry(truth if steps is None else steps, OdometryOptions())
    measurements = Measurements(matches, make_structure(truth, floor, patches), odometry)
    keyframes = hold_to_keyframes(truth, np.arange(len(truth)))
    start = nudged(rng, truth, 0.1, 0.01)
    prepared = PreparedScan(keyframes, measurements, np.eye(4), start, start)
    alignment = Alignment(np.eye(4), 0.9, None, is_as_recorded=True)
    return prepared, ScanOnPlan(floorplan, np.eye(4), alignment, np.eye(4))


def evidence_of(prepared, on_plan, n_folds=5):
    options = AdjustOptions()
    adjusted = adjust_to_plan(
        prepared.measurements, on_plan.floorplan, prepared.level_from_keys, options
    )
    rng = np.random.default_rng(0)
    return gather_evidence(prepared, on_plan, adjusted, options, AlignOptions(), n_folds, rng)


def test_what_is_right_agrees(truth, rng):
    evidence = evidence_of(*world(truth, rng))
    assert evidence.predicted_rms_m < 0.03
    assert evidence.torn == ()
    assert evidence.is_place_sure
    assert evidence.alignment.score > 0.99
    assert {s.near_kept_out for s in evidence.stretches} == {1.0}
    assert evidence.near_shares[1] == pytest.approx(1.0)
    assert max(v.kept_out_m for v in evidence.visits) < 0.01
    assert evidence.visits[0].before_m > max(v.kept_out_m for v in evidence.visits)
    assert [s.frames[0] for s in evidence.stretches[1:]] == [
        s.frames[1] + 1 for s in evidence.stretches[:-1]
    ]


def test_a_false_visit_does_not_agree_where_it_is_kept_out(truth, rng):
    prepared, on_plan = world(truth, rng)
    matches = prepared.measurements.matches
    good = evidence_of(prepared, on_plan)
    # All pairs of the first frames with the other lap are off by a metre: a place that looks alike.
    is_false = (matches.pairs[:, 0] < 6) & (matches.pairs[:, 1] - matches.pairs[:, 0] == LAP)
    points = matches.points_b.copy()
    points[np.repeat(is_false, np.diff(matches.start))] += [1.0, 0.0, 0.0]
    spoilt = replace(prepared.measurements, matches=replace(matches, points_b=points))
    found = evidence_of(replace(prepared, measurements=spoilt), on_plan)
    assert max(v.kept_out_m for v in found.visits) > 0.5
    assert max(v.kept_out_m for v in good.visits) < 0.01


def test_kept_out_measurements_have_no_say_in_the_poses_that_judge_them(truth, rng):
    prepared, on_plan = world(truth, rng)
    matches = prepared.measurements.matches
    options = AdjustOptions()
    adjusted = adjust_to_plan(
        prepared.measurements, on_plan.floorplan, prepared.level_from_keys, options
    )

    def gathered(measurements):
        return gather_evidence(
            replace(prepared, measurements=measurements), on_plan, adjusted, options, AlignOptions(),
            5, np.random.default_rng(0),
        )  # fmt: skip

    first = gathered(prepared.measurements)
    # The poses of the result are given: only what the folds do with a visit can change how it is judged.
    visit = first.visits[0]
    a, b = visit.first_frames, visit.last_frames
    own = (matches.pairs >= [a[0], b[0]]).all(axis=1) & (matches.pairs <= [a[1], b[1]]).all(axis=1)
    points = matches.points_b.copy()
    points[np.repeat(own, np.diff(matches.start))] += [0.2, 0.0, 0.0]
    second = gathered(replace(prepared.measurements, matches=replace(matches, points_b=points)))
    assert first.visits[0].kept_out_m < 0.01
    assert second.visits[0].kept_out_m == pytest.approx(0.2, abs=0.01)


def bare_world(truth, rng, steps=None):
    """From frame 45 on, nothing is seen but what the tracker recorded."""
    prepared, on_plan = world(truth, rng, np.arange(N) < 40, steps)
    matches = prepared.measurements.matches
    keep = (matches.pairs[:, 1] < 45) | (matches.pairs[:, 1] - matches.pairs[:, 0] > LAP)
    bare = replace(prepared.measurements, matches=matches.of_pairs(keep))
    return replace(prepared, measurements=bare), on_plan


def test_frames_that_only_the_tracker_holds_are_predicted_to_be_worse(truth, rng):
    evidence = evidence_of(*bare_world(truth, rng))
    held, open_ = evidence.predicted_error_m[:40], evidence.predicted_error_m[50:]
    assert open_.max() > 2 * held.max()
    assert open_.min() > held.max()
    assert np.all(np.diff(evidence.predicted_error_m[50:]) > 0)
    assert evidence.stretches[-1].n_patches == 0


def test_a_tracker_worse_than_its_sigmas_widens_the_prediction_where_it_alone_holds(truth, rng):
    right = evidence_of(*bare_world(truth, np.random.default_rng(1)))
    rough = nudged(np.random.default_rng(2), truth, 1.5, 0.15)
    wrong = evidence_of(*bare_world(truth, np.random.default_rng(1), rough))
    assert wrong.predicted_error_m[50:].min() > 2 * right.predicted_error_m[50:].min()
    # Walls and matches hold the others, whatever the tracker says.
    assert wrong.predicted_error_m[:40].max() < 0.03


def test_a_step_that_the_rest_contradicts_is_torn(truth, rng):
    jumped = truth.copy()
    jumped[25:] = se3.yaw_transform(0.0, np.array([3.0, 0.0, 0.0])) @ jumped[25:]
    evidence = evidence_of(*world(truth, rng, steps=jumped))
    (step,) = evidence.torn
    assert step.frames == (24, 25)
    assert step.departure_m == pytest.approx(3.0, abs=0.05)
    assert step.departure_deg < 1.0


def test_walls_that_the_plan_has_elsewhere_are_seen_in_their_stretch(truth, rng):
    prepared, on_plan = world(truth, rng)
    walls = prepared.measurements.structure.walls
    # What frames 24 to 35 see of walls stands 0.3 m in front of where it is drawn.
    shift = np.where((walls.frame_idx >= 24) & (walls.frame_idx < 36), -0.3, 0.0)
    ends = walls.ends_cam - shift[:, None, None] * walls.normals_cam[:, None]
    points = walls.points_cam - np.repeat(shift[:, None] * walls.normals_cam, 60, axis=0)
    moved = replace(
        prepared.measurements.structure, walls=replace(walls, points_cam=points, ends_cam=ends)
    )
    measurements = replace(prepared.measurements, structure=moved)
    evidence = evidence_of(replace(prepared, measurements=measurements), on_plan)
    beside = np.array([s.beside for s in evidence.stretches])
    first = np.array([s.frames[0] for s in evidence.stretches])
    is_moved = (first >= 24) & (first < 36)
    assert beside[is_moved].min() > 0.9
    assert beside[~is_moved].max() == 0.0


def test_the_same_seed_gives_the_same_evidence(truth, rng):
    prepared, on_plan = world(truth, rng)
    first, second = evidence_of(prepared, on_plan), evidence_of(prepared, on_plan)
    np.testing.assert_array_equal(first.predicted_error_m, second.predicted_error_m)
    assert first.stretches == second.stretches
    assert first.visits == second.visits
