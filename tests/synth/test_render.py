"""Rendering: what is seen lies on the true surfaces, and two views agree."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planfit.floorplan import nearest_faces
from planfit.geometry import se3
from planfit.scan import Label
from planfit.synth import BuildingOptions, CameraOptions, SynthOptions, WalkOptions, make_scan
from planfit.synth.noise_field import octaves, value_noise

CAMERA = CameraOptions(width_px=160, height_px=120)


@pytest.fixture(scope="module")
def synthetic():
    return make_scan(SynthOptions(seed=1, camera=CAMERA, building=BuildingOptions(yaw_deg=20.0)))


def view_points(synthetic, frame_idx):
    camera, pose = synthetic.scan.cameras[frame_idx], synthetic.true_plan_from_cams[frame_idx]
    view = synthetic.renderer.render(camera, pose)
    points = se3.transform(pose, camera.lift_image(view.depth).reshape(-1, 3))
    return view, points.reshape(*view.depth.shape, 3)


@pytest.mark.parametrize("frame_idx", range(0, 150, 15))
def test_points_lie_on_the_surfaces_of_their_label(synthetic, frame_idx):
    view, points = view_points(synthetic, frame_idx)
    assert np.isfinite(view.depth).mean() > 0.999
    floor = points[view.labels == Label.FLOOR]
    ceiling = points[view.labels == Label.CEILING]
    assert_allclose(floor[:, 2], 0.0, atol=1e-3)
    assert_allclose(ceiling[:, 2], 2.6, atol=1e-3)
    below_lintels = (view.labels == Label.WALL) & (points[..., 2] < 2.05)
    xy = points[below_lintels][:, :2]
    assert len(xy) > 100
    assert nearest_faces.nearest_distance(xy, synthetic.floorplan.ends).max() < 1e-3


def test_walls_are_seen_from_their_free_side(synthetic):
    view, points = view_points(synthetic, 40)
    plan = synthetic.floorplan
    is_wall = (view.labels == Label.WALL) & (points[..., 2] < 2.05)
    eye = synthetic.true_plan_from_cams[40, :2, 3]
    for xy in points[is_wall][::97, :2]:
        distance = [nearest_faces.nearest_distance(xy[None], ends[None])[0] for ends in plan.ends]
        face = int(np.argmin(distance))
        assert (eye - xy) @ plan.normals[face] > 0


def test_depth_predicts_the_other_view(synthetic):
    camera = synthetic.scan.cameras[0]
    _, points = view_points(synthetic, 30)
    other = synthetic.renderer.render(camera, synthetic.true_plan_from_cams[31])
    cam_from_plan = se3.inverse(synthetic.true_plan_from_cams[31])
    points_cam = se3.transform(cam_from_plan, points.reshape(-1, 3))
    uv = camera.project(points_cam)
    column, row = np.rint(np.nan_to_num(uv, nan=-9.0)).astype(int).T
    is_in = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    assert is_in.mean() > 0.4
    difference = other.depth[row[is_in], column[is_in]] - points_cam[is_in, 2]
    # Half a pixel off on a slanted surface, and what one view hides, differ; most does not.
    assert np.mean(np.abs(difference) < 0.02 * points_cam[is_in, 2]) > 0.85


def test_incidence_is_the_cosine_to_the_normal(synthetic):
    camera, pose = synthetic.scan.cameras[0], synthetic.true_plan_from_cams[10]
    view, points = view_points(synthetic, 10)
    is_floor = view.labels == Label.FLOOR
    rays = points[is_floor] - pose[:3, 3]
    expected = -rays[:, 2] / np.linalg.norm(rays, axis=1)
    assert camera.width == view.depth.shape[1]
    assert_allclose(view.incidence[is_floor], expected, atol=1e-4)


def test_columns_have_their_label():
    options = BuildingOptions(n_rooms=4, is_open_plan=True, n_columns=3)
    scan = make_scan(SynthOptions(building=options, camera=CAMERA)).scan
    assert any((scan.files.labels(i) == Label.COLUMN).any() for i in range(0, 150, 10))


def test_colours_are_those_of_the_place_not_of_the_view():
    """Texture sticks to the surface: the same points have the same colour in the next view."""
    synthetic = make_scan(SynthOptions(
        seed=1, camera=CAMERA, walk=WalkOptions(n_frames=2000)))  # fmt: skip
    camera = synthetic.scan.cameras[0]
    view, points = view_points(synthetic, 500)
    other = synthetic.renderer.render(camera, synthetic.true_plan_from_cams[503])
    points_cam = se3.transform(
        se3.inverse(synthetic.true_plan_from_cams[503]), points.reshape(-1, 3)
    )
    uv = camera.project(points_cam).astype(np.float32).reshape(120, 160, 2)
    seen = cv2.remap(other.color, uv[..., 0], uv[..., 1], cv2.INTER_LINEAR)
    inner = (uv > 2).all(axis=-1) & (uv < (157, 117)).all(axis=-1)
    assert np.median(np.abs(seen - view.color)[inner]) < 0.02


def test_sift_finds_keypoints_in_ordinary_views():
    synthetic = make_scan(SynthOptions(seed=0))
    sift = cv2.SIFT_create(contrastThreshold=0.02)
    counts = [
        len(sift.detect(cv2.cvtColor(synthetic.scan.files.color(i), cv2.COLOR_RGB2GRAY), None))
        for i in range(0, 150, 25)
    ]
    assert min(counts) > 200
    assert np.median(counts) > 500


def test_surfaces_do_not_look_alike():
    """Texture of walls of the same colour differs: seeds are unique."""
    synthetic = make_scan(SynthOptions(camera=CAMERA))
    assert len(np.unique(synthetic.renderer.quads.seed)) == len(synthetic.renderer.quads)


def test_noise_is_smooth_and_bounded():
    seed = np.uint64(7)
    line = np.array([value_noise(x, 0.3, seed) for x in np.arange(0, 50, 0.01)])
    assert np.abs(line).max() <= 1.0
    assert np.abs(np.diff(line)).max() < 0.04
    assert 0.2 < np.std(line) < 0.7


def test_detail_finer_than_pixels_is_left_out():
    seed = np.uint64(7)
    x = np.arange(0, 5, 0.01)
    near = np.array([octaves(v, 0.0, seed, 4.0, 5, 0.8, 0.001) for v in x])
    far = np.array([octaves(v, 0.0, seed, 4.0, 5, 0.8, 0.2) for v in x])
    assert np.std(near) > 0.1
    assert_array_equal(far, 0.0)


def test_images_are_seen_the_same_by_a_camera_of_other_size(synthetic):
    camera = synthetic.scan.cameras[0]
    pose = synthetic.true_plan_from_cams[20]
    small = synthetic.renderer.render(camera, pose)
    large = synthetic.renderer.render(camera.scaled(480, 360), pose)
    # Pixel (1 + 3 i) of the large image is pixel i of the small one.
    assert_allclose(large.depth[1::3, 1::3], small.depth, rtol=1e-4)
    assert replace(synthetic.options, seed=2) != synthetic.options
