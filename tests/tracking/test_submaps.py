"""Jumps that no neighbouring images tell of, decided by revisits."""

from dataclasses import replace

import numpy as np
import pytest
from measured_walk import LAP, displaced, measure, three_laps

from builders import make_matches
from planfit.findings import PoseKind
from planfit.geometry import se3
from planfit.scan.odometry import OdometryOptions, usual_step
from planfit.tracking import (
    TrackingOptions,
    believe,
    judge_tracking,
    pairs_across,
    place_submaps,
    with_open_steps,
)
from planfit.tracking.types import LEAP, LEAP_M


@pytest.fixture
def rng():
    return np.random.default_rng(2)


@pytest.fixture
def laps(rng):
    return three_laps(rng)


def judged(poses, motions, **options):
    return judge_tracking(poses, motions, "recorded", OdometryOptions(), TrackingOptions(**options))


def revisits(poses, rng, at):
    """Matches between frames a lap apart, for frames `at` of the earlier lap."""
    points = rng.uniform([-5, -5, -1], [5, 5, 1], (40, 3))
    return make_matches(poses, [(i, i + LAP) for i in at], points)


def placed(tracking, matches):
    return place_submaps(tracking, matches)


def test_only_long_steps_that_nothing_confirms_are_doubtful(laps, rng):
    assert len(judged(laps, measure(laps, rng)).doubtful_steps) == 0
    unmeasured = measure(laps, rng, unmeasured=(40,))
    assert len(judged(laps, unmeasured).doubtful_steps) == 0  # as short as any other
    jumped = displaced(laps, 41, len(laps) - 1, 5.0, 40.0, rng)
    tracking = judged(jumped, unmeasured)
    assert tracking.doubtful_steps.tolist() == [40]
    assert tracking.breaks == ()
    assert len(judged(jumped, unmeasured, mend=False).doubtful_steps) == 0


@pytest.mark.parametrize(("sigma_m", "doubtful"), [(10.0, [40]), (0.02, [])])
def test_motions_that_leave_a_direction_free_confirm_no_long_step(laps, rng, sigma_m, doubtful):
    """Surfaces of a corridor agree with any step along it, the recorded one too."""
    jumped = displaced(laps, 41, len(laps) - 1, 5.0, 0.0, rng)
    motions = measure(jumped, rng)
    over = (motions.pairs[:, 0] <= 40) & (motions.pairs[:, 1] > 40)
    covariance = motions.covariance.copy()
    covariance[over, 3, 3] = sigma_m**2
    tracking = judged(jumped, replace(motions, covariance=covariance))
    assert tracking.doubtful_steps.tolist() == doubtful
    assert tracking.breaks == ()


def test_open_steps_are_as_unsure_as_they_are_long(laps, rng):
    odometry = judged(laps, measure(laps, rng)).odometry
    opened = with_open_steps(odometry, np.array([7]))
    length = np.linalg.norm(odometry.cam_from_next[7, :3, 3])
    assert opened.sigma_translation[7] == pytest.approx(length / 2)
    others = np.arange(len(laps) - 1) != 7
    assert np.array_equal(opened.sigma_translation[others], odometry.sigma_translation[others])


def test_a_jump_is_undone_by_revisits_across_it(laps, rng):
    jumped = displaced(laps, 41, len(laps) - 1, 5.0, 60.0, rng)
    tracking = judged(jumped, measure(laps, rng, unmeasured=(40,)))
    result = placed(tracking, revisits(laps, rng, range(15, 30)))
    (found,) = result.breaks
    assert (found.kind, found.first_frame) == ("jump", 40)
    assert found.finding.facts["witness"] == "revisits"
    gap = np.linalg.norm((result.world_from_cams - laps)[:, :3, 3], axis=1)
    assert gap.max() < 0.1
    assert len(result.doubtful_steps) == 0
    steps = se3.inverse(result.world_from_cams[:-1]) @ result.world_from_cams[1:]
    np.testing.assert_allclose(result.odometry.cam_from_next, steps, atol=1e-9)


def test_two_jumps_are_undone_the_surest_first(laps, rng):
    jumped = displaced(laps, 41, len(laps) - 1, 5.0, 60.0, rng)
    jumped = displaced(jumped, 71, len(laps) - 1, 3.0, 30.0, rng)
    tracking = judged(jumped, measure(laps, rng, unmeasured=(40, 70)))
    result = placed(tracking, revisits(laps, rng, [*range(12, 30), *range(50, 60)]))
    assert [b.first_frame for b in result.breaks] == [40, 70]
    gap = np.linalg.norm((result.world_from_cams - laps)[:, :3, 3], axis=1)
    assert gap.max() < 0.15


