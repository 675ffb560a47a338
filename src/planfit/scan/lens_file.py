"""What is known of a device beforehand, as files: its lens, and its calibration."""

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from planfit.errors import ScanError
from planfit.geometry.calibration import PARAMETERS, SensorCalibration
from planfit.geometry.camera import Camera
from planfit.priors import COORDINATE_MOST_M
from planfit.runtime import write_whole
from planfit.scan.formats.colmap_model import MODELS, camera_of_words
from planfit.scan.images.lens import Lens, make_camera, matrix_intrinsics
from planfit.scan.recording import Frame, LensOfFrame, Size
from planfit.scan.tables import number_table, numbers_of, shorten
from planfit.scan.types import Scan
from planfit.scan.views import calibrated_scan

EXPECTED = (
    "a lens: YAML of ROS or OpenCV with camera_matrix, JSON, a camera of COLMAP, or fx fy cx cy"
)
_MATRICES = ("camera_matrix", "k", "cam_k", "intrinsic_matrix", "intrinsics", "intrinsic", "matrix")
_DISTORTIONS = ("distortion_coefficients", "d", "distortion_coeffs", "coeffs", "distortion", "dist_coeffs",
                "dist")  # fmt: skip
_SCALARS = (("fx", "fl_x", "focal_x"), ("fy", "fl_y", "focal_y"), ("cx", "ppx"), ("cy", "ppy"))
"""Names that programs have for a matrix (or fx fy cx cy), for distortion, and for each of fx fy cx cy."""
_OTHER_CAMERAS = re.compile("depth|infra|right|(^|[^a-z])ir[^a-z]")
"""Of the names of lenses that are not the colour camera's."""
_NUMBER = r"[-+]?[\d.]+(?:[eE][-+]?\d+)?"
_MATRIX = re.compile(
    r"^[ \t]*([\w.]+):[^\n\[#]*(?:\n[ \t]+(?:rows|cols|dt):[^\n]*)*(?:\n[ \t]+data:[ \t]*)?"
    rf"(?:\[([^\]]*)\]|((?:\n[ \t]*-[ \t]+{_NUMBER})+))",
    re.MULTILINE,
)
_SCALAR = re.compile(r"^[ \t]*([\w.]+):[ \t]*([^\s\[#][^\n#]*)(?:#[^\n]*)?$", re.MULTILINE)
FISHEYES = ("fisheye", "equidistant", "kannalabrandt8")
FORMAT, VERSION = "planfit-sensor", 1
_MAX_FOCAL_SHARE = 0.05
"""Autofocus changes the focal length of a phone by 2 to 3 %; another lens differs by more than this."""


def yaml_values(text: str, where: str) -> tuple[dict[str, list[float]], dict[str, str]]:
    """Lists of numbers (matrices by row) and single values of a camera's YAML file, by names in lower case,
    whatever group they stand in.

    Raises:
        ScanError: a list holds what is no number; it begins with `where`.
    """
    lists = {}
    for name, inline, dashes in _MATRIX.findall(text):
        found = re.findall(_NUMBER, inline or dashes.replace("- ", " "))
        try:
            lists[name.lower()] = [float(word) for word in found]
        except ValueError as error:
            raise ScanError(
                f"{where}: expected numbers of {name}, found {shorten(error)}"
            ) from error
    scalars = {name.lower(): value.strip().strip("\"'") for name, value in _SCALAR.findall(text)}
    return lists, scalars


def lens_of_yaml(text: str, where: str) -> LensOfFrame:
    """The lens that the text of a YAML file tells; where it tells no size, for images of any.

    Raises:
        ScanError: it tells none; it begins with `where`.
    """
    return _lens_of_values(*yaml_values(text, where), where)


