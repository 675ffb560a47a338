"""Floor and wall by geometry alone, against the true surface of every pixel."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import CAMERA, look, room_scan
from planfit.geometry import se3
from planfit.scan import Label
from planfit.structure.geometry_labels import (
    GeometryLabelOptions,
    find_floor_height,
    label_by_geometry,
)

POSE = look([1.0, 2.0, 1.5], 10, 20)
TABLE = ((2.5, 1.0, 0.0), (3.5, 2.0, 0.8))


def labelled(pose=POSE, boxes=(), holes=(), height=0.0, **options):
    scan = room_scan([pose], boxes=boxes, holes=holes)
    depth = scan.files.depth(0)
    labels = label_by_geometry(depth, CAMERA, pose, height, GeometryLabelOptions(**options))
    points = se3.transform(pose, CAMERA.lift_image(depth).reshape(-1, 3)).reshape(*depth.shape, 3)
    return labels, points


def test_floor_and_walls_of_an_empty_room():
    labels, points = labelled()
    is_floor = points[..., 2] < 0.01
    inner = np.zeros_like(is_floor)
    inner[10:-10, 10:-10] = True
    assert labels.shape == points.shape[:2]
    assert labels.dtype == np.uint8
    assert np.mean(labels[inner & is_floor] == Label.FLOOR) > 0.9
    on_wall = ~is_floor & (points[..., 2] < 2.55)
    assert np.mean(labels[inner & on_wall] == Label.WALL) > 0.7
    assert np.all(points[labels == Label.FLOOR][:, 2] < 0.35)
    assert np.mean(is_floor[labels == Label.WALL]) < 0.1


def test_a_table_is_neither():
    labels, points = labelled(boxes=[TABLE])
    low, high = np.array(TABLE)
    inside = np.all((points[..., :2] > low[:2] + 0.1) & (points[..., :2] < high[:2] - 0.1), axis=-1)
    top = inside & (np.abs(points[..., 2] - 0.8) < 0.02)
    assert top.sum() > 50
    assert np.mean(labels[top] == Label.NONE) > 0.95
    front = (
        (np.abs(points[..., 0] - low[0]) < 0.02) & (points[..., 2] > 0.35) & (points[..., 2] < 0.7)
    )
    assert front.sum() > 50
    assert not np.any(labels[front] == Label.WALL)


def test_a_ceiling_is_not_the_floor():
    labels, points = labelled(look([1.0, 2.0, 1.5], 10, -30))
    assert not np.any(labels[points[..., 2] > 2.5] == Label.FLOOR)


def test_holes_have_no_label_and_spoil_little():
    holes = [(60, 80), (61, 80), (90, 20)]
    labels, _ = labelled(holes=holes)
    whole, _ = labelled()
    assert np.mean(labels == whole) > 0.97


def test_floor_band_m_is_about_the_floors_height():
    labels, _ = labelled(height=0.5)
    assert not np.any(labels == Label.FLOOR)
    labels, _ = labelled(height=0.5, floor_band_m=0.6)
    assert np.any(labels == Label.FLOOR)


def test_min_wall_top_m():
    cupboard = [((4.0, 1.0, 0.0), (4.6, 3.0, 2.0))]
    pose = look([1.0, 2.0, 1.2], 0, 5)

    def share(**options):
        labels, points = labelled(pose, cupboard, **options)
        front = (np.abs(points[..., 0] - 4.0) < 0.02) & (points[..., 2] > 0.4)
        return np.mean(labels[front] == Label.WALL)

    assert share(min_wall_top_m=1.5) > 0.7
    assert share(min_wall_top_m=2.2) < 0.1


def test_max_tilt_deg():
    tilted = se3.make_transform(se3.exp_so3(np.array([np.deg2rad(9.0), 0, 0])), np.zeros(3)) @ POSE
    scan = room_scan([POSE])

    def floor(max_tilt_deg):
        options = GeometryLabelOptions(max_tilt_deg=max_tilt_deg, floor_band_m=5.0)
        labels = label_by_geometry(scan.files.depth(0), CAMERA, tilted, 0.0, options)
        return np.mean(labels == Label.FLOOR)

    assert floor(12.0) > 0.2
    assert floor(6.0) == 0.0


def test_step_and_radius_keep_the_picture():
    fine, _ = labelled(step_px=1)
    coarse, _ = labelled(step_px=2)
    blurred, _ = labelled(normal_radius_px=9)
    assert np.mean(fine == coarse) > 0.9
    inner = (slice(15, -15), slice(15, -15))
    assert 0.75 < np.mean(fine[inner] == blurred[inner]) < 1.0
    blocks = coarse.reshape(60, 2, 80, 2)
    assert np.all(blocks == blocks[:, :1, :, :1])


# The floor's height among level surfaces.


def heights(rng, *parts):
    return np.concatenate([rng.normal(z, 0.01, n) for z, n in parts])


def test_the_floor_is_the_lowest_large_peak(rng):
    found = find_floor_height(heights(rng, (-1.4, 5000), (-0.65, 3000)))
    assert found == pytest.approx(-1.4, abs=0.005)


def test_a_large_table_does_not_win(rng):
    assert find_floor_height(heights(rng, (0.1, 2000), (0.85, 5000))) == pytest.approx(
        0.1, abs=0.01
    )


def test_a_few_points_below_do_not_win(rng):
    found = find_floor_height(heights(rng, (-2.0, 100), (0.0, 5000)))
    assert found == pytest.approx(0.0, abs=0.005)


def test_one_height_and_none():
    assert_allclose(find_floor_height(np.full(10, 0.7)), 0.7)
    assert np.isnan(find_floor_height(np.zeros(0)))
