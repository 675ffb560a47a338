"""Moving one place until the walls lie on the faces."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import room_plan
from planfit.align.refine import SCORE_SIGMA_M, nearest_faces, refine_fit
from planfit.floorplan import make_floorplan
from planfit.geometry import segments


@pytest.fixture
def samples():
    plan = room_plan()
    xy, face = segments.sample(plan.ends, 0.1)
    return xy, plan.normals[face]


def test_a_near_start_ends_at_the_truth(samples):
    fit = refine_fit(*samples, room_plan(), 0.08, np.array([0.3, -0.25]))
    assert fit.score == pytest.approx(1.0, abs=1e-6)
    assert_allclose(fit.shift, 0.0, atol=1e-3)
    assert fit.yaw == pytest.approx(0.0, abs=1e-4)
    assert_allclose(fit.transform, np.eye(4), atol=1e-3)


def test_the_score_is_the_mean_closeness(samples):
    xy, normals = samples
    # Walls that the plan has 0.15 m further in, all four: no motion mends it.
    plan = room_plan(6.0 - 0.3, 4.0 - 0.3)
    fit = refine_fit(xy, normals, plan, 0.0, np.array([-0.15, -0.15]))
    assert fit.score == pytest.approx(np.exp(-0.5 * (0.15 / SCORE_SIGMA_M) ** 2), rel=0.02)


def test_a_place_off_the_plan_scores_zero(samples):
    assert refine_fit(*samples, room_plan(), 0.0, np.array([100.0, 0.0])).score == 0.0


def test_nearest_faces_against_one_sample_at_a_time(rng):
    ends = rng.uniform(0, 10, (15, 2, 2))
    ends[10:] = ends[:5] + 0.15
    plan = make_floorplan("random", ends)
    assert 0 < plan.is_oriented.sum() < 15
    xy = rng.uniform(0, 10, (200, 2))
    angle = rng.uniform(0, 2 * np.pi, 200)
    normals = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    distance, face = nearest_faces(xy, normals, plan, 1.0)
    expected = np.full(200, -1)
    for m in range(200):
        best = 1.0
        for n in range(15):
            along = (ends[n, 1] - ends[n, 0]) / np.linalg.norm(ends[n, 1] - ends[n, 0])
            at = (xy[m] - ends[n, 0]) @ along
            off = (xy[m] - ends[n, 0]) @ plan.normals[n]
            cosine = normals[m] @ plan.normals[n]
            cosine = cosine if plan.is_oriented[n] else abs(cosine)
            beside = -0.3 < at < np.linalg.norm(ends[n, 1] - ends[n, 0]) + 0.3
            if cosine > np.cos(np.deg2rad(25)) and beside and abs(off) < best:
                best, expected[m] = abs(off), n
        if expected[m] >= 0:
            assert abs(distance[m]) == pytest.approx(best)
    assert_array_equal(face, expected)
