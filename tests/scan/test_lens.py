"""Lenses: what a distorted, larger or shifted image shows through the frame's pinhole camera."""

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planfit.geometry.camera import Camera
from planfit.scan.images.lens import Lens, resample_color, resample_depth, working_camera

CAMERA = Camera(160, 120, 130.0, 131.0, 78.5, 61.0)
BARREL = Lens(CAMERA, (-0.25, 0.08, 0.001, -0.002))
FISHEYE = Lens(CAMERA, (0.05, -0.01, 0.002, 0.0), is_fisheye=True)


def pixel_grid(camera):
    rows, columns = np.mgrid[: camera.height, : camera.width]
    return np.stack([columns.ravel(), rows.ravel()], axis=1).astype(float)


def scene(rays):
    """A smooth brightness, and the depth of a slanted plane, of directions (n, 3)."""
    brightness = 127 + 60 * np.sin(9 * rays[:, 0]) + 60 * np.cos(7 * rays[:, 1])
    return brightness, 2.0 / (1 + 0.3 * rays[:, 0] - 0.2 * rays[:, 1])


def rays_of_stored_pixels(lens):
    """By the textbook's formulas, solved by iteration; the code under test goes the other way."""
    c = lens.camera
    bent = (pixel_grid(c) - [c.cx, c.cy]) / [c.fx, c.fy]
    xy = bent.copy()
    for _ in range(200):
        x, y = xy.T
        r = np.hypot(x, y)
        if lens.is_fisheye:
            angle, k = np.arctan(r), lens.distortion
            growth = 1 + k[0] * angle**2 + k[1] * angle**4 + k[2] * angle**6 + k[3] * angle**8
            xy = bent * (r / np.maximum(angle * growth, 1e-12))[:, None]
            xy[r < 1e-9] = bent[r < 1e-9]
        else:
            k1, k2, p1, p2 = lens.distortion
            tangential = np.stack(
                [2 * p1 * x * y + p2 * (r**2 + 2 * x**2), p1 * (r**2 + 2 * y**2) + 2 * p2 * x * y],
                axis=1,
            )
            xy = (bent - tangential) / (1 + k1 * r**2 + k2 * r**4)[:, None]
    return np.column_stack([xy, np.ones(len(xy))])


@pytest.mark.parametrize("lens", [BARREL, FISHEYE], ids=["barrel", "fisheye"])
def test_distorted_images_become_pinhole_images(lens):
    shape = (CAMERA.height, CAMERA.width)
    stored_brightness, stored_depth = scene(rays_of_stored_pixels(lens))
    stored = np.clip(stored_brightness.reshape(shape), 0, 255).astype(np.uint8)
    wanted_brightness, wanted_depth = scene(CAMERA.rays(pixel_grid(CAMERA)))
    color = resample_color(np.repeat(stored[..., None], 3, axis=2), lens, CAMERA)
    depth = resample_depth(stored_depth.reshape(shape).astype(np.float32), lens, CAMERA)
    seen = np.isfinite(depth)
    assert seen.mean() > 0.85
    error = np.abs(color[..., 0].astype(float) - np.clip(wanted_brightness.reshape(shape), 0, 255))
    inner = cv2.erode(seen.astype(np.uint8), np.ones((5, 5))).astype(bool)
    assert error[inner].max() < 3
    # Half a pixel off at most: the plane falls by under 2 cm a pixel.
    assert np.abs(depth - wanted_depth.reshape(shape))[seen].max() < 0.02
    # Left as they are, the corners would be far off.
    assert (
        np.abs(stored.astype(float) - np.clip(wanted_brightness.reshape(shape), 0, 255)).max() > 20
    )


def test_depth_is_never_mixed_across_an_edge():
    stored = np.full((60, 80), 1.0, dtype=np.float32)
    stored[:, 40:] = 5.0
    stored[10:20, 10:20] = np.nan
    small = Lens(CAMERA.scaled(80, 60))
    for lens in (small, Lens(small.camera, BARREL.distortion)):
        depth = resample_depth(stored, lens, CAMERA)
        assert set(np.unique(depth[np.isfinite(depth)])) == {1.0, 5.0}


