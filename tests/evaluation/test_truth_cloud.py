"""NND and its registration against known motions and a slow twin."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose

from planfit.errors import ScanError
from planfit.evaluation import make_true_cloud, nearest_neighbours, read_true_cloud
from planfit.geometry import se3


def room(rng, n, sigma_m=0.0):
    """Points on the floor, four walls and a box in a room of 5 by 4 by 2.5 m."""
    points = rng.uniform(0, 1, (n, 3)) * [5.0, 4.0, 2.5]
    side = np.arange(n) % 5
    points[side == 0, 2] = 0.0
    for k, (axis, at) in enumerate([(0, 0.0), (0, 5.0), (1, 0.0), (1, 4.0)], start=1):
        points[side == k, axis] = at
    box = rng.uniform(0, 1, (n // 5, 3)) * [0.8, 0.5, 0.9] + [1.0, 1.0, 0.0]
    box[:, 2] = 0.9
    return np.concatenate([points, box]) + sigma_m * rng.normal(size=(n + n // 5, 3))


def slow_nnd(points, truth):
    return np.mean([np.linalg.norm(truth - point, axis=1).min() for point in points])


MOTION = se3.make_transform(
    se3.exp_so3(np.array([0.02, -0.03, 0.06])), np.array([0.15, -0.1, 0.08])
)


def test_all_pairs_give_the_same_where_nothing_is_to_register(rng):
    truth, points = room(rng, 4000), room(rng, 300, 0.01)
    found = nearest_neighbours(points, make_true_cloud(truth, 0.3))
    assert found.unregistered_m == pytest.approx(slow_nnd(points, truth))
    moved = se3.transform(found.truth_from_map, points)
    assert found.nnd_m == pytest.approx(slow_nnd(moved, truth))


def test_a_rigid_motion_is_found_and_taken_out(rng):
    truth, points = room(rng, 30_000), room(rng, 3000)
    moved = se3.transform(se3.inverse(MOTION), points)
    found = nearest_neighbours(moved, make_true_cloud(truth, 0.2))
    assert_allclose(found.truth_from_map, MOTION, atol=2e-3)
    assert found.unregistered_m > 2 * found.nnd_m
    assert found.nnd_m == pytest.approx(slow_nnd(rng.permutation(points)[:500], truth), rel=0.15)


def test_a_start_further_away_is_enough(rng):
    truth, points = room(rng, 30_000), room(rng, 3000)
    far = se3.make_transform(np.eye(3), np.array([30.0, 5.0, 0.0]))
    moved = se3.transform(se3.inverse(MOTION @ far), points)
    cloud = make_true_cloud(truth, 0.2)
    assert nearest_neighbours(moved, cloud).nnd_m > 1.0
    found = nearest_neighbours(moved, cloud, far)
    assert_allclose(se3.transform(found.truth_from_map, moved), points, atol=5e-3)


def test_a_bent_map_stays_bent(rng):
    truth, points = room(rng, 30_000), room(rng, 3000)
    bent = points.copy()
    bent[:, 1] += 0.02 * bent[:, 0] ** 2
    cloud = make_true_cloud(truth, 0.2)
    assert nearest_neighbours(bent, cloud).nnd_m > 1.5 * nearest_neighbours(points, cloud).nnd_m


def test_a_part_of_the_building_is_registered_too(rng):
    truth, points = room(rng, 30_000), room(rng, 8000)
    part = points[points[:, 0] < 2.0]
    found = nearest_neighbours(
        se3.transform(se3.inverse(MOTION), part), make_true_cloud(truth, 0.2)
    )
    assert_allclose(found.truth_from_map, MOTION, atol=5e-3)


def test_clouds_and_meshes_are_read(tmp_path: Path, rng):
    box = trimesh.creation.box((2.0, 3.0, 1.0))
    box.export(tmp_path / "mesh.ply")
    trimesh.PointCloud(rng.normal(size=(500, 3))).export(tmp_path / "points.ply")
    mesh = read_true_cloud(tmp_path / "mesh.ply", 0.1)
    assert len(mesh.points) == pytest.approx(box.area / 0.1**2, abs=1)
    on_face = np.abs(np.abs(mesh.points) - [1.0, 1.5, 0.5]).min(axis=1)
    assert_allclose(on_face, 0.0, atol=1e-9)
    assert np.array_equal(mesh.points, read_true_cloud(tmp_path / "mesh.ply", 0.1).points)
    assert len(read_true_cloud(tmp_path / "points.ply", 0.1).points) == 500


def test_bad_files(tmp_path: Path):
    with pytest.raises(ScanError, match=r"none.ply: expected a true scan .*, found nothing"):
        read_true_cloud(tmp_path / "none.ply", 0.05)
    (tmp_path / "bad.ply").write_text("no ply")
    with pytest.raises(ScanError, match=r"bad.ply: expected a point cloud or mesh, found"):
        read_true_cloud(tmp_path / "bad.ply", 0.05)
    trimesh.PointCloud(np.eye(3)).export(tmp_path / "few.ply")
    with pytest.raises(ScanError, match=r"few.ply: expected a true scan, found 3 points"):
        read_true_cloud(tmp_path / "few.ply", 0.05)
