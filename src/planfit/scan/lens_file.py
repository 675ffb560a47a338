"""A camera's lens by a file of its own: YAML of ROS, OpenCV, RTAB-Map and ORB-SLAM, words of COLMAP, numbers.

    camera_matrix: rows, cols, data     distortion_coefficients, image_width, image_height, distortion_model
    Camera.fx, Camera.k1, Camera.width  ORB-SLAM (Camera1.fx of version 3)
    1 OPENCV 640 480 fx fy cx cy ...    a line of cameras.txt; its number may be left out
    fx fy cx cy [k1 k2 p1 p2 [k3]]      or a matrix, 3x3 or 4x4

Of YAML what these need is read, and no more.
"""

import re
from pathlib import Path

import numpy as np

from planfit.errors import ScanError
from planfit.scan.formats.colmap_model import MODELS, camera_of_words
from planfit.scan.images.lens import Lens, make_camera, matrix_intrinsics
from planfit.scan.recording import Frame, LensOfFrame, Size
from planfit.scan.tables import number_table, shorten

EXPECTED = (
    "a lens: YAML of ROS or OpenCV with camera_matrix, a camera as COLMAP writes it, or fx fy cx cy"
)
_NUMBER = r"[-+]?[\d.]+(?:[eE][-+]?\d+)?"
_MATRIX = re.compile(
    r"^[ \t]*([\w.]+):[^\n\[#]*(?:\n[ \t]+(?:rows|cols|dt):[^\n]*)*(?:\n[ \t]+data:[ \t]*)?"
    rf"(?:\[([^\]]*)\]|((?:\n[ \t]*-[ \t]+{_NUMBER})+))",
    re.MULTILINE,
)
_SCALAR = re.compile(r"^[ \t]*([\w.]+):[ \t]*([^\s\[#][^\n#]*)(?:#[^\n]*)?$", re.MULTILINE)
FISHEYES = ("fisheye", "equidistant", "kannalabrandt8")


def yaml_values(text: str) -> tuple[dict[str, list[float]], dict[str, str]]:
    """Lists of numbers (matrices by row) and single values of a camera's YAML file, by names in lower case,
    whatever group they stand in."""
    lists = {}
    for name, inline, dashes in _MATRIX.findall(text):
        found = re.findall(_NUMBER, inline or dashes.replace("- ", " "))
        lists[name.lower()] = [float(word) for word in found]
    scalars = {name.lower(): value.strip().strip("\"'") for name, value in _SCALAR.findall(text)}
    return lists, scalars


def lens_of_yaml(text: str, where: str) -> LensOfFrame:
    """The lens that the text of a YAML file tells; where it tells no size, for images of any.

    Raises:
        ScanError: it tells none; it begins with `where`.
    """
    try:
        lists, scalars = yaml_values(text)
        matrix = lists.get("camera_matrix") or lists.get("k") or []
        distortion = lists.get("distortion_coefficients") or lists.get("d") or []
        group = next((g for g in ("camera.", "camera1.", "") if f"{g}fx" in scalars), None)
        if not matrix and group is not None:
            fx, fy, cx, cy = (float(scalars[f"{group}{name}"]) for name in ("fx", "fy", "cx", "cy"))
            matrix = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]
            keys = [f"{group}{name}" for name in ("k1", "k2", "p1", "p2", "k3")]
            distortion = [float(scalars.get(key, 0.0)) for key in keys]
        intrinsics = matrix_intrinsics(np.reshape(matrix, (3, 3)), where)
        size = next(
            (
                (int(scalars[f"{before}width"]), int(scalars[f"{before}height"]))
                for before in ("image_", "", "camera.")
                if f"{before}width" in scalars
            ),
            None,
        )
    except (ValueError, KeyError) as error:
        raise ScanError(f"{where}: expected {EXPECTED}, found {shorten(error)}") from error
    kind = scalars.get("distortion_model", scalars.get("camera.type", "")).lower()
    return _lens(intrinsics, size, tuple(distortion), kind in FISHEYES, where)


def read_lens(path: Path) -> LensOfFrame:
    """The lens of a file, for all frames of a scan.

    Raises:
        ScanError: it cannot be read, or holds none.
    """
    where = str(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ScanError(f"{where}: expected {EXPECTED}, found none that can be read") from error
    names = [name for name, _ in MODELS]
    cameras = [
        line.split()
        for line in text.splitlines()
        if not line.startswith("#") and set(line.split()[:2]) & set(names)
    ]
    if len(cameras) > 1:
        raise ScanError(
            f"{where}: expected one camera, found {len(cameras)}; leave in the colour camera's"
        )
    if cameras:
        words = cameras[0] if cameras[0][0] not in names else ["1", *cameras[0]]
        lens = camera_of_words(words, where).lens(where)
        return lambda *_: lens
    numbers = number_table(text.replace(",", " ").replace(";", " "))
    if numbers is None:
        return lens_of_yaml(text, where)
    if numbers.size in (4, 8, 9) and numbers.shape != (3, 3):
        values = numbers.ravel().tolist()
        return _lens(values[:4], None, tuple(values[4:]), False, where)
    return _lens(matrix_intrinsics(numbers, where), None, (), False, where)


def _lens(
    intrinsics: object,
    file_size: Size | None,
    distortion: tuple[float, ...],
    is_fisheye: bool,
    where: str,
) -> LensOfFrame:
    n_most = 4 if is_fisheye else 8
    if len(distortion) > n_most or not np.isfinite(distortion).all():
        raise ScanError(
            f"{where}: expected up to {n_most} coefficients of distortion, found {len(distortion)}"
        )
    coefficients = (*distortion, *[0.0] * (4 - len(distortion))) if any(distortion) else ()

    def lens(_: Frame, size: Size) -> Lens:
        camera = make_camera(*(file_size or size), intrinsics, where)
        return Lens(camera, coefficients, is_fisheye)

    return lens
