"""Scans made of arrays in memory: the same as scans of files, and errors that name what was expected."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import planfit
from builders import position_rms_m
from planfit.errors import ScanError
from planfit.geometry.camera import Camera
from planfit.scan import ScanOptions, read_tum, scan_from_arrays
from planfit.synth import (
    BuildingOptions,
    CameraOptions,
    DriftOptions,
    SynthOptions,
    WalkOptions,
    make_scan,
)

N = 24


@pytest.fixture(scope="module")
def synthetic():
    return make_scan(
        SynthOptions(
            seed=3,
            building=BuildingOptions(n_rooms=2),
            walk=WalkOptions(n_frames=N),
            camera=CameraOptions(width_px=160, height_px=120),
            drift=DriftOptions(yaw_deg=0.3, translation_m=0.02),
        )
    )


@pytest.fixture(scope="module")
def arrays(synthetic):
    files = synthetic.scan.files
    return {
        "colors": np.stack([files.color(i) for i in range(N)]),
        "depths_m": [files.depth(i).astype(float) for i in range(N)],
        "cameras": synthetic.scan.cameras[0],
        "world_from_cams": synthetic.scan.world_from_cams,
        "labels": [files.labels(i).astype(int) for i in range(N)],
        "up_world": 2.0 * synthetic.scan.up_world,
    }


def test_frames_are_those_of_the_arrays(synthetic, arrays) -> None:
    scan = scan_from_arrays(**arrays)
    assert len(scan) == N
    assert scan.warnings == scan.skipped == ()
    assert scan.fingerprint == ""  # so that nothing is cached
    assert scan.has_labels
    assert_array_equal(scan.timestamps, np.arange(N))
    assert_array_equal(scan.up_world, synthetic.scan.up_world)
    assert_allclose(scan.world_from_cams, synthetic.scan.world_from_cams, atol=1e-12)
    for i in (0, 7, N - 1):
        assert_array_equal(scan.files.color(i), synthetic.scan.files.color(i))
        assert_array_equal(scan.files.depth(i), synthetic.scan.files.depth(i))
        assert_array_equal(scan.files.labels(i), synthetic.scan.files.labels(i))


def test_a_scan_of_arrays_is_refined(synthetic, arrays) -> None:
    result = planfit.refine(scan_from_arrays(**arrays), synthetic.floorplan)
    true = synthetic.true_plan_from_cams
    before = position_rms_m(result.initial_plan_from_cams, true)
    assert position_rms_m(result.plan_from_cams, true) < 0.5 * before


def test_what_a_stage_does_to_an_image_stays_with_it(arrays) -> None:
    scan = scan_from_arrays(**arrays)
    for read in (scan.files.color, scan.files.depth, scan.files.labels):
        first = read(0)
        kept = first.copy()
        first[:] = 0
        assert_array_equal(read(0), kept)


def test_depth_of_another_size_is_brought_to_the_colour(synthetic, arrays) -> None:
    halves = [depth[::2, ::2].copy() for depth in arrays["depths_m"]]
    scan = scan_from_arrays(**(arrays | {"depths_m": halves}))
    depth = scan.files.depth(3)
    assert depth.shape == (120, 160)
    assert_array_equal(depth[::2, ::2], synthetic.scan.files.depth(3)[::2, ::2])


def test_images_can_be_made_smaller_with_their_labels(arrays) -> None:
    scan = scan_from_arrays(**arrays, options=ScanOptions(image_size_px=80))
    assert (scan.cameras[0].width, scan.cameras[0].height) == (80, 60)
    assert scan.files.color(0).shape == (60, 80, 3)
    assert scan.files.depth(0).shape == scan.files.labels(0).shape == (60, 80)
    assert set(np.unique(scan.files.labels(0))) <= set(np.unique(arrays["labels"][0]))


def test_nothing_was_measured_where_depth_is_0_or_not_finite(arrays) -> None:
    depths = np.stack(arrays["depths_m"])
    depths[:, 0, :3] = (0.0, np.inf, np.nan)
    depth = scan_from_arrays(**(arrays | {"depths_m": depths})).files.depth(5)
    assert np.isnan(depth[0, :3]).all()


def test_poses_are_written_as_tum(arrays, tmp_path) -> None:
    scan = scan_from_arrays(**arrays)
    scan.files.write_poses(tmp_path, scan.world_from_cams[[2, 5]], np.array([2, 5]))
    times, poses = read_tum(tmp_path / "trajectory.tum")
    assert_array_equal(times, [2, 5])
    assert_allclose(poses, scan.world_from_cams[[2, 5]], atol=1e-8)


def test_a_camera_a_frame(arrays) -> None:
    camera = arrays["cameras"]
    cameras = [replace(camera, fx=camera.fx + i) for i in range(N)]
    assert scan_from_arrays(**(arrays | {"cameras": cameras})).cameras[4].fx == camera.fx + 4


def test_depth_in_millimetres_is_questioned(arrays) -> None:
    scan = scan_from_arrays(**(arrays | {"depths_m": 1000 * np.stack(arrays["depths_m"])}))
    assert "is it in another unit?" in scan.warnings[0]


BAD = {
    "fewer colours": (
        lambda a: {"colors": a["colors"][:-1]},
        "made up: expected 24 colour images, one a pose, found 23",
    ),
    "grey": (
        lambda a: {"colors": a["colors"][..., 0]},
        r"frame 0: expected colour images as uint8 of shape \(h, w, 3\), found uint8 \(120, 160\)",
    ),
    "colour as floats": (
        lambda a: {"colors": a["colors"] / 255},
        r"expected colour images as uint8 .* found float64 \(120, 160, 3\)",
    ),
    "raw depth": (
        lambda a: {"depths_m": [np.nan_to_num(d * 1000).astype(np.uint16) for d in a["depths_m"]]},
        r"expected depth images as floats of shape \(h, w\), in m, found uint16 \(120, 160\)",
    ),
    "poses as quaternions": (
        lambda _: {"world_from_cams": np.zeros((N, 7))},
        r"expected poses of shape \(n, 4, 4\), found float64 \(24, 7\)",
    ),
    "no pose at all": (
        lambda a: {"world_from_cams": np.full_like(a["world_from_cams"], np.nan)},
        "expected frames with colour, depth and a pose, found none",
    ),
    "a scaled pose": (
        lambda a: {"world_from_cams": a["world_from_cams"] @ np.diag([2.0, 2.0, 2.0, 1.0])},
        "frame 000000: expected a rotation",
    ),
    "a camera of another size": (
        lambda _: {"cameras": Camera(640, 480, 500.0, 500.0, 319.5, 239.5)},
        r"colors\[0\]: expected 640 x 480 px as the intrinsics say, found 160 x 120",
    ),
    "two cameras": (
        lambda a: {"cameras": [a["cameras"]] * 2},
        "expected 24 cameras, one a pose, found 2",
    ),
    "unknown labels": (
        lambda a: {"labels": [np.full_like(label, 9) for label in a["labels"]]},
        r"expected label images as integers from 0 to 5, of shape \(h, w\), found int64 .* 9 to 9",
    ),
    "labels of another size": (
        lambda a: {"labels": [label[::2, ::2] for label in a["labels"]]},
        r"frame 0: expected labels of shape \(120, 160\) as the colour, found \(60, 80\)",
    ),
    "times": (
        lambda _: {"timestamps_s": np.zeros(3)},
        "expected 24 timestamps, one a pose, found 3",
    ),
    "no up": (lambda _: {"up_world": np.zeros(3)}, "expected up_world to be a direction"),
    "up": (
        lambda _: {"up_world": np.eye(3)},
        r"expected up_world of shape \(3,\), found float64 \(3, 3\)",
    ),
    "no depth": (
        lambda a: {"depths_m": [np.zeros_like(d) for d in a["depths_m"]]},
        "expected depth, found no measurement in any of the 9 frames",
    ),
    "no frame": (
        lambda _: {"colors": [], "depths_m": [], "labels": None,
                   "world_from_cams": np.zeros((0, 4, 4))},
        "expected frames with colour, depth and a pose, found none",
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", BAD)
def test_arrays_that_cannot_be_used(kind, arrays) -> None:
    change, words = BAD[kind]
    with pytest.raises(ScanError, match=words):
        scan_from_arrays(**(arrays | change(arrays)), name="made up")
