"""A scan seen through a calibration: lifted points are the corrected points, all else is as it was."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import CAMERA, NoFiles, look, room_scan
from planfit.errors import ScanError
from planfit.geometry.calibration import SensorCalibration
from planfit.scan import calibrated_scan, corrupt_frames
from planfit.scan.views import select_frames, tolerate_corrupt_frames

SENSOR = SensorCalibration(0.97, 0.02, 0.004, 1.03, 0.99, 0.01, -0.02)
POSES = np.stack([look([2, 2, 1.5], yaw) for yaw in (0, 30, 60)])


def lifted(scan, i):
    depth = scan.files.depth(i)
    rows, columns = np.nonzero(np.isfinite(depth))
    return scan.cameras[i].lift(
        np.stack([columns, rows], axis=1).astype(float), depth[rows, columns]
    )


def test_lifted_points_are_those_of_the_nominal_scan_corrected():
    scan = room_scan(POSES, holes=((3, 4),))
    seen = calibrated_scan(scan, SENSOR)
    assert_allclose(lifted(seen, 1), SENSOR.points(lifted(scan, 1)), atol=1e-5)
    assert np.isnan(seen.files.depth(1)[3, 4])
    assert seen.files.depth(1).dtype == np.float32


def test_poses_colour_and_labels_are_as_they_are(tmp_path: Path):
    class Files(NoFiles):
        def color(self, i):
            return np.full((2, 2, 3), i, dtype=np.uint8)

        def labels(self, i):
            return np.full((2, 2), i, dtype=np.uint8)

        def write_poses(self, directory, world_from_cams, frame_idx=None):
            written.append((directory, world_from_cams, frame_idx))

    written = []
    scan = replace(room_scan(POSES), files=Files(), has_labels=True)
    seen = calibrated_scan(scan, SENSOR)
    assert seen.files.color(2)[0, 0, 0] == seen.files.labels(2)[0, 0] == 2
    assert_array_equal(seen.world_from_cams, scan.world_from_cams)
    seen.files.write_poses(tmp_path, POSES[:1], np.array([2]))
    assert written[0][0] == tmp_path
    assert written[0][2] == [2]


def test_a_correction_has_a_fingerprint_of_its_own_and_none_has_the_scans():
    scan = room_scan(POSES)
    assert calibrated_scan(scan, SensorCalibration()) is scan
    seen = calibrated_scan(scan, SENSOR)
    other = calibrated_scan(scan, replace(SENSOR, depth_scale=0.96))
    assert len({scan.fingerprint, seen.fingerprint, other.fingerprint}) == 3
    assert seen.fingerprint.split("-")[0] == scan.fingerprint
    assert calibrated_scan(replace(scan, fingerprint=""), SENSOR).fingerprint == ""


def test_a_second_correction_comes_on_top_of_the_first():
    scan = room_scan(POSES)
    twice = calibrated_scan(calibrated_scan(scan, SENSOR), SensorCalibration(depth_scale=0.5))
    assert_allclose(twice.files.depth(0), 0.5 * SENSOR.depths(scan.files.depth(0)), rtol=1e-6)
    assert twice.cameras[0] == SENSOR.camera(CAMERA)


def test_depth_that_ends_behind_the_camera_is_no_measurement():
    scan = room_scan(POSES)
    seen = calibrated_scan(scan, SensorCalibration(depth_offset_m=-3.0))
    was, depth = scan.files.depth(0), seen.files.depth(0)
    assert 0 < (was < 3.0).mean() < 1
    assert_array_equal(np.isnan(depth), was <= 3.0)


@pytest.mark.parametrize("is_selected_first", [True, False])
def test_corrupt_frames_are_named_through_the_view(is_selected_first):
    class Corrupt(NoFiles):
        def depth(self, i):
            raise ScanError(f"frame {i} is damaged")

    scan = replace(room_scan(np.repeat(POSES, 40, axis=0)), files=Corrupt())
    scan = tolerate_corrupt_frames(scan)
    chosen = np.array([5, 7])
    if is_selected_first:
        scan = calibrated_scan(select_frames(scan, chosen, scan.world_from_cams[chosen]), SENSOR)
    else:
        scan = select_frames(calibrated_scan(scan, SENSOR), chosen, scan.world_from_cams[chosen])
    assert np.isnan(scan.files.depth(1)).all()
    assert corrupt_frames(scan) == {"0007": "frame 7 is damaged"}
