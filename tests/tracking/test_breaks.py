"""Jumps, outliers and their correction, on walks whose truth is known."""

from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from measured_walk import displaced, measure, tracked, walk

from planfit.findings import PoseKind
from planfit.geometry import se3
from planfit.scan.odometry import OdometryOptions
from planfit.tracking import TrackingOptions, breaks, judge_tracking
from planfit.tracking.motions import MeasuredMotions
from planfit.tracking.types import without_leaps

USUAL = OdometryOptions()


UP = np.array([0.0, 0.0, 1.0])


def judged(poses, motions, up_world=None, **options):
    options = TrackingOptions(**options)
    return judge_tracking(poses, motions, "recorded", USUAL, options, up_world)


def step_errors(poses, true):
    """Largest error of a step, m and rad."""
    steps = [se3.inverse(p[:-1]) @ p[1:] for p in (poses, true)]
    error = se3.inverse(steps[0]) @ steps[1]
    return np.linalg.norm(error[:, :3, 3], axis=1).max(), se3.rotation_angle(error[:, :3, :3]).max()


@pytest.fixture
def rng():
    return np.random.default_rng(1)


def test_what_is_not_broken_stays_bit_for_bit(rng):
    true = walk(rng)
    poses = tracked(true, rng)
    tracking = judged(poses, measure(true, rng))
    assert tracking.breaks == ()
    assert tracking.warnings == ()
    assert np.array_equal(tracking.world_from_cams, poses)
    assert tracking.sigma_factors[0] < 1.5


def test_images_that_show_a_leap_are_not_believed(rng):
    # Mirrors: what is seen in them fits from frame to frame, as far off as no walk goes in a step.
    true = walk(rng)
    mirrored = displaced(true, 40, 79, 6.0, 120.0, rng)
    poses = tracked(true, rng)
    tracking = judged(poses, measure(mirrored, rng))
    assert tracking.breaks == ()
    assert np.array_equal(tracking.world_from_cams, poses)


def test_a_long_step_that_was_recorded_too_is_a_pause(rng):
    true = walk(rng)
    paused = displaced(true, 40, 79, 6.0, 20.0, rng)
    poses = tracked(paused, rng)
    motions = measure(paused, rng)
    assert len(without_leaps(motions, poses)) == len(motions)
    assert len(without_leaps(motions, true)) < len(motions)


@settings(max_examples=8, deadline=None)
@given(
    st.lists(st.integers(2, 75), min_size=1, max_size=3, unique=True).filter(
        lambda s: len(s) == 1 or np.diff(sorted(s)).min() > 5
    ),
    st.floats(1.0, 8.0),
    st.floats(0.0, 90.0),
    st.integers(0, 1000),
)
@pytest.mark.slow
def test_jumps_are_found_where_they_are_and_corrected(after, metres, degrees, seed):
    rng = np.random.default_rng(seed)
    true = walk(rng)
    poses, motions = tracked(true, rng), measure(true, rng)
    for frame in after:
        poses = displaced(poses, frame + 1, len(poses) - 1, metres, degrees, rng)
    tracking = judged(poses, motions)
    assert [b.first_frame for b in tracking.breaks] == sorted(after)
    assert all(b.kind == "jump" for b in tracking.breaks)
    error_m, error_rad = step_errors(tracking.world_from_cams, true)
    assert error_m < 0.15
    assert error_rad < np.deg2rad(2.0)


@pytest.mark.parametrize(("first", "last"), [(30, 30), (40, 42), (1, 1)])
def test_a_few_frames_that_stand_elsewhere_are_put_back(rng, first, last):
    true = walk(rng)
    poses, motions = tracked(true, rng), measure(true, rng)
    spoilt = displaced(poses, first, last, 3.0, 30.0, rng)
    tracking = judged(spoilt, motions)
    (found,) = tracking.breaks
    assert (found.kind, found.first_frame, found.last_frame) == ("outlier", first, last)
    others = np.r_[0:first, last + 1 : len(poses)]
    assert np.array_equal(tracking.world_from_cams[others], poses[others])
    assert step_errors(tracking.world_from_cams, true)[0] < 0.15


def test_a_corrected_step_is_as_sure_as_the_motions_that_took_its_place(rng):
    true = walk(rng)
    poses, motions = tracked(true, rng), measure(true, rng)
    spoilt = displaced(poses, 40, len(poses) - 1, 5.0, 60.0, rng)
    odometry = judged(spoilt, motions).odometry
    sound = judged(poses, motions).odometry
    at = 39
    assert odometry.sigma_translation[at] > sound.sigma_translation[at]
    others = np.delete(np.arange(len(poses) - 1), at)
    np.testing.assert_allclose(
        odometry.sigma_translation[others], sound.sigma_translation[others], rtol=0.3
    )


