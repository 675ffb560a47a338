"""Keypoints and their depth: interpolation, holes, edges, and the options."""

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import CAMERA, look, room_scan, with_constants
from planfit.geometry.camera import Camera
from planfit.matching import detect as detect_module
from planfit.matching.detect import (
    KeypointOptions,
    detect,
    lift,
    make_detector,
    may_have_depth,
    reduced,
    sample_depth,
    sharpness,
    sift,
)


def ramp(slope_u=0.004, slope_v=0.003):
    v, u = np.mgrid[:60, :80]
    return (3.0 + slope_u * u + slope_v * v).astype(np.float32)


def test_depth_is_interpolated_between_pixels(rng):
    uv = rng.uniform([3, 3], [76, 56], (200, 2))
    expected = 3.0 + 0.004 * uv[:, 0] + 0.003 * uv[:, 1]
    assert_allclose(sample_depth(ramp(), uv), expected, atol=1e-5)


def test_whole_pixels_are_read_as_they_are():
    depth = ramp()
    found = sample_depth(depth, np.array([[10.0, 20.0], [33.0, 7.0]]))
    assert_allclose(found, [depth[20, 10], depth[7, 33]], rtol=1e-6)


def test_a_border_of_the_image_has_no_depth():
    u, v = np.meshgrid(np.arange(-3, 84, 0.5), np.arange(-3, 64, 0.5))
    found = sample_depth(ramp(), np.stack([u.ravel(), v.ravel()], axis=1))
    inside = (u >= 2) & (v >= 2) & (u < 77) & (v < 57)
    assert np.array_equal(np.isfinite(found), inside.ravel())


def test_holes_spoil_what_is_within_two_pixels_and_nothing_else():
    depth = ramp()
    depth[30, 40] = np.nan
    u, v = (grid.ravel() for grid in np.meshgrid(np.arange(30.0, 50.0), np.arange(20.0, 40.0)))
    found = sample_depth(depth, np.stack([u, v], axis=1) + 0.25)
    # The patch of a pixel reaches 2 px to the left and 3 px to the right of its floor.
    near = (u >= 37) & (u <= 42) & (v >= 27) & (v <= 32)
    assert np.array_equal(np.isnan(found), near)


def test_depth_edges_have_no_depth_and_edge_step_says_what_one_is():
    depth = np.full((60, 80), 2.0, np.float32)
    depth[:, 40:] = 2.2
    uv = np.array([[20.0, 30.0], [38.0, 30.0], [40.0, 30.0], [60.0, 30.0]])
    assert np.array_equal(np.isnan(sample_depth(depth, uv)), [False, True, True, False])
    with with_constants(detect_module, edge_step=0.11):
        assert np.isfinite(sample_depth(depth, uv)).all()


def test_where_there_may_be_depth_is_all_where_there_is_some(rng):
    depth = ramp()
    depth[10:14, 50:] += 0.3
    depth[rng.random(depth.shape) < 0.005] = np.nan
    uv = rng.uniform([0, 0], [79, 59], (5000, 2)).astype(np.float32)
    nearest = np.floor(uv + 0.5).astype(int)
    may = may_have_depth(depth)[nearest[:, 1], nearest[:, 0]] > 0
    has = np.isfinite(sample_depth(depth, uv))
    assert may[has].all()
    inner = (uv >= 3).all(axis=1) & (uv < [76, 56]).all(axis=1)
    assert has[may & inner].mean() > 0.7  # the 6x6 pixels that it is asked of see a few holes more
    assert not may[inner].all()


def test_no_points():
    assert sample_depth(ramp(), np.zeros((0, 2))).shape == (0,)


@pytest.fixture(scope="module")
def view():
    scan = room_scan([look([1.0, 2.0, 1.3], 0, 5)])
    return scan.files.color(0), scan.files.depth(0)


def test_keypoints_are_lifted_to_where_they_are_seen(view):
    found = detect(*view, CAMERA, KeypointOptions())
    assert len(found) > 50
    assert_allclose(CAMERA.project(found.points_cam.astype(float)), found.uv, atol=1e-3)
    at = np.round(found.uv).astype(int)
    assert_allclose(found.points_cam[:, 2], view[1][at[:, 1], at[:, 0]], rtol=0.02)
    assert found.descriptors.shape == (len(found), 128)
    assert found.descriptors.dtype == np.uint8


