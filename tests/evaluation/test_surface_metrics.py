"""NSD, the oriented NSD and the flatness of the floor, by hand and against NumPy twins."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import faces_plan, look, make_structure, make_world, nudged, room_plan
from planfit.evaluation import floor_heights, near_share, wall_distances, wall_points
from planfit.floorplan import Floorplan, nearest_faces
from planfit.floorplan.nearest_faces import facing_distances
from planfit.geometry import se3, segments


def slow_distances(xy, eyes_xy, floorplan):
    """One point and one face at a time."""
    result = np.full((len(xy), 2), np.inf)
    for m, point in enumerate(xy):
        for n, (a, b) in enumerate(floorplan.ends):
            t = np.clip((point - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
            distance = np.linalg.norm(point - (a + t * (b - a)))
            result[m, 0] = min(result[m, 0], distance)
            before = floorplan.normals[n] @ (eyes_xy[m] - a) > 0
            if before or not floorplan.is_oriented[n]:
                result[m, 1] = min(result[m, 1], distance)
    return result


def thick_wall(thickness_m=0.2):
    """One wall along x, two faces that look away from each other."""
    ends = np.array([[[0.0, 0.0], [5.0, 0.0]], [[5.0, thickness_m], [0.0, thickness_m]]])
    return Floorplan("wall", ends, np.array([[0.0, -1.0], [0.0, 1.0]]), np.ones(2, dtype=bool))


def test_against_all_pairs(rng):
    n = 30
    ends = rng.uniform(-5, 5, (n, 2, 2))
    plan = Floorplan("any", ends, segments.left_normals(ends), rng.random(n) < 0.7)
    xy, eyes = rng.uniform(-6, 6, (2, 400, 2))
    found = facing_distances(xy, eyes, plan)
    assert_allclose(found, slow_distances(xy, eyes, plan), atol=1e-12)
    assert_allclose(found[:, 0], nearest_faces.nearest_distance(xy, plan.ends), atol=1e-12)


def test_by_hand():
    # Seen from below (y < 0), at y = 0.15: 5 cm from the far face, 15 cm from the one that was seen.
    found = facing_distances(np.array([[2.0, 0.15]]), np.array([[2.0, -1.0]]), thick_wall())
    assert_allclose(found, [[0.05, 0.15]])
    # Past the end of a segment the distance is that to its end.
    found = facing_distances(np.array([[8.0, -4.0]]), np.array([[8.0, -6.0]]), thick_wall())
    assert_allclose(found, [[5.0, 5.0]])


def test_faces_without_a_side_count_from_both():
    plan = replace(thick_wall(), is_oriented=np.array([True, False]))
    found = facing_distances(np.array([[2.0, 0.15]]), np.array([[2.0, -1.0]]), plan)
    assert_allclose(found, [[0.05, 0.05]])


def test_where_no_face_looks_at_the_eye():
    plan = replace(thick_wall())
    between = np.array([[2.0, 0.1]])
    assert np.isinf(facing_distances(between, between, plan)[0, 1])


def structure_of_a_wall(poses, y_m, n=200):
    x = np.linspace(1, 4, n)
    points = np.stack([x, np.full(n, y_m), np.linspace(0.2, 2.0, n)], axis=1)
    return make_structure(poses, patches=[(0, points, [0.0, -1.0])])


def test_a_wall_fitted_to_the_wrong_face_shows_in_the_oriented_nsd_alone():
    poses = look([2.5, -2.0, 1.4], 90)[None]
    structure = structure_of_a_wall(
        poses, 0.2
    )  # lies on the far face, which cannot be seen from here
    found = wall_distances(structure, thick_wall(), poses)
    assert found.nsd_m == pytest.approx(0.0, abs=1e-9)
    assert found.oriented_nsd_m == pytest.approx(0.2, abs=1e-9)
    assert found.n_points == 200


def test_nsd_follows_the_poses():
    poses = look([3.0, 2.0, 1.4], 90)[None]
    points = np.stack([np.linspace(1, 5, 50), np.full(50, 4.0), np.full(50, 1.0)], axis=1)
    structure = make_structure(poses, patches=[(0, points, [0.0, -1.0])])
    moved = poses.copy()
    moved[:, 1, 3] += 0.07
    assert wall_distances(structure, room_plan(), poses).nsd_m == pytest.approx(0.0, abs=1e-9)
    found = wall_distances(structure, room_plan(), moved)
    assert found.nsd_m == found.oriented_nsd_m == pytest.approx(0.07)


def test_points_are_transformed_in_chunks_that_change_nothing(monkeypatch):
    poses = look([2.5, -2.0, 1.4], 90)[None]
    structure = structure_of_a_wall(poses, 0.03)
    whole = wall_distances(structure, thick_wall(), poses)
    monkeypatch.setattr("planfit.geometry.se3.POINTS_AT_A_TIME", 7)
    parts = wall_distances(structure, thick_wall(), poses)
    assert_array_equal(parts.nearest_m, whole.nearest_m)
    assert_array_equal(parts.facing_m, whole.facing_m)
    assert_array_equal(wall_distances(structure, thick_wall(), poses, 3).nearest_m, whole.nearest_m)


def test_no_walls_no_metric():
    poses = look([0, 0, 1.4], 0)[None]
    assert wall_distances(make_structure(poses), room_plan(), poses) is None
    assert floor_heights(make_structure(poses), poses) is None


def floor_of_points(rng, n=500, tilt=0.0, sigma_m=0.0):
    xy = rng.uniform(-3, 3, (n, 2))
    return np.concatenate([xy, (tilt * xy[:, :1] + sigma_m * rng.normal(size=(n, 1)))], axis=1)


def test_a_leaning_floor_is_flat_about_its_plane_only(rng):
    poses = look([0, 0, 1.4], 0, 30)[None]
    points = floor_of_points(rng, tilt=0.02)
    found = floor_heights(make_structure(poses, floor=[(0, points)]), poses)
    assert found.plane_rms_m == pytest.approx(0.0, abs=1e-9)
    assert found.height_rms_m == pytest.approx(np.std(points[:, 2]), rel=1e-9)


def test_noise_of_the_floor_shows_in_both(rng):
    poses = look([0, 0, 1.4], 0, 30)[None]
    points = floor_of_points(rng, 5000, sigma_m=0.01)
    found = floor_heights(make_structure(poses, floor=[(0, points)]), poses)
    assert found.plane_rms_m == pytest.approx(0.01, rel=0.05)
    design = np.column_stack([points[:, :2], np.ones(5000)])
    residual = points[:, 2] - design @ np.linalg.lstsq(design, points[:, 2], rcond=None)[0]
    assert found.plane_rms_m == pytest.approx(np.sqrt(np.mean(residual**2)), rel=1e-9)
    assert found.height_rms_m >= found.plane_rms_m


def test_storeys_are_floors_of_their_own_and_stairs_are_none(rng):
    poses = np.stack([look([0, 0, 1.4 + z], 0, 30) for z in (0.0, 1.5, 3.0)])
    floors = [
        (i, floor_of_points(rng) + np.array([0, 0, z])) for i, z in enumerate((0.0, 1.5, 3.0))
    ]
    structure = make_structure(poses, floor=floors)
    structure = replace(structure, floor_heights_m=np.array([0.0, np.nan, 3.0]))
    found = floor_heights(structure, poses)
    assert found.height_rms_m == pytest.approx(0.0, abs=1e-9)
    assert found.height_median_m == pytest.approx(0.0, abs=1e-9)
    assert found.n_points == 1000


def test_walls_of_a_rotated_room_count_the_same(rng):
    transform = se3.yaw_transform(0.7, np.array([3.0, -2.0, 0.0]))
    corners = np.array([[0, 0, 0], [6, 0, 0], [6, 4, 0], [0, 4, 0]], dtype=float)
    plan = faces_plan(se3.transform(transform, corners)[:, :2])
    poses = look([3.0, 2.0, 1.4], 90)[None]
    points = np.stack([rng.uniform(1, 5, 50), np.full(50, 4.05), np.full(50, 1.0)], axis=1)
    structure = make_structure(poses, patches=[(0, points, [0.0, -1.0])])
    found = wall_distances(structure, plan, transform @ poses)
    assert found.nsd_m == pytest.approx(0.05)


def test_wall_points_are_all_there_and_on_the_plan(rng):
    world = make_world(rng)
    points = wall_points(world.structure, world.plan_from_cams)
    assert len(points) == len(world.structure.walls.points_cam)
    found = wall_distances(world.structure, world.floorplan, world.plan_from_cams)
    assert_allclose(found.nearest_m, 0, atol=1e-9)
    assert found.near_share == 1.0
    unassigned = replace(
        world.structure,
        unassigned_points_cam=se3.transform(
            se3.inverse(world.plan_from_cams[2]), np.array([[3.0, 2.0, 1.0]])
        ),
        unassigned_frame_idx=np.array([2]),
    )
    assert_allclose(wall_points(unassigned, world.plan_from_cams)[-1], [3, 2, 1])
    found = wall_distances(unassigned, world.floorplan, world.plan_from_cams)
    assert found.nearest_m[-1] == found.nearest_m.max() == pytest.approx(2.0)
    assert found.near_share == pytest.approx(1 - 1 / found.n_points)


def test_floor_heights_follow_each_frame(rng):
    world = make_world(rng)
    assert_allclose(floor_heights(world.structure, world.plan_from_cams).heights_m, 0, atol=1e-9)
    raised = world.plan_from_cams.copy()
    raised[4, 2, 3] += 0.2
    expected = np.where(world.structure.floor.frame_idx == 4, 0.2, 0.0)
    found = floor_heights(world.structure, raised)
    assert_allclose(found.heights_m, expected, atol=1e-9)
    assert found.height_median_m == pytest.approx(np.median(expected), abs=1e-9)
    assert found.height_rms_m == pytest.approx(np.std(expected))


def test_no_point_is_left_out_however_many_there_are(rng):
    """A sample's mean would differ with where its thinning begins."""
    poses = look([3.0, 2.0, 1.4], 90)[None]
    n = 70_001
    points = np.stack([rng.uniform(1, 5, n), 4.0 + rng.normal(0, 0.05, n), np.ones(n)], axis=1)
    structure = make_structure(poses, patches=[(0, points, [0.0, -1.0])])
    found = wall_distances(structure, room_plan(), poses)
    assert found.n_points == n
    assert found.nsd_m == pytest.approx(np.abs(points[:, 1] - 4.0).mean(), rel=1e-9)
    assert found.near_share == np.mean(np.abs(points[:, 1] - 4.0) < 0.1)


def test_the_share_of_near_points_alone_is_that_of_all_distances(rng, monkeypatch):
    monkeypatch.setattr("planfit.geometry.se3.POINTS_AT_A_TIME", 7)
    world = make_world(rng)
    loose = se3.transform_each(se3.inverse(world.plan_from_cams), rng.uniform(0, 4, (8, 3)))
    structure = replace(
        world.structure, unassigned_points_cam=loose, unassigned_frame_idx=np.arange(8)
    )
    poses = nudged(rng, world.plan_from_cams, 2.0, 0.1)
    found = near_share(structure, world.floorplan, poses)
    assert found == wall_distances(structure, world.floorplan, poses).near_share
    assert 0.1 < found < 0.9
    nothing = make_structure(world.plan_from_cams)
    assert np.isnan(near_share(nothing, world.floorplan, poses))
