"""Lenses by files of their own, in the forms that programs write them."""

import numpy as np
import pytest

from planfit.errors import ScanError
from planfit.scan import ScanOptions, read_scan
from planfit.scan.lens_file import read_lens
from planfit.scan.recording import Frame
from scan_samples import write_seven_scenes

ROS = """image_width: 640
image_height: 480
camera_name: color
camera_matrix:
  rows: 3
  cols: 3
  data: [500.0, 0.0, 320.5, 0.0, 501.0, 240.5, 0, 0, 1]
distortion_model: {}
distortion_coefficients:
  rows: 1
  cols: {}
  data: [{}]
"""
DASHES = """image_height: 480
image_width: 640
camera_matrix:
  cols: 3
  data:
  - 500.0
  - 0.0
  - 320.5
  - 0.0
  - 501.0
  - 240.5
  - 0.0
  - 0.0
  - 1.0
  rows: 3
"""
OPENCV = """%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 5.0e+02, 0., 320.5, 0., 501., 240.5, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ 0.1, -0.2, 1e-3, 0.,
       0.05 ]
"""
ORB_SLAM = """%YAML:1.0
# a comment
Camera1.fx: 500.0
Camera1.fy: 501.0
Camera1.cx: 320.5 # px
Camera1.cy: 240.5
Camera1.k1: 0.1
Camera1.k2: -0.2
Camera.width: 640
Camera.height: 480
"""
RADIAL = (0.1, -0.2, 0.001, 0.0, 0.05)
FORMS = {
    "ros": (ROS.format("plumb_bob", 5, "0.1, -0.2, 0.001, 0.0, 0.05"), RADIAL, False),
    "ros without distortion": (ROS.format("plumb_bob", 5, "0, 0, 0, 0, 0"), (), False),
    "ros fisheye": (ROS.format("equidistant", 4, "0.1, 0.2, 0.3, 0.4"), (0.1, 0.2, 0.3, 0.4), True),
    "ros with dashes": (DASHES, (), False),
    "opencv": (OPENCV, RADIAL, False),
    "orb-slam": (ORB_SLAM, (0.1, -0.2, 0.0, 0.0, 0.0), False),
    "colmap": ("# cameras\n1 PINHOLE 640 480 500 501 321 241\n", (), False),
    "colmap without a number": ("OPENCV 640 480 500 501 321 241 .1 -.2 0 0", (0.1, -0.2, 0, 0), False),
    "numbers": ("500 501 320.5 240.5\n", (), False),
    "numbers with distortion": ("500,501,320.5,240.5,0.1,-0.2,0.001,0,0.05\n", RADIAL, False),
    "json of librealsense": (
        '{"width": 640, "height": 480, "fx": 500, "fy": 501, "ppx": 320.5, "ppy": 240.5, '
        '"model": "distortion.brown_conrady", "coeffs": [0.1, -0.2, 0.001, 0.0, 0.05]}', RADIAL, False),
    "json of Open3D, by column": (
        '{"width": 640, "height": 480, "intrinsic_matrix": [500, 0, 0, 0, 501, 0, 320.5, 240.5, 1]}',
        (), False),
    "json of NeRF": (
        '{"fl_x": 500, "fl_y": 501, "cx": 321, "cy": 241, "k1": 0.1, "k2": -0.2, "p1": 0.001, "k3": 0.05}',
        RADIAL, False),
    "json of two cameras": (
        '{"depth": {"fx": 1, "fy": 1, "cx": 1, "cy": 1}, '
        '"color": {"fx": 500, "fy": 501, "cx": 320.5, "cy": 240.5}}', (), False),
    "json with distortion beside": (
        '{"Intrinsics": {"fx": 500, "fy": 501, "cx": 320.5, "cy": 240.5, "Distortion": '
        '{"k1": 0.1, "k2": -0.2, "p1": 0.001, "k3": 0.05}}}', RADIAL, False),
    "kalibr": (
        "cam0:\n  camera_model: pinhole\n  distortion_coeffs: [0.1, -0.2, 0.001, 0.0, 0.05]\n"
        "  distortion_model: radtan\n  intrinsics: [500, 501, 320.5, 240.5]\n", RADIAL, False),
    "matrix in a line": ("500 0 320.5 0 501 240.5 0 0 1\n", (), False),
    "matrix": ("500 0 320.5\n0 501 240.5\n0 0 1\n", (), False),
}  # fmt: skip


def lens_of(tmp_path, text):
    path = tmp_path / "lens.yaml"
    path.write_text(text)
    return read_lens(path)(Frame("0", 0.0, np.eye(4), "", ""), (640, 480))


@pytest.mark.parametrize("form", FORMS)
def test_every_form_is_read(form, tmp_path):
    text, distortion, is_fisheye = FORMS[form]
    lens = lens_of(tmp_path, text)
    c = lens.camera
    assert (c.width, c.height, c.fx, c.fy, c.cx, c.cy) == (640, 480, 500, 501, 320.5, 240.5)
    assert lens.distortion == pytest.approx(distortion)
    assert lens.is_fisheye == is_fisheye


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "a lens: YAML of ROS or OpenCV"),
        ("hello: world\n", "a lens: YAML of ROS or OpenCV"),
        ("1 2 3\n", "matrix"),
        ("1 PINHOLE 6 4 5 5 3 2\n2 PINHOLE 6 4 5 5 3 2\n", "expected one camera, found 2"),
        ("1 PINHOLE 640 480 500\n", "expected 4 parameters of PINHOLE, found 1"),
        (ROS.format("plumb_bob", 9, "1, 2, 3, 4, 5, 6, 7, 8, 9"), "found 9"),
        ("nan 1 2 3\n", "expected"),
        ("K: [1.0.2, 0, 3, 0, 1, 2, 0, 0, 1]\n", "expected numbers of K"),
        ("{", "found no JSON"),
        (
            '{"a": [{"K": [1, 0, 0, 0, 1, 0, 0, 0, 1]}, {"K": [2, 0, 0, 0, 2, 0, 0, 0, 1]}]}',
            "found 2 that differ",
        ),
    ],
)
def test_what_is_no_lens_is_refused(text, words, tmp_path):
    with pytest.raises(ScanError, match=words) as caught:
        lens_of(tmp_path, text)
    assert "lens.yaml: expected" in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ScanError, match=r"none\.txt: expected a lens"):
        read_lens(tmp_path / "none.txt")


def test_it_takes_the_place_of_a_scans_own(sample, tmp_path):
    write_seven_scenes(tmp_path / "scan", sample)
    (tmp_path / "lens.txt").write_text("100 101 60 50\n")
    options = ScanOptions(intrinsics=str(tmp_path / "lens.txt"))
    camera = read_scan(tmp_path / "scan", options=options).cameras[0]
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (100, 101, 60, 50)