def test_a_long_step_that_revisits_confirm_stays_bit_for_bit(laps, rng):
    # A gap in the recording: the camera went on unseen.
    kept = np.r_[0:40, 48 : len(laps)]
    poses = laps[kept]
    tracking = judged(poses, measure(poses, rng, unmeasured=(39,)))
    assert tracking.doubtful_steps.tolist() == [39]
    points = rng.uniform([-5, -5, -1], [5, 5, 1], (40, 3))
    result = placed(tracking, make_matches(poses, [(i, i + 22) for i in range(20, 36)], points))
    assert result.breaks == ()
    assert np.array_equal(result.world_from_cams, poses)
    assert np.array_equal(result.odometry.sigma_translation, tracking.odometry.sigma_translation)


def test_without_revisits_the_recorded_step_stands(laps, rng):
    jumped = displaced(laps, 41, len(laps) - 1, 5.0, 60.0, rng)
    tracking = judged(jumped, measure(laps, rng, unmeasured=(40,)))
    result = placed(tracking, revisits(laps, rng, [15, 16]))  # two are too few
    assert np.array_equal(result.world_from_cams, jumped)
    assert result.breaks == ()


def test_revisits_of_a_place_that_looks_alike_make_no_walk_leap(laps, rng):
    """All agree, on another office than the one that the walk went on in."""
    jumped = displaced(laps, 41, len(laps) - 1, 5.0, 60.0, rng)
    tracking = judged(jumped, measure(laps, rng, unmeasured=(40,)))
    elsewhere = laps.copy()
    elsewhere[41:] = se3.make_transform(np.eye(3), np.array([9.0, 6.0, 0.0])) @ laps[41:]
    result = placed(tracking, revisits(elsewhere, rng, range(15, 30)))
    assert np.array_equal(result.world_from_cams, jumped)
    assert result.breaks == ()
    assert result.undecided_steps.tolist() == [40]


def test_a_jump_that_leaves_a_leap_is_told(laps, rng):
    """However it was placed: 9 m on, where a step is 0.6 m."""
    jumped = displaced(laps, 41, len(laps) - 1, 5.0, 60.0, rng)
    tracking = judged(jumped, measure(laps, rng, unmeasured=(40,)))
    assert tracking.leaps == ()  # nothing was corrected
    right = placed(tracking, revisits(laps, rng, range(15, 30)))
    assert right.leaps == ()
    assert believe(laps[:1], "recorded", OdometryOptions()).leaps == ()
    poses = right.world_from_cams.copy()
    poses[41:, 0, 3] += 9.0
    assert replace(right, world_from_cams=poses).leaps == ((40, 41),)


def test_a_jump_is_undone_where_the_recording_paused_too(laps, rng):
    """The walk goes on metres further, as is recorded but for the jump."""
    n_missing = LAP // 4
    kept = np.r_[0:40, 40 + n_missing : len(laps)]
    poses = laps[kept]
    pause_m = np.linalg.norm(poses[40, :3, 3] - poses[39, :3, 3])
    assert pause_m > max(LEAP_M, LEAP * usual_step(se3.inverse(laps[:-1]) @ laps[1:])[0])
    jumped = displaced(poses, 40, len(poses) - 1, 1.0, 10.0, rng)
    tracking = judged(jumped, measure(poses, rng, unmeasured=(39,)))
    points = rng.uniform([-5, -5, -1], [5, 5, 1], (40, 3))
    pairs = [(i, i + LAP - n_missing) for i in range(22, 37)]
    result = placed(tracking, make_matches(poses, pairs, points))
    assert [b.first_frame for b in result.breaks] == [39]
    gap = np.linalg.norm((result.world_from_cams - poses)[:, :3, 3], axis=1)
    assert gap.max() < 0.1


def test_pairs_across_a_step_have_it_between_them_and_are_no_neighbours():
    """The slow twin: all pairs that do."""
    expected = [
        (i, j) for i in range(12) for j in range(i + 1, 12) if 4 < j - i <= 8 and i <= 3 < j
    ]
    assert pairs_across(np.array([3]), 12, 4).tolist() == [list(p) for p in expected]


