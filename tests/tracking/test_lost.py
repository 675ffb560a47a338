"""Lost tracking: frozen poses and identities, told and placed by the images; the truth is known."""

import numpy as np
import pytest
from measured_walk import measure, tracked, walk
from test_breaks import judged

from planfit.findings import PoseKind
from planfit.geometry import se3


@pytest.fixture
def rng():
    return np.random.default_rng(3)


def recorded_walk(rng, n=80):
    true = walk(rng, n)
    return true, tracked(true, rng)


def errors_m(poses, true):
    """Of positions, after the rigid motion that brings them closest."""
    found, wanted = poses[:, :3, 3], true[:, :3, 3]
    return np.linalg.norm(se3.transform(se3.fit_rigid(found, wanted), found) - wanted, axis=1)


def with_frozen(poses, first, last):
    """Frames `first` to `last` repeat the pose before."""
    result = poses.copy()
    result[first : last + 1] = result[first - 1]
    return result


def going_on(poses, first, last):
    """As above, and the tracker goes on from there as if nobody had walked."""
    result = with_frozen(poses, first, last)
    result[last + 1 :] = poses[first - 1] @ se3.inverse(poses[last]) @ poses[last + 1 :]
    return result


def test_found_again_beyond_images_that_do_not_match(rng):
    """Filled from one side, the walk ended beside the place where the tracker found itself again."""
    true, poses = recorded_walk(rng)
    motions = measure(true, rng, unmeasured=(35,))
    tracking = judged(with_frozen(poses, 31, 40), motions)
    assert [b.kind for b in tracking.breaks] == ["frozen"]
    others = np.r_[0:31, 41:80]
    assert np.abs(tracking.world_from_cams[others] - poses[others]).max() < 1e-9
    gap = np.linalg.norm((tracking.world_from_cams - poses)[:, :3, 3], axis=1)
    assert gap.max() < 0.25
    assert tracking.unplaced == ()
    assert tracking.odometry.sigma_translation[35] < 0.3


def test_gone_on_beyond_images_that_do_not_match(rng):
    """What came after may be anywhere, and it is said so."""
    true, poses = recorded_walk(rng)
    motions = measure(true, rng, unmeasured=(35,))
    tracking = judged(going_on(poses, 31, 40), motions)
    assert tracking.open_steps.tolist() == [35]
    assert tracking.unplaced == ((0, 35),)
    assert 35 in tracking.doubtful_steps
    assert tracking.odometry.sigma_translation[35] >= 1.0
    assert errors_m(tracking.world_from_cams[36:], true[36:]).max() < 0.3
    unmatched = [b.finding.facts["unmatched_after_frames"] for b in tracking.breaks]
    assert (35,) in unmatched


def test_frames_between_two_breaks_have_no_place(rng):
    true, poses = recorded_walk(rng)
    motions = measure(true, rng, unmeasured=(33, 36))
    tracking = judged(with_frozen(poses, 31, 40), motions)
    assert tracking.unplaced == ((34, 36),)
    others = np.r_[0:34, 37:80]
    assert errors_m(tracking.world_from_cams[others], true[others]).max() < 0.3


@pytest.mark.parametrize(
    ("first", "last"), [(30, 34), (40, 54), (0, 4), (0, 0), (75, 79), (50, 50)]
)
def test_identities_of_a_lost_tracker_are_no_poses(rng, first, last):
    true, poses = recorded_walk(rng)
    spoilt = poses.copy()
    spoilt[first : last + 1] = np.eye(4)
    tracking = judged(spoilt, measure(true, rng))
    (found,) = tracking.breaks
    assert (found.kind, found.first_frame, found.last_frame) == ("lost", first, last)
    assert found.finding.kind is PoseKind.POSES_LOST
    assert found.finding.facts["lost_count"] == last - first + 1
    assert errors_m(tracking.world_from_cams, true).max() < 0.3
    # The world's axes are those of most of the walk, not of the identity.
    others = np.setdiff1d(np.arange(80), np.arange(first, last + 1))
    assert np.abs(tracking.world_from_cams[others] - poses[others]).max() < 1e-9


