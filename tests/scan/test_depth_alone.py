"""Scans without colour: the same frames as with it, in memory and in folders that have none."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planfit.errors import OutputError, ScanError
from planfit.export.cloud import GREY, sample_cloud
from planfit.export.datasets import write_nerfstudio
from planfit.matching import MatchingOptions
from planfit.matching.tentative import find_keypoints
from planfit.runtime import Runtime
from planfit.scan import Label, read_scan, scan_from_arrays
from planfit.scan.views import select_frames
from planfit.synth import (
    BuildingOptions,
    CameraOptions,
    SynthOptions,
    WalkOptions,
    make_scan,
)
from planfit.synth.facap import write_facap
from scan_samples import N as N_SAMPLE
from scan_samples import make_sample, write_tum

N = 8


@pytest.fixture(scope="module")
def synthetic():
    return make_scan(
        SynthOptions(
            seed=3,
            building=BuildingOptions(n_rooms=2),
            walk=WalkOptions(n_frames=N),
            camera=CameraOptions(width_px=160, height_px=120),
            world="plan",
        )
    )


@pytest.fixture(scope="module")
def arrays(synthetic):
    files = synthetic.scan.files
    return {
        "depths_m": [files.depth(i) for i in range(N)],
        "cameras": synthetic.scan.cameras[0],
        "world_from_cams": synthetic.scan.world_from_cams,
    }


def test_no_frame_of_arrays_has_colour(synthetic, arrays) -> None:
    scan = scan_from_arrays(None, **arrays)
    assert not scan.has_color
    assert all(scan.files.color(i) is None for i in range(N))
    assert scan.cameras == synthetic.scan.cameras
    assert_array_equal(scan.files.depth(3), synthetic.scan.files.depth(3))
    chosen = select_frames(scan, np.array([4, 2]), scan.world_from_cams[[4, 2]])
    assert chosen.files.color(1) is None


def test_some_frames_of_arrays_have_colour(synthetic, arrays) -> None:
    image = synthetic.scan.files.color(1)
    scan = scan_from_arrays([None, image, *[None] * (N - 2)], **arrays)
    assert scan.has_color
    assert scan.files.color(0) is None
    assert_array_equal(scan.files.color(1), image)


def test_an_image_of_another_shape_is_still_refused(arrays) -> None:
    with pytest.raises(ScanError, match="frame 1: expected colour images as uint8"):
        scan_from_arrays([None, np.zeros((3, 3)), *[None] * (N - 2)], **arrays)


def test_a_synthetic_scan_without_colour_is_written_and_read(tmp_path, synthetic) -> None:
    bare = make_scan(replace(synthetic.options, has_color=False))
    assert bare.scan.files.color(0) is None
    write_facap(tmp_path / "bare", bare)
    assert not list((tmp_path / "bare/arcore").glob("frame-*"))
    scan = read_scan(tmp_path / "bare")
    assert (len(scan), scan.has_color, scan.has_labels) == (N, False, True)
    assert scan.files.color(0) is None
    assert_allclose(scan.files.depth(2), synthetic.scan.files.depth(2), atol=6e-4)
    walls = [files.labels(2) == Label.WALL for files in (scan.files, synthetic.scan.files)]
    assert_array_equal(*walls)
    scan.files.write_poses(tmp_path, scan.world_from_cams)
    assert (tmp_path / "pose-0001.txt").exists()


def test_a_tum_folder_without_rgb_is_depth_alone(tmp_path) -> None:
    sample = make_sample()
    write_tum(tmp_path, sample)
    with_color = read_scan(tmp_path)
    (tmp_path / "rgb.txt").unlink()
    scan = read_scan(tmp_path)
    assert (scan.format, scan.has_color, len(scan)) == ("tum", False, N_SAMPLE)
    assert scan.cameras[0] == with_color.cameras[0]
    # Poses are those of the depth's own times, which are 4 ms after the colour's.
    assert_allclose(scan.timestamps, sample.times[: len(scan)] + 0.004, atol=1e-6)
    assert_array_equal(scan.files.depth(1), with_color.files.depth(1))


def test_frames_without_colour_have_no_keypoints_and_no_say_in_likeness(synthetic) -> None:
    bare = make_scan(replace(synthetic.options, has_color=False)).scan
    seen = find_keypoints(bare, MatchingOptions(), Runtime())
    assert [len(k) for k in seen.keypoints] == [0] * N
    assert np.isfinite(seen.grids.depth_m).any(axis=(1, 2)).all()
    assert not seen.grids.grey.any()


def test_clouds_are_grey_and_datasets_of_images_are_refused(tmp_path, synthetic) -> None:
    bare = make_scan(replace(synthetic.options, has_color=False)).scan
    cloud = sample_cloud(bare, Runtime())
    assert (cloud.colors == GREY).all()
    with pytest.raises(OutputError, match=r"frame 0001: expected a colour image.*depth alone"):
        write_nerfstudio(tmp_path, bare, bare.world_from_cams, cloud, Runtime())