def _lens_of_values(
    lists: Mapping[str, list[float]], scalars: Mapping[str, object], where: str
) -> LensOfFrame:
    """By lists of numbers and single values, by their names in lower case."""
    try:
        matrix = next((lists[name] for name in _MATRICES if lists.get(name)), [])
        distortion = next((lists[name] for name in _DISTORTIONS if name in lists), [])
        group = next((g for g in ("camera.", "camera1.") if f"{g}fx" in scalars), "")
        if not matrix:
            matrix = [
                _number(next(scalars[f"{group}{n}"] for n in names if f"{group}{n}" in scalars))
                for names in _SCALARS
            ]
            half = 0.5 if "fl_x" in scalars else 0.0  # NeRF's count from the first pixel's corner
            matrix[2:] = [v - half for v in matrix[2:]]
            keys = [f"{group}{name}" for name in ("k1", "k2", "p1", "p2", "k3")]
            distortion = distortion or [_number(scalars.get(key, 0.0)) for key in keys]
        sizes = [("image_width", "image_height"), ("width", "height"), ("w", "h")]
        sizes.append(("camera.width", "camera.height"))
        size = next(
            (
                (int(_number(scalars[w])), int(_number(scalars[h])))
                for w, h in sizes
                if w in scalars
            ),
            None,
        )
    except (ValueError, OverflowError, KeyError, StopIteration) as error:
        # An end without a word is that of the search for fx, fy, cx, cy.
        raise ScanError(
            f"{where}: expected {EXPECTED}, found {shorten(error) or 'none'}"
        ) from error
    kinds = (
        scalars.get(n, "") for n in ("distortion_model", "camera.type", "camera_model", "model")
    )
    kind = next((str(one).lower() for one in kinds if one), "")
    if "inverse" in kind and any(distortion):
        raise ScanError(
            f"{where}: expected distortion as OpenCV has it, found {shorten(kind)}, the other way; "
            "undistort the images, or give another lens with --intrinsics"
        )
    is_fisheye = any(name in kind for name in FISHEYES)
    return _lens(_four(np.array(matrix), where), size, tuple(distortion), is_fisheye, where)


def _number(value: object) -> float:
    return float(str(value))


def _four(numbers: Float[np.ndarray, "..."], where: str) -> tuple[float, ...]:
    """fx fy cx cy, by these four, or a matrix of 3x3, 3x4 or 4x4 by row, or 3x3 by column (Open3D)."""
    if numbers.size == 4:
        return tuple(numbers.ravel().tolist())
    rows = {9: 3, 12: 3, 16: 4}.get(numbers.size)
    if rows is None:
        raise ScanError(f"{where}: expected {EXPECTED}, found {numbers.size} numbers")
    matrix = numbers.reshape(rows, -1)[:3, :3]
    return matrix_intrinsics(matrix if matrix[0, 2] else matrix.T, where)


def _lens_of_json(text: str, where: str) -> LensOfFrame:
    """Of the colour camera, however deep it stands."""
    try:
        found = list(_lenses_of_json(json.loads(text), where))
    except (ValueError, RecursionError) as error:
        raise ScanError(f"{where}: expected {EXPECTED}, found no JSON ({error})") from error
    if not found:
        raise ScanError(f"{where}: expected {EXPECTED}, found JSON without")
    own = [one for one in found if not _OTHER_CAMERAS.search(one[0])] or found
    anywhere = Frame("", 0.0, np.eye(4), "", "")
    if len({lens(anywhere, (1, 1)) for _, lens in own}) != 1:
        raise ScanError(
            f"{where}: expected one lens, found {len(own)} that differ; give the colour camera's alone with "
            "--intrinsics FILE"
        )
    return own[0][1]


def _lenses_of_json(value: object, where: str, name: str = "") -> Iterator[tuple[str, LensOfFrame]]:
    """Lenses of a value and of all in it, by the names that lead there."""
    if isinstance(value, list):
        for one in value:
            yield from _lenses_of_json(one, where, name)
    if not isinstance(value, dict):
        return
    values = {str(key).lower(): one for key, one in value.items()}
    for key in [key for key in values if "dist" in key and isinstance(values[key], dict)]:
        values |= {str(name).lower(): one for name, one in values[key].items()}
    lists = {
        key: numbers_of(one).ravel().tolist()
        for key, one in values.items()
        if isinstance(one, list)
    }
    try:
        yield name, _lens_of_values({k: v for k, v in lists.items() if v}, values, where)
    except ScanError:
        if {"fx", "fl_x", "camera_matrix"} & values.keys():
            raise
        for key, one in values.items():
            yield from _lenses_of_json(one, where, f"{name}.{key}")