def false_motion(motions, k, rng, n_inliers):
    """One motion, measured wrongly."""
    a_from_b = motions.a_from_b.copy()
    a_from_b[k] = se3.retract(a_from_b[k], rng.normal(size=6) * [1, 1, 1, 2, 2, 2])
    counts = motions.n_inliers.copy()
    counts[k] = n_inliers
    return MeasuredMotions(motions.pairs, a_from_b, motions.covariance, counts)


def test_a_false_motion_among_right_ones_breaks_nothing(rng):
    true = walk(rng)
    poses, motions = tracked(true, rng), measure(true, rng)
    for k in range(0, len(motions), 30):
        motions = false_motion(motions, k, rng, 200)
    assert judged(poses, motions).breaks == ()


def test_a_motion_that_stands_alone_needs_many_matches(rng):
    true = walk(rng)
    poses = tracked(true, rng)
    motions = measure(true, rng, neighbours=1)
    spoilt = displaced(poses, 40, len(poses) - 1, 3.0, 30.0, rng)
    few = MeasuredMotions(
        motions.pairs, motions.a_from_b, motions.covariance, motions.n_inliers // 5
    )
    assert judged(spoilt, few).breaks == ()
    with patch.object(breaks, "MIN_MATCHES_ALONE", 15):
        assert len(judged(spoilt, few).breaks) == 1
    assert len(judged(spoilt, motions).breaks) == 1


def test_small_departures_are_left_to_robust_losses(rng):
    true = walk(rng)
    poses, motions = tracked(true, rng), measure(true, rng)
    spoilt = displaced(poses, 40, len(poses) - 1, 0.4, 0.0, rng)
    assert judged(spoilt, motions).breaks == ()
    with patch.object(breaks, "MIN_JUMP_M", 0.3):
        assert len(judged(spoilt, motions).breaks) == 1
    turned = displaced(poses, 40, len(poses) - 1, 0.0, 6.0, rng)
    assert judged(turned, motions).breaks == ()
    with patch.object(breaks, "MIN_JUMP_DEG", 4.0):
        assert len(judged(turned, motions).breaks) == 1


def test_wider_sigmas_contradict_less(rng):
    true = walk(rng)
    poses, motions = tracked(true, rng), measure(true, rng)
    spoilt = displaced(poses, 40, len(poses) - 1, 1.0, 0.0, rng)
    assert len(judged(spoilt, motions).breaks) == 1
    with patch.object(breaks, "MAX_SIGMAS", 500.0):
        assert judged(spoilt, motions).breaks == ()


def test_mending_can_be_switched_off(rng):
    true = walk(rng)
    poses, motions = tracked(true, rng), measure(true, rng)
    spoilt = displaced(poses, 40, len(poses) - 1, 4.0, 40.0, rng)
    tracking = judged(spoilt, motions, mend=False)
    assert np.array_equal(tracking.world_from_cams, spoilt)
    assert tracking.breaks == ()
    noisy = tracked(true, rng, np.deg2rad(0.8), 0.1)
    assert judged(noisy, motions, mend=False).sigma_factors[1] > 3.0


def test_findings_have_the_frames_and_both_motions(rng):
    true = walk(rng)
    poses, motions = tracked(true, rng), measure(true, rng)
    (jump,) = judged(displaced(poses, 40, 79, 5.0, 60.0, rng), motions).findings
    assert (jump.kind, jump.frames) == (PoseKind.JUMP_CORRECTED, ((39, 40),))
    assert jump.facts["corrected_m"] < 0.5 < jump.facts["recorded_m"]
    assert jump.facts["witness"] == "images"
    (moved,) = judged(displaced(poses, 50, 52, 5.0, 60.0, rng), motions).findings
    assert (moved.kind, moved.frames) == (PoseKind.FRAMES_DISPLACED, ((50, 52),))
    assert moved.facts["displacement_m"] == pytest.approx(5.0, abs=1.0)


def test_a_pose_that_stands_still_is_filled_by_what_the_images_say(rng):
    true = walk(rng)
    poses, motions = tracked(true, rng), measure(true, rng)
    frozen = poses.copy()
    frozen[31:41] = frozen[30]
    tracking = judged(frozen, motions)
    (found,) = tracking.breaks
    assert (found.kind, found.first_frame, found.last_frame) == ("frozen", 30, 40)
    gap = np.linalg.norm((tracking.world_from_cams - poses)[:, :3, 3], axis=1)
    assert gap.max() < 0.4
    assert gap[:31].max() == 0.0
    assert gap[45:].max() < 1e-9  # the tracker knew again where it was
    assert found.finding.kind is PoseKind.POSE_STANDS_STILL
    assert found.finding.frames == ((30, 40),)


