"""A sensor's calibration as a file, to be used for other scans of the same device: a small JSON."""

import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from planfit.errors import ScanError
from planfit.geometry.calibration import PARAMETERS, SensorCalibration
from planfit.geometry.camera import Camera
from planfit.runtime import write_whole
from planfit.scan.types import Scan
from planfit.scan.views import calibrated_scan

FORMAT, VERSION = "planfit-sensor", 1
MAX_FOCAL_SHARE = 0.05
"""Autofocus changes the focal length of a phone by 2 to 3 %; another lens differs by more than this."""
MAX_NUMBER = 1e12
"""Nothing that a camera has is so large, in any unit."""


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
    sensor = _sensor(content, path)
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
    if abs(mine / other - 1) <= MAX_FOCAL_SHARE:
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


def _sensor(content: dict[str, Any], path: Path) -> SensorCalibration:
    try:
        return SensorCalibration(**_numbers(content, "parameters", PARAMETERS, path))
    except ValueError as error:
        raise ScanError(f"{path}: {error}; make the calibration again") from error


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
        if not is_number or not abs(value) < MAX_NUMBER:
            raise ScanError(
                f"{path}: {table}.{name}: expected a number, found {value!r}; make the calibration again"
            )
        found[name] = float(value)
    return found