def read_lens(path: Path) -> LensOfFrame:
    """The lens of a file, for all frames of a scan.

    Raises:
        ScanError: it cannot be read, or holds none.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ScanError(f"{path}: expected {EXPECTED}, found none that can be read") from error
    return lens_of_text(text, str(path))


def lens_of_text(text: str, where: str) -> LensOfFrame:
    """As `read_lens`, of the text of a file; messages begin with `where`."""
    if text.lstrip()[:1] in ("{", "["):
        return _lens_of_json(text, where)
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
    values = numbers.ravel().tolist()
    # Nine in a line are fx fy cx cy with distortion, or a matrix, whose second number is the skew.
    if numbers.size == 8 or (numbers.size == 9 and 1 in numbers.shape and abs(values[1]) > 1):
        return _lens(values[:4], None, tuple(values[4:]), False, where)
    return _lens(_four(numbers, where), None, (), False, where)


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


def write_calibration(
    path: Path, sensor: SensorCalibration, sigmas: Mapping[str, float], camera: Camera
) -> None:
    """Write a calibration: parameters and standard deviations in the units of `SensorCalibration`.

    Args:
        path: the file.
        sensor: what is corrected.
        sigmas: standard deviation of each of `PARAMETERS`; 0 of what was held.
        camera: the device's first one, as its files say, by which another device is noticed.

    Raises:
        OutputError: the file cannot be written.
    """
    content = {
        "format": FORMAT,
        "version": VERSION,
        "parameters": asdict(sensor),
        "sigmas": {name: sigmas[name] for name in PARAMETERS},
        "camera": asdict(camera),
    }
    write_whole(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def take_calibration(scan: Scan, path: Path) -> Scan:
    """The scan corrected by a calibration of a file; a warning where that is of another device.

    Raises:
        ScanError: the file cannot be read, or is no calibration of this version.
    """
    content = _content(path)
    try:
        sensor = SensorCalibration(**_numbers(content, "parameters", PARAMETERS, path))
    except ValueError as error:
        raise ScanError(f"{path}: {error}; make the calibration again") from error
    of_file = _numbers(content, "camera", ("width", "fx"), path)
    if min(of_file.values()) <= 0:
        raise ScanError(
            f"{path}: expected a camera's width and fx above 0, found {of_file['width']:g} and "
            f"{of_file['fx']:g}; make the calibration again"
        )
    mine, other = scan.cameras[0].fx / scan.cameras[0].width, of_file["fx"] / of_file["width"]
    try:
        corrected = calibrated_scan(scan, sensor)
    except ValueError as error:  # of a camera whose numbers it makes infinite or negative
        raise ScanError(
            f"{path}: expected a calibration that leaves a camera, found one by which {error}; make it again"
        ) from error
    if abs(mine / other - 1) <= _MAX_FOCAL_SHARE:
        return corrected
    words = (
        f"{path.name} was made with a camera whose focal length is {other:.3f} of the image's width, and "
        f"that of this scan is {mine:.3f}: is it the same device? Else leave out --calibration"
    )
    return replace(corrected, warnings=(*corrected.warnings, words))


def _content(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ScanError(
            f"{path}: expected a calibration of 'planfit calibrate', found none that can be read "
            f"({error.strerror}); check the path"
        ) from error
    except (ValueError, RecursionError) as error:
        raise ScanError(
            f"{path}: expected a calibration of 'planfit calibrate', found no JSON; make it again"
        ) from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise ScanError(
            f"{path}: expected a calibration of 'planfit calibrate', found other JSON; make one with "
            "'planfit calibrate SCAN -o FILE'"
        )
    if content.get("version") != VERSION:
        raise ScanError(
            f"{path}: expected a calibration of version {VERSION}, found {content.get('version')!r}; make it "
            "again with this version of planfit"
        )
    return content


def _numbers(
    content: dict[str, Any], table: str, names: tuple[str, ...], path: Path
) -> dict[str, float]:
    """Numbers of a table of the file, by their names; all have to be there."""
    values = content.get(table)
    found = {}
    for name in names:
        if not isinstance(values, dict) or name not in values:
            raise ScanError(
                f"{path}: expected {table}.{name}, found none; make the calibration again"
            )
        value = values[name]
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not is_number or not abs(value) < COORDINATE_MOST_M.value:
            raise ScanError(
                f"{path}: {table}.{name}: expected a number, found {value!r}; make the calibration again"
            )
        found[name] = float(value)
    return found