@pytest.mark.parametrize("shape", [(480, 640), (640, 480), (300, 401)])
def test_large_images_are_looked_at_reduced(rng, shape):
    # Blobs at known places, large enough to be seen at either size.
    uv = rng.uniform([40, 40], np.array(shape)[::-1] - 40.0, (60, 2))
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    grey = np.full(shape, 90.0)
    for u, v in uv:
        grey += 80 * np.exp(-((columns - u) ** 2 + (rows - v) ** 2) / (2 * 5.0**2))
    image = np.repeat(np.clip(grey, 0, 255).astype(np.uint8)[..., None], 3, axis=2)
    depth = np.full(shape, 2.0)
    camera = Camera(shape[1], shape[0], 500.0, 500.0, shape[1] / 2, shape[0] / 2)
    seen: list[tuple[int, int]] = []

    def spy(grey, useful):
        seen.append(grey.shape)
        assert useful.shape == grey.shape
        return sift(1500, 0.02)(grey, useful)

    options = KeypointOptions()
    with with_constants(detect_module, min_reduced=1):
        found = detect(image, depth, camera, options, reduced(spy, 400))
    assert max(seen[0]) == 400
    gap = np.linalg.norm(found.uv[:, None] - uv, axis=2).min(axis=1)
    alone = [k for k in range(len(uv)) if np.sort(np.linalg.norm(uv - uv[k], axis=1))[1] > 25]
    nearest = np.linalg.norm(found.uv[:, None] - uv[alone], axis=2).min(axis=0)
    assert len(alone) > 10
    # A quarter of a pixel, which OpenCV's SIFT is off by unless told not to be, would be seen.
    assert np.median(nearest) < 0.1
    assert np.median(gap) < 8
    assert_allclose(camera.project(found.points_cam.astype(float)), found.uv, atol=1e-2)

    # Too few in the reduced image: the whole one is looked at as well, as it was.
    seen.clear()
    with with_constants(detect_module, min_reduced=10**6):
        again = detect(image, depth, camera, options, reduced(spy, 400))
    assert seen == [seen[0], shape]
    whole = detect(image, depth, camera, KeypointOptions(max_side_px=max(shape)))
    assert_array_equal(again.uv, whole.uv)


def test_descriptors_are_root_sift(view):
    # Square roots of shares of one: the squares add up to 512^2, up to rounding down.
    squares = np.sum((detect(*view, CAMERA, KeypointOptions()).descriptors / 512.0) ** 2, axis=1)
    assert np.all((squares > 0.9) & (squares <= 1.0))


def test_a_blank_image_has_none(view):
    blank = np.full_like(view[0], 128)
    found = detect(blank, view[1], CAMERA, KeypointOptions())
    assert len(found) == 0
    assert found.points_cam.shape == (0, 3)
    assert found.descriptors.shape == (0, 128)


def test_no_depth_no_keypoints(view):
    assert len(detect(view[0], np.full_like(view[1], np.nan), CAMERA, KeypointOptions())) == 0


@pytest.mark.parametrize("kind", ["sift", "orb"])
@pytest.mark.parametrize("max_per_frame", [60, 1500])
def test_keypoints_of_no_use_are_left_out_and_the_rest_are_as_they_were(
    view, rng, kind, max_per_frame
):
    color, depth = view[0], view[1].copy()
    depth[30:50, 20:70] = np.nan
    depth[60:, 80:] += 0.5
    options = KeypointOptions(kind=kind, max_per_frame=max_per_frame)
    every = make_detector(options)(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY), None)
    expected, kept = lift(color, depth, CAMERA, options, every)
    assert 10 < len(kept) < 0.9 * len(every.uv)
    found = detect(color, depth, CAMERA, options)
    for name, value in vars(expected).items():
        np.testing.assert_array_equal(getattr(found, name), value)


def test_max_per_frame(view):
    few = detect(*view, CAMERA, KeypointOptions(max_per_frame=20))
    assert 0 < len(few) <= 21  # OpenCV keeps ties


def test_contrast_threshold(view):
    faint = cv2.addWeighted(view[0], 0.15, np.full_like(view[0], 128), 0.85, 0)
    many = detect(faint, view[1], CAMERA, KeypointOptions(contrast_threshold=0.005))
    none = detect(faint, view[1], CAMERA, KeypointOptions(contrast_threshold=0.2))
    assert len(many) > len(none)


def test_max_depth_m(view):
    everything = detect(*view, CAMERA, KeypointOptions()).points_cam[:, 2]
    limit = float(np.median(everything))
    near = detect(*view, CAMERA, KeypointOptions(max_depth_m=limit)).points_cam[:, 2]
    assert near.max() < limit
    assert len(near) == np.sum(everything < limit)


def test_orb_finds_bits_apart(view):
    found = detect(*view, CAMERA, KeypointOptions(kind="orb", max_per_frame=300))
    assert len(found) > 50
    assert found.descriptors.shape == (len(found), 256)
    assert set(np.unique(found.descriptors)) == {0, 1}
    # Squared Euclidean distance is the Hamming distance of the packed descriptors.
    packed = np.packbits(found.descriptors, axis=1)
    a, b = found.descriptors[:2].astype(int)
    assert np.sum((a - b) ** 2) == cv2.norm(packed[0], packed[1], cv2.NORM_HAMMING)


def test_a_blank_image_has_no_orb_either(view):
    blank = np.full_like(view[0], 128)
    assert len(detect(blank, view[1], CAMERA, KeypointOptions(kind="orb"))) == 0


def test_scores_tell_the_strongest(view):
    everything = detect(*view, CAMERA, KeypointOptions())
    few = detect(*view, CAMERA, KeypointOptions(max_per_frame=40))
    assert few.scores.min() >= np.sort(everything.scores)[::-1][: 2 * len(few)].min()


def test_sharpness_falls_with_blur_and_not_with_light(view):
    grey = cv2.cvtColor(view[0], cv2.COLOR_RGB2GRAY)
    values = [float(sharpness(cv2.GaussianBlur(grey, (0, 0), s))) for s in (0.5, 1.5, 3.0)]
    assert values[0] > 1.3 * values[1] > 1.3**2 * values[2]
    dark = (grey * 0.5).astype(np.uint8)
    assert_allclose(sharpness(dark), sharpness(grey), rtol=0.1)
    assert sharpness(np.full((40, 40), 7, np.uint8)) == 0