def test_a_walk_that_begins_at_the_origin_is_not_lost(rng):
    true, poses = recorded_walk(rng)
    poses = se3.inverse(poses[0]) @ poses
    tracking = judged(poses, measure(true, rng))
    assert tracking.breaks == ()
    assert np.array_equal(tracking.world_from_cams, poses)


def test_standing_at_the_origin_is_not_lost(rng):
    true = walk(rng)
    true[:12] = true[0]
    poses = se3.inverse(true[0]) @ true
    tracking = judged(poses, measure(true, rng))
    assert tracking.breaks == ()
    assert np.array_equal(tracking.world_from_cams, poses)


@pytest.mark.parametrize(
    "frozen", [((1, 10),), ((70, 79),), ((20, 26), (50, 60)), ((20, 26), (30, 36))]
)
def test_frozen_at_the_ends_and_twice(rng, frozen):
    true, poses = recorded_walk(rng)
    spoilt = poses
    for first, last in frozen:
        spoilt = with_frozen(spoilt, first, last)
    tracking = judged(spoilt, measure(true, rng))
    assert [b.kind for b in tracking.breaks] == ["frozen"] * len(frozen)
    assert errors_m(tracking.world_from_cams, true).max() < 0.35


def test_lost_frames_do_not_make_the_tracker_noisy(rng):
    """Forty frozen frames made the sigmas of all steps three times wider."""
    true, poses = recorded_walk(rng, 120)
    tracking = judged(with_frozen(poses, 31, 70), measure(true, rng))
    assert max(tracking.sigma_factors) < 1.5


def test_poses_that_never_change_are_said_to_say_nothing(rng):
    true, poses = recorded_walk(rng)
    tracking = judged(np.repeat(poses[:1], 80, axis=0), measure(true, rng))
    assert tracking.breaks == ()
    assert tracking.doubt is not None
    assert tracking.doubt.kind is PoseKind.POSES_REPEAT
    assert tracking.doubt.facts == {"repeated_count": 79, "frame_count": 80}
    assert tracking.doubt in tracking.findings
    still = np.repeat(poses[:1], 80, axis=0)
    assert judged(still, measure(still, rng)).doubt is None


@pytest.mark.parametrize("images_a_pose", [1.4, 2.0, 3.0, 3.5])
def test_poses_at_a_lower_rate_than_images_are_read_between(rng, images_a_pose):
    """Three images a pose ended 12 m off, with 45 lines of jumps that were corrected."""
    whole, part = np.divmod(np.arange(120) / 6, 1)
    coarse, at = walk(rng, 25), whole.astype(int)
    true = se3.interpolate(coarse[at], coarse[at + 1], part)
    first = np.unique(np.floor(np.arange(120) / images_a_pose), return_index=True)[1]
    held = true[first[np.searchsorted(first, np.arange(120), side="right") - 1]]
    tracking = judged(held, measure(true, rng))
    assert tracking.breaks == ()
    assert tracking.doubt is None
    assert tracking.n_held == 120 - len(first)
    assert PoseKind.POSES_HELD in [each.kind for each in tracking.findings]
    before, after = (errors_m(each, true) for each in (held, tracking.world_from_cams))
    assert np.median(after) < 0.3 * np.median(before)
    assert np.allclose(tracking.recorded_world_from_cams[first], true[first])


def test_images_that_repeat_with_their_poses_are_no_lower_rate(rng):
    true, poses = recorded_walk(rng, 40)
    twice = np.repeat(poses, 2, axis=0)
    tracking = judged(twice, measure(np.repeat(true, 2, axis=0), rng))
    assert tracking.n_held == 0
    assert np.array_equal(tracking.world_from_cams, twice)


@pytest.mark.parametrize("n", [1, 2, 5])
def test_images_that_tell_nothing_leave_poses_as_they_are(rng, n):
    poses = np.repeat(walk(rng, 2)[:1], n, axis=0)
    none = measure(walk(rng, 8), rng)[np.zeros(0, dtype=int)]
    tracking = judged(poses, none)
    assert np.array_equal(tracking.world_from_cams, poses)
    assert (tracking.breaks, tracking.unplaced, tracking.doubt) == ((), (), None)
