"""Poses as text tables, whose columns a header names, or whose count tells them.

time x y z qx qy qz qw           TUM, with or without a header
# or % time x y z qw qx qy qz    raycloudtools and what is made by it (also q0 q1 q2 q3: w first)
time x y z                       positions alone; x y z time in .trjt and where a header says so
timestamp_nanoseconds pose00 ... pose23   HDMapping: 3x4, by row
Time[s],Easting[m],...           RiPROCESS and its like: roll, pitch and heading are left out
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from io import StringIO
from itertools import islice
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan.poses import MAX_ROTATION_DEFECT
from planfit.scan.tables import shorten, with_decimal_points

_NAMES = {
    "time": "time t timestamp timestamps gpstime gps_time gps_seconds sec seconds times time_s timestamp_s",
    "time_ns": "timestamp_nanoseconds timestamp_ns time_ns nanoseconds",
    "x": "x easting east e x/long tx px pose03 position_x pos_x x_m world_x p_rs_r_x pano_pos_x",
    "y": "y northing north n y/lat ty py pose13 position_y pos_y y_m world_y p_rs_r_y pano_pos_y",
    "z": "z elevation height altitude alt up h tz pz pose23 position_z pos_z z_m world_z p_rs_r_z pano_pos_z",
    "qw": "qw q0 quat_w ori_w q_w orientation_w q_rs_w pano_ori_w w",
    "qx": "qx q1 quat_x ori_x q_x orientation_x q_rs_x pano_ori_x",
    "qy": "qy q2 quat_y ori_y q_y orientation_y q_rs_y pano_ori_y",
    "qz": "qz q3 quat_z ori_z q_z orientation_z q_rs_z pano_ori_z",
    "angle": "roll pitch yaw heading pan tilt omega phi kappa r p",
    "geographic": "latitude longitude lat lon long",
}
_MEANING = {name: meaning for meaning, names in _NAMES.items() for name in names.split()} | {
    f"pose{i}{j}": f"r{i}{j}" for i in range(3) for j in range(3)
}
_ROTATION = [f"r{i}{j}" for i in range(3) for j in range(3)]
_QUATERNION = ["qx", "qy", "qz", "qw"]
TUM = ["time", "x", "y", "z", *_QUATERNION]
_HEADER_LINES = 40
SEPARATORS = re.compile(r"[\s,;]+")
EXPECTED = "a trajectory: lines `time x y z [qx qy qz qw]`, columns that a header names, or a cloud"


@dataclass(frozen=True)
class Columns:
    """Poses of a table in the order of its lines, and what it takes to write it anew."""

    times: Float[np.ndarray, " n"]
    """In the unit of the table."""
    poses: Float[np.ndarray, "n 4 4"]
    columns: tuple[str, ...] = ("time", "x", "y", "z")
    """What each means; empty where that is not known."""
    header: tuple[str, ...] = ()
    """Lines before the first of numbers."""
    rows: Sequence[tuple[str, ...]] = ()
    """Words of each line."""
    separator: str = " "
    """Between words."""


def named_columns(text: str) -> tuple[list[str], bool]:
    """What the header of a table says that its columns are, and whether it is a comment; nothing where there
    is no header that names places."""
    header: list[str] = []
    for line in islice(StringIO(text), _HEADER_LINES):
        if line.strip() and _is_number(SEPARATORS.split(line.strip())[0]):
            break
        header.append(line)
    columns = [_MEANING.get(word, "") for word in header_words(header)]
    return columns, all(line.lstrip()[:1] in ("", "#", "%") for line in header)


def parse_columns(text: str, path: Path, needs_times: bool = True) -> Columns:
    """Poses as listed, times as they are; `path` is where the text came from, for messages.

    Without `needs_times`, rows are counted where a header names all columns and none is a time.

    Raises:
        ScanError: it is of another form, or leaves open what its columns mean.
    """
    header, rows, separator = _split(with_decimal_points(text, path))
    if not rows:
        raise ScanError(f"{path}: expected {EXPECTED}, found no line of numbers")
    if len(rows) > 2 and len(rows[-1]) < len(rows[0]):
        rows.pop()  # the recording was stopped amid a line
    lengths = sorted({len(row) for row in rows})
    if len(lengths) > 1:
        raise ScanError(
            f"{path}: expected lines of one length, found {lengths[0]} to {lengths[-1]} words; export it "
            "again"
        )
    values = _numbers(rows, path)
    columns = _columns(path, header, values, needs_times)
    meant = [i for i, c in enumerate(columns) if c]
    known = np.flatnonzero(np.isfinite(values[:, meant]).all(axis=1))
    rows, values = [rows[i] for i in known], values[known]
    if len(values) < 2:
        raise ScanError(
            f"{path}: expected a trajectory, found {len(values)} poses with finite numbers"
        )
    named = {c: values[:, i] for i, c in enumerate(columns) if c}
    poses = _poses(path, named)
    times = np.arange(float(len(values)))
    if "time" in named or "time_ns" in named:
        times = named["time"] if "time" in named else named["time_ns"] / 1e9
    return Columns(times, poses, tuple(columns), tuple(header), rows, separator)


def _split(text: str) -> tuple[list[str], list[tuple[str, ...]], str]:
    """Lines before the first of numbers, words of all others, and what stands between words."""
    header: list[str] = []
    rows: list[tuple[str, ...]] = []
    separator = " "
    for line in text.splitlines():
        stripped = line.strip()
        if not stripped:
            continue
        if not rows and not _is_number(SEPARATORS.split(stripped)[0]):
            header.append(line)
        elif stripped[0] not in "#%/":
            if not rows:
                marks = [mark for mark in (";", ",", "\t") if mark in stripped]
                separator = marks[0] if marks else " "
            cells = stripped.split(separator) if separator in ",;\t" else stripped.split()
            rows.append(tuple(cell.strip() for cell in cells if separator in ",;\t" or cell))
    return header, rows, separator


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _numbers(rows: list[tuple[str, ...]], path: Path) -> Float[np.ndarray, "n c"]:
    """Cells as numbers; NaN for text, of which only columns without meaning may have any."""
    try:
        return np.array(rows, dtype=float)
    except ValueError:
        pass
    found = np.array([[float(w) if _is_number(w) else np.nan for w in row] for row in rows])
    if not np.isfinite(found).any():
        raise ScanError(f"{path}: expected numbers, found {shorten(' '.join(rows[0]))}")
    return found


def header_words(header: tuple[str, ...] | list[str]) -> list[str]:
    """Names of columns, without marks and units, in the last line of a header that has places in it."""
    for line in reversed(header):
        plain = line.strip().lstrip("#%/").replace(" [ns]", "_ns").replace("[ns]", "_ns")
        plain = re.sub(r"\s*[\[(][^\])]*[\])]", "", plain)
        names = plain.rpartition(": ")[2]  # NavVis: `# pano poses v1.0: ID; filename; ...`
        words = [word.strip().lower() for word in SEPARATORS.split(names.strip())]
        if {"x", "y", "z"} <= {_MEANING.get(word, "") for word in words}:
            return words
        if "geographic" in {_MEANING.get(word, "") for word in words}:
            return words
    return []


def _columns(path: Path, header: list[str], values: np.ndarray, needs_times: bool) -> list[str]:
    """What each column means.

    Raises:
        ScanError: that cannot be told.
    """
    n = values.shape[1]
    words = header_words(header)
    found = [_MEANING.get(word, "") for word in words]
    if "geographic" in found and "x" not in found:
        raise ScanError(
            f"{path}: expected coordinates in metres as the cloud has them, found latitude and longitude; "
            "export the trajectory in the coordinate system of the cloud"
        )
    # Columns beyond those that the header names are nobody's: `time x y z userfields`.
    named = [*found, *[""] * n][:n]
    if {"x", "y", "z"} <= set(named) and ({"time", "time_ns"} & set(named) or not needs_times):
        return _without_repeats(named)
    if n == 8:
        return list(TUM)
    if n == 9:  # RTAB-Map's export adds the node's number
        return [*TUM, ""]
    if n == 4:
        return _four(path, values)
    if n == 12:
        raise ScanError(
            f"{path}: expected times with the poses, found KITTI's twelve numbers a line, which have none; "
            "export it in TUM's form"
        )
    raise ScanError(
        f"{path}: expected {EXPECTED}; found {n} columns "
        f"{'named ' + shorten(' '.join(words)) if words else 'without a header'}; name them in its first line"
    )


def _without_repeats(columns: list[str]) -> list[str]:
    """The first of each meaning; angles may be several, and a quaternion or matrix counts whole alone."""
    kept: list[str] = []
    for column in columns:
        kept.append("" if column in kept and column != "angle" else column)
    for group in (_QUATERNION, _ROTATION):
        if not set(group) <= set(kept):
            kept = ["" if column in group else column for column in kept]
    return ["" if column == "geographic" else column for column in kept]


def _four(path: Path, values: np.ndarray) -> list[str]:
    """`time x y z` or `x y z time`: times go on, coordinates go back too."""
    goes_on = [bool((np.diff(values[:, i]) >= 0).all()) for i in (0, 3)]
    if path.suffix.lower() == ".trjt" or goes_on == [False, True]:
        return ["x", "y", "z", "time"]
    if goes_on == [True, False]:
        return ["time", "x", "y", "z"]
    both = "both the first and the last go on" if all(goes_on) else "neither goes on"
    raise ScanError(
        f"{path}: expected lines `time x y z` or `x y z time`, found lines of four numbers of which {both}; "
        "name the columns in its first line"
    )


def _poses(path: Path, named: dict[str, np.ndarray]) -> Float[np.ndarray, "n 4 4"]:
    positions = np.stack([named[c] for c in "xyz"], axis=1)
    rotations = np.tile(np.eye(3), (len(positions), 1, 1))
    if "qw" in named:
        quaternions = np.stack([named[c] for c in _QUATERNION], axis=1)
        if (np.abs(np.linalg.norm(quaternions, axis=1) - 1) > 0.1).any():
            raise ScanError(
                f"{path}: expected unit quaternions, found one of length "
                f"{np.linalg.norm(quaternions, axis=1).min():.3g}; export it again"
            )
        rotations = Rotation.from_quat(quaternions).as_matrix()
    elif "r00" in named:
        matrices = np.stack([named[c] for c in _ROTATION], axis=1).reshape(-1, 3, 3)
        if np.abs(np.linalg.det(matrices) - 1).max() > MAX_ROTATION_DEFECT:
            raise ScanError(f"{path}: expected rotations in pose00 to pose22, found other matrices")
        rotations = se3.project_to_so3(matrices)
    return se3.make_transform(rotations, positions)


def columns_of(
    poses: Float[np.ndarray, "n 4 4"], metres_away: Float[np.ndarray, "3"]
) -> dict[str, np.ndarray]:
    """Values of all columns that a pose may have."""
    values = dict(zip("xyz", (poses[:, :3, 3] + metres_away).T, strict=True))
    quaternions = Rotation.from_matrix(poses[:, :3, :3]).as_quat(canonical=True)
    values |= dict(zip(_QUATERNION, quaternions.T, strict=True))
    return values | {c: poses[:, int(c[1]), int(c[2])] for c in _ROTATION}
