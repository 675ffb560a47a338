"""A calibration as a file: read back as it was written, and refused in one line where it is spoiled."""

import json
from dataclasses import replace

import pytest
from numpy.testing import assert_array_equal

from builders import CAMERA, look, room_scan
from planfit.errors import ScanError
from planfit.geometry.calibration import PARAMETERS, SensorCalibration
from planfit.scan import calibrated_scan
from planfit.scan.lens_file import take_calibration, write_calibration

SENSOR = SensorCalibration(0.97, 0.02, 0.004, 1.03, 0.99, 0.01, -0.02)


@pytest.fixture
def written(tmp_path):
    path = tmp_path / "device.json"
    write_calibration(path, SENSOR, dict.fromkeys(PARAMETERS, 0.001), CAMERA)
    return path


def scan_of(camera):
    return room_scan(look([2, 2, 1.5], 0)[None], camera=camera)


def test_what_was_written_corrects_another_scan(written):
    scan = scan_of(CAMERA)
    seen, expected = take_calibration(scan, written), calibrated_scan(scan, SENSOR)
    assert (seen.cameras, seen.fingerprint) == (expected.cameras, expected.fingerprint)
    assert_array_equal(seen.files.depth(0), expected.files.depth(0))
    assert seen.warnings == ()


def test_another_device_is_warned_of_and_another_size_is_not(written):
    half = replace(CAMERA, width=80, height=60, fx=65.0, fy=65.0, cx=39.5, cy=29.5)
    assert take_calibration(scan_of(half), written).warnings == ()
    (warning,) = take_calibration(scan_of(replace(CAMERA, fx=145.0)), written).warnings
    assert "is it the same device?" in warning


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c.update(version=2), "expected a calibration of version 1, found 2"),
        (lambda c: c.update(format="other"), "found other JSON"),
        (lambda c: c["parameters"].pop("focal_scale"), "expected parameters.focal_scale, found none"),
        (lambda c: c["parameters"].update(depth_scale="1"), "depth_scale: expected a number, found '1'"),
        (lambda c: c["parameters"].update(depth_scale=float("nan")), "expected a number, found nan"),
        (lambda c: c["parameters"].update(depth_scale=-1.0), "must be above 0"),
        (lambda c: c.pop("camera"), "expected camera.width, found none"),
    ],
)  # fmt: skip
def test_a_spoiled_file_is_refused_in_one_line(written, change, message):
    content = json.loads(written.read_text())
    change(content)
    written.write_text(json.dumps(content))
    with pytest.raises(ScanError, match=r"device\.json") as caught:
        take_calibration(scan_of(CAMERA), written)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "{", "[1]"])
def test_what_is_no_calibration_is_refused(written, text):
    written.write_text(text)
    with pytest.raises(ScanError, match="expected a calibration"):
        take_calibration(scan_of(CAMERA), written)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(ScanError, match="none that can be read"):
        take_calibration(scan_of(CAMERA), tmp_path / "none.json")