def test_a_tracker_that_goes_on_from_its_frozen_pose_has_jumped(rng):
    true = walk(rng)
    poses, motions = tracked(true, rng), measure(true, rng)
    frozen = poses.copy()
    frozen[31:41] = frozen[30]
    frozen[41:] = poses[30] @ se3.inverse(poses[40]) @ poses[41:]
    tracking = judged(frozen, motions)
    assert [b.kind for b in tracking.breaks] == ["frozen", "jump"]
    assert step_errors(tracking.world_from_cams, true)[0] < 0.15


def test_a_camera_on_a_tripod_is_not_lost(rng):
    true = walk(rng)
    true[31:41] = true[30]
    steady = true.copy()
    tracking = judged(steady, measure(true, rng))
    assert tracking.breaks == ()
    assert np.array_equal(tracking.world_from_cams, steady)


def test_two_images_of_one_pose_are_left_alone(rng):
    true = walk(rng)
    motions = measure(true, rng)
    twice = true.copy()
    twice[31] = twice[30]
    assert judged(twice, motions).breaks == ()


@pytest.mark.parametrize("step", [30, 31, 32])
@pytest.mark.parametrize(("metres", "degrees"), [(3.0, 20.0), (8.0, 90.0), (0.0, 100.0)])
def test_of_steps_that_the_same_motions_span_the_long_one_is_the_jump(rng, step, metres, degrees):
    """Nothing is measured that ends at the frames between: 31 and 32 match each other alone."""
    true = walk(rng)
    motions = measure(true, rng)
    first, second = motions.pairs.T
    is_between = np.isin(motions.pairs, [31, 32])
    spans = (first <= 30) & (second >= 33)
    motions = motions[is_between.all(axis=1) | ~is_between.any(axis=1)]
    assert spans.any()
    poses = displaced(tracked(true, rng), step + 1, len(true) - 1, metres, degrees, rng)
    tracking = judged(poses, motions)
    assert [b.first_frame for b in tracking.breaks] == [step]
    metres_off, radians_off = step_errors(tracking.world_from_cams, true)
    assert metres_off < 0.3
    assert np.rad2deg(radians_off) < 6.0


@pytest.mark.parametrize(("n_inliers", "n_found"), [(20, 0), (100, 1)])
def test_surfaces_alone_make_no_long_step_of_a_usual_one(rng, n_inliers, n_found):
    """Pairs over one step that all slid by the same way: so few matches do not say that it is a long one."""
    angle = np.zeros((60, 3))
    way = np.column_stack([0.5 * np.arange(60), np.zeros((60, 2))])
    poses = se3.make_transform(se3.exp_so3(angle), way)
    slid = poses.copy()
    slid[31:, 0, 3] += 1.0
    motions = measure(slid, rng, neighbours=2, n_inliers=n_inliers)
    spans = (motions.pairs[:, 0] <= 30) & (motions.pairs[:, 1] > 30)
    assert spans.sum() == 3
    tracking = judge_tracking(poses, motions, "recorded", OdometryOptions(), TrackingOptions())
    assert len(tracking.breaks) == n_found


@pytest.mark.parametrize(("n_inliers", "n_found"), [(20, 0), (100, 1)])
def test_surfaces_alone_make_no_long_step_longer(rng, n_inliers, n_found):
    """The tracker jumped by 0.5 m, and surfaces about the step slid by 0.8 m, all by the same way: that put
    a walk 1.7 m off."""
    poses, slid = straight(), straight()
    poses[31:, 0, 3] += 0.5
    slid[31:, 0, 3] += 1.3
    motions = measure(slid, rng, neighbours=2, n_inliers=n_inliers)
    assert len(judged(poses, motions).breaks) == n_found


@pytest.mark.parametrize(
    ("pairs", "n_found"), [(((30, 32), (30, 33)), 0), (((30, 32), (29, 33)), 1)]
)
def test_surfaces_seen_from_one_frame_do_not_confirm_each_other(rng, pairs, n_found):
    """What looks alike from a frame puts all its neighbours beside themselves by the same way."""
    motions = measure(straight(), rng, neighbours=4, n_inliers=20)
    is_over = (motions.pairs[:, 0] <= 30) & (motions.pairs[:, 1] > 30)
    is_kept = (motions.pairs[:, None] == np.array(pairs)).all(axis=2).any(axis=1)
    motions = motions[~is_over | is_kept]
    motions.a_from_b[np.isin(motions.pairs[:, 1], (32, 33)) & (motions.pairs[:, 0] < 31), 1, 3] += (
        0.5
    )
    assert len(judged(straight(), motions).breaks) == n_found