def test_where_revisits_do_not_tell_which_step_jumped_all_stay_and_it_is_said(laps, rng):
    """Two jumps; the part between is never seen again: it may belong to either side."""
    jumped = displaced(laps, 41, len(laps) - 1, 5.0, 60.0, rng)
    jumped = displaced(jumped, 71, len(laps) - 1, 3.0, 30.0, rng)
    tracking = judged(jumped, measure(laps, rng, unmeasured=(40, 70)))
    points = rng.uniform([-5, -5, -1], [5, 5, 1], (40, 3))
    result = placed(tracking, make_matches(laps, [(i, i + 2 * LAP) for i in range(12, 28)], points))
    (found,) = result.breaks
    assert np.array_equal(result.world_from_cams, jumped)
    assert found.finding.kind is PoseKind.REVISITS_CONTRADICT_MOTION


def test_what_follows_unplaced_goes_along(laps, rng):
    """Two jumps; only the middle part is seen again: the last part keeps its place behind it."""
    jumped = displaced(laps, 41, len(laps) - 1, 5.0, 60.0, rng)
    jumped = displaced(jumped, 71, len(laps) - 1, 3.0, 30.0, rng)
    tracking = judged(jumped, measure(laps, rng, unmeasured=(40, 70)))
    result = placed(tracking, revisits(laps, rng, range(12, 30)))
    assert [b.first_frame for b in result.breaks] == [40]
    step, recorded = (se3.inverse(p[70]) @ p[71] for p in (result.world_from_cams, jumped))
    np.testing.assert_allclose(step, recorded, atol=1e-9)


def test_revisits_join_the_walk_over_frames_that_nothing_places(laps, rng):
    # Frozen at 41 to 45, then on; images do not match after 41 and 43: frames 42 and 43 are lost for good.
    frozen = laps.copy()
    frozen[41:46] = laps[40]
    frozen[46:] = laps[40] @ se3.inverse(laps[45]) @ laps[46:]
    tracking = judged(frozen, measure(laps, rng, unmeasured=(41, 43)))
    assert tracking.open_steps.tolist() == [41, 43]
    assert tracking.unplaced[0][0] == 0  # one end of the walk against the other
    result = placed(tracking, revisits(laps, rng, range(17, 30)))
    assert result.unplaced == ((42, 43),)
    others = np.r_[0:42, 44 : len(laps)]
    found = result.world_from_cams[others, :3, 3]
    closer = se3.transform(se3.fit_rigid(found, laps[others, :3, 3]), found)
    assert np.linalg.norm(closer - laps[others, :3, 3], axis=1).max() < 0.2


def test_a_step_that_revisits_alone_tell_is_no_recorded_motion(laps, rng):
    """It was as sure as a tracker's: an adjustment that moved it by 0.2 m had *torn the path*, and walls and
    other revisits could not move what came after."""
    frozen = laps.copy()
    frozen[41:46] = laps[40]
    frozen[46:] = laps[40] @ se3.inverse(laps[45]) @ laps[46:]
    tracking = judged(frozen, measure(laps, rng, unmeasured=(43,)))
    result = placed(tracking, revisits(laps, rng, range(17, 30)))
    assert tracking.open_steps.tolist() == [43]
    assert len(result.open_steps) == 0
    length = np.linalg.norm(result.odometry.cam_from_next[:, :3, 3], axis=1)
    assert result.odometry.sigma_translation[43] >= length[43] / 2
    others = np.arange(len(laps) - 1) != 43
    assert np.all(result.odometry.sigma_translation[others] < length[others] / 2)


def test_a_long_step_that_ends_a_little_otherwise_is_no_jump(laps, rng):
    """Two parts of a walk, placed one by one, were said to have jumped by the whole step between them."""
    jumped = displaced(laps, 41, len(laps) - 1, 5.0, 60.0, rng)
    jumped[66:, :3, 3] += (0.04, 0.03, 0.0)
    motions = measure(laps, rng, unmeasured=(40, 65))
    tracking = judged(jumped, motions)
    if 65 not in tracking.doubtful_steps:
        tracking = replace(tracking, doubtful_steps=np.array([40, 65]))
    result = placed(tracking, revisits(laps, rng, [*range(15, 30), *range(40, 56)]))
    assert [b.first_frame for b in result.breaks] == [40]
