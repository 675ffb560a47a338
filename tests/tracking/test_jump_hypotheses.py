"""One jump, several steps that could hold it: what the walk would be with the jump at each."""

from dataclasses import replace

import numpy as np
import pytest
from measured_walk import LAP, displaced, measure, three_laps

from builders import make_matches
from planfit.geometry import se3
from planfit.pipeline.jumps import jump_hypotheses
from planfit.scan.odometry import OdometryOptions
from planfit.tracking import TrackingOptions, judge_tracking


@pytest.fixture
def rng():
    return np.random.default_rng(5)


@pytest.fixture
def laps(rng):
    return three_laps(rng)


def hypotheses(laps, poses, rng, undecided):
    """With revisits between the first lap and the third, which is after all undecided steps."""
    motions = measure(laps, rng, unmeasured=tuple(undecided))
    judged = judge_tracking(poses, motions, "recorded", OdometryOptions(), TrackingOptions())
    tracking = replace(judged, undecided_steps=np.array(undecided))
    points = rng.uniform([-5, -5, -1], [5, 5, 1], (40, 3))
    matches = make_matches(laps, [(i, i + 2 * LAP) for i in range(12, 28)], points)
    return jump_hypotheses(tracking, matches)


def test_one_of_the_hypotheses_is_the_walk_as_it_was(laps, rng):
    jumped = displaced(laps, 41, len(laps) - 1, 5.0, 60.0, rng)
    right, wrong = hypotheses(laps, jumped, rng, [40, 60])
    assert (right.step, wrong.step) == (40, 60)
    off, off_wrong = (
        np.linalg.norm((each.tracking.world_from_cams - laps)[:, :3, 3], axis=1)
        for each in (right, wrong)
    )
    assert off.max() < 0.15
    assert off_wrong[61:].max() < 0.15  # the loops close there as well
    assert off_wrong[41:61].min() > 1.0  # and the frames between stand elsewhere
    assert right.cost < wrong.cost
    (told,) = right.tracking.breaks
    assert told.finding.facts["witness"] == "revisits and the plan"
    steps = right.tracking.odometry.cam_from_next
    np.testing.assert_allclose(
        steps[40],
        se3.inverse(right.tracking.world_from_cams[40]) @ right.tracking.world_from_cams[41],
        atol=1e-9,
    )
    assert right.tracking.undecided_steps.tolist() == [60]


def test_a_walk_that_closes_as_recorded_has_none(laps, rng):
    assert hypotheses(laps, laps, rng, [40, 60]) == ()


def test_a_jump_over_a_gap_is_not_put_on_the_short_step_beside_it(laps, rng):
    # Frames 42 to 46 are missing: the step onto frame 47 is long beforehand, and longer with the jump. Undone
    # on the step before, it would make that one shorter than the gap is, and leave the longer one as it is.
    kept = np.delete(np.arange(len(laps)), np.arange(42, 47))
    walk = laps[kept]
    ahead = walk[41, :3, 3] - walk[40, :3, 3]
    jumped = walk.copy()
    jumped[42:, :3, 3] += 4.0 * ahead
    motions = measure(walk, rng, unmeasured=(40, 41))
    judged = judge_tracking(jumped, motions, "recorded", OdometryOptions(), TrackingOptions())
    tracking = replace(judged, undecided_steps=np.array([40, 41]))
    pairs = [(i, int(np.flatnonzero(kept == i + 2 * LAP)[0])) for i in range(12, 28)]
    points = rng.uniform([-5, -5, -1], [5, 5, 1], (40, 3))
    wrong, right = jump_hypotheses(tracking, make_matches(walk, pairs, points))
    length = [
        np.linalg.norm(each.tracking.odometry.cam_from_next[each.step, :3, 3])
        for each in (wrong, right)
    ]
    assert length[0] < length[1]
    assert right.cost < wrong.cost
