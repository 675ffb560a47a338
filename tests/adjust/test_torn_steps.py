"""Torn steps: false revisits put into a walk whose truth is known, and trackers that truly fail."""

from dataclasses import replace

import numpy as np
import pytest

from builders import look, make_structure, position_rms_m, room_scan
from planfit.adjust import (
    AdjustOptions,
    Measurements,
    close_loops,
    close_loops_untorn,
)
from planfit.adjust.options import TermOptions
from planfit.adjust.torn_steps import find_broken_steps, find_torn_steps
from planfit.findings import ScanKind
from planfit.geometry import se3
from planfit.matching import Matches
from planfit.pipeline.observations import Observations
from planfit.pipeline.prepare import prepare
from planfit.scan.odometry import OdometryOptions, make_odometry
from planfit.segmentation import Gravity
from planfit.synth import DriftOptions, drift_poses

N, PER_LAP = 120, 60
ODOMETRY = TermOptions()


def ring():
    """Two laps round a circle of 4 m radius, 0.42 m a frame, looking along it."""
    angle = np.arange(N) * 2 * np.pi / PER_LAP
    return np.stack([look([4 * np.cos(a), 4 * np.sin(a), 1.5], np.rad2deg(a) + 90) for a in angle])


def seen_from(rng, motion, n=30):
    """Points (n, 3) in both camera frames of a pair with this motion a_from_b, to 2 cm."""
    points_b = rng.uniform([-1, -1, 1.5], [1, 1, 4], (n, 3))
    return se3.transform(motion, points_b) + 0.02 * rng.normal(size=(n, 3)), points_b


def measured(rng, recorded, motions):
    """Measurements of pairs with their motions, {(i, j): (a_from_b, explained)}."""
    pairs = sorted(motions)
    a, b = zip(*(seen_from(rng, motions[pair][0]) for pair in pairs), strict=True)
    frame_pairs = np.repeat(np.array(pairs), len(a[0]), axis=0)
    matches = Matches.from_arrays(frame_pairs, np.concatenate(a), np.concatenate(b), 0.03)
    explained = np.array([motions[pair][1] for pair in pairs])
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    floor = [(i, corners + recorded[i][:3, 3] * (1, 1, 0)) for i in range(N)]
    patch = (0, np.array([[0.0, 0, 1], [1, 0, 1]]), np.array([0.0, 1.0]))
    return Measurements(
        replace(matches, explained=explained),
        make_structure(recorded, floor, [patch]),
        make_odometry(recorded, OdometryOptions()),
    )


def true_motions(true, gap=5):
    """Neighbours but each `gap`-th, and every fourth frame with the one a lap later."""
    between = {(i, i + 1): 0.3 for i in range(N - 1) if i % gap}
    between |= {(i, i + PER_LAP): 0.3 for i in range(0, N - PER_LAP, 4)}
    return {(i, j): (se3.inverse(true[i]) @ true[j], e) for (i, j), e in between.items()}


def poster(true, i, j, n=4, explained=0.05, aside=(0.3, 0.0, 0.0)):
    """Frames from j on that claim to stand where frames from i on stand."""
    claim = true[i] @ se3.make_transform(np.eye(3), np.array(aside))
    return {
        (i + k, j + k): (
            se3.inverse(true[i + k]) @ claim @ se3.inverse(true[j]) @ true[j + k],
            explained,
        )
        for k in range(n)
    }


@pytest.fixture
def walk():
    true = ring()
    rng = np.random.default_rng(3)
    return true, drift_poses(true, DriftOptions(0.1, 0.01), rng, np.array([0, 0, 1.0])), rng


def test_nothing_is_torn_where_nothing_is_false(walk):
    true, recorded, rng = walk
    closed = close_loops_untorn(
        measured(rng, recorded, true_motions(true)), recorded, AdjustOptions()
    )
    assert closed.dropped == closed.torn_steps == ()
    assert not closed.is_dropped.any()
    assert position_rms_m(closed.solution.target_from_cams, true) < 0.06


@pytest.mark.parametrize("places", [[(20, 110)], [(5, 47), (20, 108), (33, 78)]])
def test_visits_that_tear_a_step_are_dropped_and_named(walk, places):
    true, recorded, rng = walk
    false = {}
    for i, j in places:
        false |= poster(true, i, j)
    measurements = measured(rng, recorded, true_motions(true) | false)
    torn = close_loops(measurements, recorded, AdjustOptions()).target_from_cams
    assert position_rms_m(torn, true) > 0.3
    found = find_torn_steps(measurements, torn, ODOMETRY)
    assert found[0].solved_m > found[0].recorded_m + 0.5
    assert found[0].sigmas == max(step.sigmas for step in found)

    closed = close_loops_untorn(measurements, recorded, AdjustOptions())
    is_false = np.array([tuple(pair) in false for pair in measurements.matches.pairs.tolist()])
    assert closed.is_dropped[is_false].all()
    assert closed.is_dropped[~is_false].mean() < 0.03
    assert closed.torn_steps == ()
    assert position_rms_m(closed.solution.target_from_cams, true) < 0.06
    named = {visit.finding.frames for visit in closed.dropped}
    assert named >= {((i, i + 3), (j, j + 3)) for i, j in places}


