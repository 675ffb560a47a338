"""Every search for the nearest face against its plain twin."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import random_transforms, twin_nearest
from planfit.floorplan import Floorplan, nearest_faces
from planfit.floorplan.nearest_faces import make_face_grid, nearest_beside
from planfit.geometry import se3, segments

ENDS = np.array([[[0, 0], [3, 4]], [[2, 2], [2, -2]]], dtype=float)


def nearest_distance_twin(xy, ends):
    """Every point against every segment, in NumPy."""
    along = ends[:, 1] - ends[:, 0]
    relative = xy[:, None] - ends[None, :, 0]
    length_sq = np.sum(along**2, axis=1)
    t = np.sum(relative * along, axis=2) / np.where(length_sq > 0, length_sq, 1.0)
    foot = np.clip(t, 0, 1)[..., None] * along
    return np.linalg.norm(relative - foot, axis=2).min(axis=1)


def test_nearest_distance_equals_its_twin(rng):
    ends = rng.uniform(-5, 5, (30, 2, 2))
    ends[4, 1] = ends[4, 0]  # a point
    xy = np.concatenate([rng.uniform(-8, 8, (300, 2)), ends.reshape(-1, 2), ends.mean(axis=1)])
    expected = nearest_distance_twin(xy, ends)
    assert_allclose(nearest_faces.nearest_distance(xy, ends), expected, atol=1e-12)


def test_ends_belong_to_a_segment():
    xy = np.array([[-3.0, -4.0], [6.0, 8.0], [0.0, 0.0]])
    assert_allclose(nearest_faces.nearest_distance(xy, ENDS[:1]), [5, 5, 0])


@pytest.mark.parametrize("laid_out", [lambda a: a, np.asfortranarray, lambda a: a[::-1][::-1]])
def test_memory_layout_does_not_matter(rng, laid_out):
    xy, ends = rng.uniform(-5, 5, (20, 2)), rng.uniform(-5, 5, (4, 2, 2))
    expected = nearest_distance_twin(xy, ends)
    assert_allclose(nearest_faces.nearest_distance(laid_out(xy), laid_out(ends)), expected)
    found = nearest_faces.nearest_distance(xy.astype(np.float32), ends)
    assert_allclose(found, expected, atol=1e-5)


def test_no_points_and_no_segments():
    assert nearest_faces.nearest_distance(np.zeros((0, 2)), ENDS).shape == (0,)
    assert_array_equal(
        nearest_faces.nearest_distance(np.zeros((1, 2)), np.zeros((0, 2, 2))), [np.inf]
    )


def test_nearest_beside_against_one_sample_at_a_time(rng):
    ends = rng.uniform(0, 10, (15, 2, 2))
    ends[10:] = ends[:5] + 0.15
    plan = Floorplan.from_segments(ends, name="random")
    assert 0 < plan.is_oriented.sum() < 15
    xy = rng.uniform(0, 10, (200, 2))
    angle = rng.uniform(0, 2 * np.pi, 200)
    normals = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    distance, face = nearest_beside(xy, normals, plan.ends, plan.normals, plan.is_oriented, 1.0)
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


@pytest.mark.parametrize("reach_m", [0.3, 2.0, 500.0])
@pytest.mark.parametrize("oriented", [False, True])
def test_the_grid_finds_what_trying_all_faces_finds(reach_m, oriented, rng):
    middle, heading = rng.uniform(0, 20, (60, 2)), rng.uniform(0, 2 * np.pi, 60)
    half = np.stack([np.cos(heading), np.sin(heading)], axis=1) * rng.uniform(0.05, 4, (60, 1))
    ends = np.stack([middle - half, middle + half], axis=1)
    floorplan = Floorplan("some", ends, segments.left_normals(ends), rng.random(60) < 0.7)
    points = np.column_stack([rng.uniform(-4, 24, (900, 2)), rng.uniform(0, 2, 900)])
    start = np.arange(0, 901, 30)
    cams = random_transforms(rng, 30)
    in_cams = se3.transform(se3.inverse(cams), points.reshape(30, 30, 3)).reshape(-1, 3)
    towards = rng.normal(size=(30, 2))
    grid = make_face_grid(floorplan, reach_m, oriented)
    face, feet, gaps = grid.nearest(in_cams, start, cams, towards)
    is_allowed = np.ones((900, 60), dtype=bool)
    if oriented:
        from_front = np.repeat(towards @ floorplan.normals.T > 0, 30, axis=0)
        is_allowed = from_front | ~floorplan.is_oriented
    expected, expected_feet, distance = twin_nearest(points[:, :2], floorplan, is_allowed)
    found = distance < reach_m
    assert found.sum() > 0
    assert_array_equal(face, np.where(found, expected, -1))
    assert_allclose(feet[found], expected_feet[found], atol=1e-9)
    assert_allclose(gaps[found], (points[:, :2] - expected_feet)[found], atol=1e-9)