@pytest.mark.parametrize(("width", "height"), [(80, 60), (320, 240), (53, 40)])
def test_depth_of_another_size_keeps_its_place(width, height):
    camera = CAMERA.scaled(width, height)
    _, z = scene(camera.rays(pixel_grid(camera)))
    depth = resample_depth(z.reshape(height, width).astype(np.float32), Lens(camera), CAMERA)
    _, wanted = scene(CAMERA.rays(pixel_grid(CAMERA)))
    assert np.isfinite(depth).all()
    # The plane falls by up to 1.7 cm a pixel; half a stored pixel each way is the most one can be off.
    error = depth - wanted.reshape(depth.shape)
    assert np.abs(error).max() < 0.5 * 0.017 * 160 / width
    if width < 160:  # at half the size, pixels fall between two stored ones, and one side is taken
        assert abs(error.mean()) < 2e-4


def test_a_depth_camera_with_a_wider_view_is_cut_and_a_narrower_one_leaves_a_frame():
    wide = Lens(Camera(160, 120, 100.0, 100.0, 79.5, 59.5))
    narrow = Lens(Camera(160, 120, 200.0, 200.0, 79.5, 59.5))
    middle = Camera(160, 120, 130.0, 130.0, 79.5, 59.5)
    ones = np.ones((120, 160), dtype=np.float32)
    assert np.isfinite(resample_depth(ones, wide, middle)).all()
    depth = resample_depth(ones, narrow, middle)
    assert np.isnan(depth[0]).all()
    assert np.isnan(depth[:, -1]).all()
    assert np.isfinite(depth).mean() == pytest.approx((130 / 200) ** 2, abs=0.03)


def test_nothing_is_done_to_images_that_fit():
    image = np.zeros((120, 160, 3), dtype=np.uint8)
    depth = np.ones((120, 160), dtype=np.float32)
    assert resample_color(image, Lens(CAMERA), CAMERA) is image
    assert resample_depth(depth, Lens(CAMERA, (0.0, 0.0)), CAMERA) is depth


def test_shrunk_colour_keeps_its_place():
    large = CAMERA.scaled(640, 480)
    brightness, _ = scene(large.rays(pixel_grid(large)))
    image = np.repeat(brightness.reshape(480, 640, 1).astype(np.uint8), 3, axis=2)
    wanted, _ = scene(CAMERA.rays(pixel_grid(CAMERA)))
    small = resample_color(image, Lens(large), CAMERA)[..., 0].astype(float)
    assert_allclose(small, wanted.reshape(120, 160), atol=2)
    # The same through the general way, with a distortion that does nothing to speak of.
    bent = resample_color(image, Lens(large, (1e-9, 0.0, 0.0, 0.0)), CAMERA)[..., 0].astype(float)
    assert_allclose(bent, wanted.reshape(120, 160), atol=3)


@pytest.mark.parametrize(
    ("color", "depth", "size_px", "expected"),
    [
        ((640, 480), (640, 480), None, (640, 480)),
        ((1200, 680), (1200, 680), None, (1200, 680)),  # Replica: both are large
        ((1920, 1440), (256, 192), None, (640, 480)),  # a phone
        ((1296, 968), (640, 480), None, (640, 478)),  # ScanNet
        ((720, 960), (192, 256), None, (480, 640)),  # upright
        ((320, 240), (640, 480), None, (320, 240)),  # never larger than the colour
        ((640, 480), (640, 480), 320, (320, 240)),
        ((1920, 1440), (256, 192), 960, (960, 720)),
    ],
)
def test_size_worked_on(color, depth, size_px, expected):
    lenses = (Lens(Camera(*size, 500.0, 500.0, 10.0, 10.0)) for size in (color, depth))
    camera = working_camera(*lenses, size_px)
    assert (camera.width, camera.height) == expected


def test_pixels_agree_with_the_pinhole_camera():
    uv = pixel_grid(CAMERA)
    assert_allclose(Lens(CAMERA).pixels(CAMERA.rays(uv)), uv, atol=1e-9)
    assert_array_equal(Lens(CAMERA, (0.0,) * 5).is_distorted, False)