def test_a_step_that_the_frames_beside_it_contradict_is_given_up_for_them(walk):
    true, recorded, rng = walk
    jumped = recorded.copy()  # tracking jumps by 2 m between frames 32 and 33
    jumped[33:] = jumped[32] @ se3.make_transform(np.eye(3), np.array([2.0, 0, 0])) @ (
        se3.inverse(jumped[32]) @ jumped[33:]
    )  # fmt: skip
    closed = close_loops_untorn(measured(rng, jumped, true_motions(true)), jumped, AdjustOptions())
    assert closed.dropped == ()
    assert closed.torn_steps[0].frames == (32, 33)
    assert position_rms_m(closed.solution.target_from_cams, true) < 0.06


def test_three_visits_that_agree_are_believed_against_a_step(walk):
    true, recorded, rng = walk
    jumped = recorded.copy()  # tracking jumps where no match holds the step from 35 to 36
    jumped[36:] = jumped[35] @ se3.make_transform(np.eye(3), np.array([2.0, 0, 0])) @ (
        se3.inverse(jumped[35]) @ jumped[36:]
    )  # fmt: skip
    motions = {pair: motion for pair, motion in true_motions(true).items() if pair != (35, 36)}
    closed = close_loops_untorn(measured(rng, jumped, motions), jumped, AdjustOptions())
    assert closed.dropped == ()
    assert closed.torn_steps[0].frames == (35, 36)
    assert position_rms_m(closed.solution.target_from_cams, true) < 0.06


def test_where_every_step_is_off_the_sigmas_are_wrong_and_none_is_torn(walk):
    true, _, rng = walk
    recorded = drift_poses(true, DriftOptions(3.0, 0.3), rng, np.array([0, 0, 1.0]))
    measurements = measured(
        rng, recorded, {pair: m for pair, m in true_motions(true, N + 1).items()}
    )
    found = find_torn_steps(measurements, true, ODOMETRY)
    sigmas = np.array([step.sigmas for step in found])
    assert len(found) < 0.05 * N, sigmas


@pytest.mark.parametrize("every", [1, 3])
def test_what_is_dropped_is_named_and_takes_no_part_in_what_follows(walk, every):
    true, recorded, rng = walk
    false = poster(true, 20, 110)
    seen = measured(rng, recorded, true_motions(true) | false)
    keyframe_idx = np.unique([*range(0, len(recorded), every), len(recorded) - 1])
    gravity = Gravity(np.array([0, 0, 1.0]), 0.9, "truth")
    observations = Observations(gravity, seen.structure, seen.matches, keyframe_idx=keyframe_idx)
    prepared = prepare(room_scan(recorded), observations)
    (found,) = prepared.findings
    assert found.kind is ScanKind.REVISIT_TEARS_STEP
    keys = prepared.keyframes
    left = set(map(tuple, keys.frame_idx[prepared.measurements.matches.pairs].tolist()))
    assert len(left) > 40
    assert not left & {tuple(keys.frame_idx[keys.nearest[list(pair)]].tolist()) for pair in false}
    assert position_rms_m(prepared.level_from_keys, true[prepared.keyframes.frame_idx]) < 0.08


def test_without_odometry_nothing_can_be_torn(walk):
    true, recorded, rng = walk
    measurements = measured(rng, recorded, true_motions(true))
    assert find_torn_steps(measurements, true[::-1], TermOptions(0.0)) == ()


@pytest.mark.parametrize("n_pairs", [0, 2, 3, 6])
def test_a_step_that_frames_about_it_were_matched_over_is_not_broken(walk, n_pairs):
    """The tracker jumped by 0.4 m: below what is placed as a jump, and above what any tracker errs."""
    true, _, rng = walk
    recorded, at = true.copy(), 60
    recorded[at + 1 :, 0, 3] += 0.4
    over = [(at - k, at + 1 + k % 2) for k in range(6)][:n_pairs]
    motions = {(i, i + 1): (se3.inverse(true[i]) @ true[i + 1], 0.3) for i in range(at)}
    motions |= {(i, j): (se3.inverse(true[i]) @ true[j], 0.3) for i, j in over}
    motions = {pair: told for pair, told in motions.items() if pair != (at, at + 1) or n_pairs}
    seen = measured(rng, recorded, motions)
    found = find_broken_steps(seen, true)
    assert [step.frames for step in found] == [(at, at + 1)] * (n_pairs < 3)
    # Pairs that say what was recorded are no witnesses of what was solved.
    as_recorded = {(i, j): (se3.inverse(recorded[i]) @ recorded[j], 0.3) for i, j in motions}
    found = find_broken_steps(measured(rng, recorded, as_recorded), true)
    assert [step.frames for step in found] == [(at, at + 1)]
