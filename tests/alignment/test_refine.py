"""Moving one alignment until the walls lie on the faces."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import room_plan
from planfit.alignment.refine import (
    OCCLUDED_WEIGHT,
    SCORE_SIGMA_M,
    AlignmentHypothesis,
    RefineSteps,
    explained,
    jackknife_covariance,
    refine_hypothesis,
    segment_scores,
)
from planfit.alignment.visibility import OCCLUSION_MARGIN_M, is_occluded
from planfit.alignment.wall_samples import WallSamples, thin
from planfit.geometry import segments


@pytest.fixture
def samples():
    plan = room_plan()
    xy, face = segments.sample(plan.ends, 0.1)
    return WallSamples(xy, plan.normals[face])


def refined(walls, plan, yaw, translation, n_scales=0, scale=1.0):
    start = AlignmentHypothesis(yaw, np.array(translation, dtype=float), 0.0, (scale, scale))
    steps = RefineSteps(n_scales=n_scales)
    return refine_hypothesis(walls, plan, start, steps)


def test_a_near_start_ends_at_the_truth(samples):
    refined_one = refined(samples, room_plan(), 0.08, [0.3, -0.25])
    assert refined_one.score == pytest.approx(1.0, abs=1e-6)
    assert_allclose(refined_one.translation, 0.0, atol=1e-3)
    assert refined_one.yaw == pytest.approx(0.0, abs=1e-4)
    assert_allclose(refined_one.plan_from_level, np.eye(4), atol=1e-3)


def test_the_score_is_the_mean_closeness(samples):
    # Walls that the plan has 0.15 m further in, all four: no motion mends it.
    plan = room_plan(6.0 - 0.3, 4.0 - 0.3)
    refined_one = refined(samples, plan, 0.0, [-0.15, -0.15])
    assert refined_one.score == pytest.approx(np.exp(-0.5 * (0.15 / SCORE_SIGMA_M) ** 2), rel=0.02)


def test_an_alignment_off_the_plan_scores_zero(samples):
    assert refined(samples, room_plan(), 0.0, [100.0, 0.0]).score == 0.0


def test_one_scale_is_refined_with_yaw_and_translation(samples):
    plan = replace(room_plan(), ends=room_plan().ends * 40.0, is_metric=False)
    refined_one = refined(samples, plan, 0.05, [0.2, -0.1], n_scales=1, scale=0.025 * 1.03)
    assert refined_one.scale_xy == pytest.approx((0.025, 0.025), rel=1e-5)
    assert refined_one.score == pytest.approx(1.0, abs=1e-5)
    assert_allclose(refined_one.translation, 0.0, atol=1e-3)


def test_two_scales_are_refined_apart(samples):
    plan = room_plan(6.0 / 0.5, 4.0 / 0.52)
    refined_one = refined(samples, plan, 0.0, [0.1, 0.1], n_scales=2, scale=0.51)
    assert refined_one.scale_xy == pytest.approx((0.5, 0.52), rel=1e-4)
    assert refined(samples, plan, 0.0, [0.1, 0.1], n_scales=1, scale=0.51).score < 0.99


def test_a_known_scale_stays(samples):
    plan = replace(room_plan(), ends=room_plan().ends * 40.0)
    assert refined(samples, plan, 0.0, [0, 0], n_scales=0, scale=0.0252).scale_xy == (
        0.0252,
        0.0252,
    )


def test_occluded_wall_counts_less(samples):
    # The camera stands left of a wall that the plan draws across the room.
    eyes = np.tile([1.0, 2.0], (len(samples.xy), 1))
    walls = replace(samples, seen_from=eyes)
    room = room_plan()
    wall = np.array([[[3.0, 0.5], [3.0, 3.5]]])
    plan = replace(
        room,
        ends=np.concatenate([room.ends, wall]),
        normals=np.concatenate([room.normals, [[-1.0, 0.0]]]),
        is_oriented=np.ones(5, dtype=bool),
    )
    hypothesis = AlignmentHypothesis(0.0, np.zeros(2), 0.0)
    free, crossed_free = explained(walls, room, hypothesis)
    barred, crossed = explained(walls, plan, hypothesis)
    assert (free, crossed_free) == (pytest.approx(1.0), 0.0)
    assert 0.2 < crossed < 0.6
    assert barred == pytest.approx(1.0 - (1.0 - OCCLUDED_WEIGHT) * crossed)


def test_occlusion_against_one_at_a_time(rng):
    ends = rng.uniform(0, 10, (12, 2, 2))
    eyes, xy = rng.uniform(0, 10, (300, 2)), rng.uniform(0, 10, (300, 2))
    expected = np.zeros(300, dtype=bool)
    for m in range(300):
        reach = np.linalg.norm(xy[m] - eyes[m])
        for a, b in ends:
            matrix = np.column_stack([xy[m] - eyes[m], a - b])
            t, u = np.linalg.solve(matrix, a - eyes[m])
            margin = min(0.3, 0.25 * np.linalg.norm(b - a))
            along, across = t * reach, u * np.linalg.norm(b - a)
            inside = margin < across < np.linalg.norm(b - a) - margin
            if OCCLUSION_MARGIN_M < along < reach - OCCLUSION_MARGIN_M and inside:
                expected[m] = True
    assert 50 < expected.sum() < 290
    assert_array_equal(is_occluded(eyes, xy, ends), expected)


def test_leaving_out_segments_shows_a_deformation(samples):
    straight = jackknife_covariance(
        samples,
        room_plan(),
        AlignmentHypothesis(0.0, np.zeros(2), 0.0),
        RefineSteps(),
    )
    xy = samples.xy.copy()
    xy[: len(xy) // 3] += [0.0, 0.25]
    deformed = jackknife_covariance(
        replace(samples, xy=xy),
        room_plan(),
        AlignmentHypothesis(0.0, np.zeros(2), 0.0),
        RefineSteps(),
    )
    assert np.sqrt(np.trace(straight)) < 0.01
    assert np.sqrt(np.trace(deformed)) > 0.03


def test_segment_scores_point_at_the_segment_that_does_not_fit(samples):
    xy = samples.xy.copy()
    xy[-len(xy) // 5 :] += 50.0
    scores = segment_scores(
        replace(samples, xy=xy),
        room_plan(),
        AlignmentHypothesis(0.0, np.zeros(2), 0.0),
    )
    assert_allclose(scores, [1, 1, 1, 1, 0], atol=0.03)


def test_thinning_keeps_the_order_and_tempers_what_was_seen_often(samples):
    often = WallSamples(np.tile(samples.xy[:1], (100, 1)), np.tile(samples.normals[:1], (100, 1)))
    both = WallSamples(
        np.concatenate([samples.xy[5:], often.xy]),
        np.concatenate([samples.normals[5:], often.normals]),
    )
    thinned = thin(both, 1000)
    assert_array_equal(thinned.xy[:-1], samples.xy[5:])
    assert thinned.worth[-1] == pytest.approx(10.0)
    assert len(thin(both, 50).xy) <= 50