def straight(n=60, step_m=0.5):
    """Poses of a walk along x, looking ahead all the way."""
    way = np.column_stack([step_m * np.arange(n), np.zeros((n, 2))])
    return se3.make_transform(np.tile(np.eye(3), (n, 1, 1)), way)


def slid_along_x(motions, step, slide_m):
    """The motions over a step as a corridor's surfaces show them: anything along it, with nothing known."""
    over = (motions.pairs[:, 0] <= step) & (motions.pairs[:, 1] > step)
    a_from_b, covariance, counts = (
        motions.a_from_b.copy(), motions.covariance.copy(), motions.n_inliers.copy()
    )  # fmt: skip
    a_from_b[over, 0, 3] += slide_m
    covariance[over, 3, 3] = 100.0
    counts[over] = 20
    return MeasuredMotions(motions.pairs, a_from_b, covariance, counts)


@pytest.mark.parametrize("slide_m", [-0.8, 0.0, 0.8])
def test_where_surfaces_leave_a_direction_free_the_walk_goes_on_after_a_jump(rng, slide_m):
    """Ends 0.8 m off along the corridor where what they say of it counts."""
    true, step = straight(), 30
    motions = slid_along_x(measure(true, rng, neighbours=3), step, slide_m)
    spoilt = true.copy()
    turn = se3.exp_so3(np.array([0.0, 0.0, np.deg2rad(15.0)]))
    centre = true[step + 1, :3, 3]
    moved = se3.make_transform(turn, centre - turn @ centre + [0.3, 0.9, 0.0])
    spoilt[step + 1 :] = moved @ spoilt[step + 1 :]
    tracking = judged(spoilt, motions)
    assert [found.first_frame for found in tracking.breaks] == [step]
    off_m, off_rad = step_errors(tracking.world_from_cams, true)
    assert off_m < 0.1
    assert off_rad < np.deg2rad(1.0)
    # Unsure by half a step along the corridor, and by little across.
    assert 0.1 < tracking.odometry.sigma_translation[step] < 0.3


def jumped(poses, step, tilt_deg=0.0):
    """From a step on moved, turned about the vertical, and then pitched."""
    turn = se3.exp_so3(np.deg2rad([0.0, 0.0, 15.0])) @ se3.exp_so3(np.deg2rad([0.0, tilt_deg, 0.0]))
    centre = poses[step + 1, :3, 3]
    spoilt = poses.copy()
    moved = se3.make_transform(turn, centre - turn @ centre + [0.3, 0.9, 0.0])
    spoilt[step + 1 :] = moved @ spoilt[step + 1 :]
    return spoilt


def climbs_m(tracking):
    return np.abs(np.diff(tracking.world_from_cams[[0, -1], 2, 3]))[0]


def pitched(motions, step, pitch_deg, sigma_deg):
    """The motions over a step as surfaces show them that hardly tell which way is level."""
    over = (motions.pairs[:, 0] <= step) & (motions.pairs[:, 1] > step)
    a_from_b, covariance = motions.a_from_b.copy(), motions.covariance.copy()
    a_from_b[over, :3, :3] = se3.exp_so3(np.deg2rad([0.0, pitch_deg, 0.0])) @ a_from_b[over, :3, :3]
    covariance[over, 1, 1] = np.deg2rad(sigma_deg) ** 2
    return MeasuredMotions(motions.pairs, a_from_b, covariance, np.full(len(motions), 20))


def test_a_tracker_that_knows_gravity_jumps_level_where_surfaces_hardly_tell(rng):
    true, step = straight(), 30
    heading = np.deg2rad(10.0) * rng.choice([-1.0, 1.0], size=len(true))
    true[:, :3, :3] = se3.exp_so3(heading[:, None] * UP)
    motions = pitched(measure(true, rng, neighbours=3), step, 12.0, sigma_deg=9.0)
    knows, without = (judged(jumped(true, step), motions, up) for up in (UP, None))
    assert [found.first_frame for found in knows.breaks] == [step]
    # 15 m walked on behind the jump.
    assert climbs_m(knows) < 0.5
    assert climbs_m(without) > 1.0
    assert step_errors(knows.world_from_cams, true)[0] < 0.1


def test_a_tracker_that_began_anew_askew_is_put_upright(rng):
    true, step = straight(), 30
    tracking = judged(jumped(true, step, tilt_deg=20.0), measure(true, rng, neighbours=3), UP)
    assert [found.first_frame for found in tracking.breaks] == [step]
    assert climbs_m(tracking) < 0.3
    assert step_errors(tracking.world_from_cams, true)[1] < np.deg2rad(1.0)
