"""Trajectories of laser scanners: text tables whose columns a header names, or whose count tells them.

    time x y z qx qy qz qw           TUM, with or without a header
    # or % time x y z qw qx qy qz    raycloudtools and what is made by it (also q0 q1 q2 q3: w first)
    time x y z                       positions alone; x y z time in .trjt and where a header says so
    timestamp_nanoseconds pose00 ... pose23   HDMapping: 3x4, by row
    Time[s],Easting[m],...           RiPROCESS and its like: roll, pitch and heading are left out

A frame needs the scanner's place alone, so that neither the axes of the trajectory nor the order of its
angles can be mistaken; rotations are carried along and written back.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from io import StringIO
from itertools import islice
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan.poses import MAX_ENTRY, contradicts_path, poses_at
from planfit.scan.tables import shorten, with_decimal_points

MAX_GAP_S = 0.2
"""A place is known this near to a recorded one, and between two that are six times as far apart."""
CLOCK_UNITS = (1.0, 1e-3, 1e-6, 1e-9, 1e-12, 1e-15)
"""Seconds of what clocks count, and programs that multiply twice."""
_UNIT_NAMES = {1e-3: "milliseconds", 1e-6: "microseconds", 1e-9: "nanoseconds"}
MIN_SPEED_M_S = 0.005
"""A scanner that is carried or driven is faster on average, or its clock counts another unit."""

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
_SEPARATORS = re.compile(r"[\s,;]+")
EXPECTED = "a trajectory: lines `time x y z [qx qy qz qw]`, columns that a header names, or a cloud"


@dataclass(frozen=True)
class Trajectory:
    """Where the scanner was, in the axes of its cloud."""

    path: Path
    times: Float[np.ndarray, " n"]
    """s, increasing, of its own clock."""
    world_from_scanner: Float[np.ndarray, "n 4 4"]
    """As recorded; without rotations (identity) where it has none."""
    columns: tuple[str, ...]
    """What each column of the file means; empty for what is carried along."""
    header: tuple[str, ...]
    """Lines before the first pose."""
    rows: tuple[tuple[str, ...], ...]
    """Words of each pose; none of a trajectory that is a cloud."""
    separator: str
    metres_away: Float[np.ndarray, "3"]
    """What was taken off positions: they are near the origin then."""
    seconds_per_unit: float = 1.0
    """Of times in the file, which do not say their unit."""

    @property
    def has_rotation(self) -> bool:
        """Whether rotations are recorded."""
        return "qw" in self.columns or "r00" in self.columns

    @property
    def warnings(self) -> tuple[str, ...]:
        """What of the file is not used, or taken in another unit."""
        unit = (
            f"{self.path.name}: times are {clock_unit(self.seconds_per_unit)}, not seconds: as seconds, the "
            "scanner would hardly move",
        ) if self.seconds_per_unit != 1 else ()  # fmt: skip
        if "angle" not in self.columns:
            return unit
        named = ", ".join(
            name for name, c in zip(_header_words(self.header), self.columns, strict=False)
            if c == "angle"
        )  # fmt: skip
        return (
            *unit,
            f"{self.path.name}: angles ({named}) are not read, as their order differs between programs: only "
            "positions are taken, and angles are left out of the refined trajectory",
        )

    def moved(self, offset: Float[np.ndarray, "3"]) -> "Trajectory":
        """The same with an offset (m) taken off positions."""
        poses = self.world_from_scanner.copy()
        poses[:, :3, 3] -= offset
        return replace(self, world_from_scanner=poses, metres_away=self.metres_away + offset)

    def at(
        self, times: Float[np.ndarray, " k"], max_gap_s: float = MAX_GAP_S
    ) -> tuple[Float[np.ndarray, "k 4 4"], Bool[np.ndarray, " k"]]:
        """Poses at times (s) of its clock, and which of them are known."""
        return poses_at(self.times, self.world_from_scanner, times, max_gap_s)

    def write(self, path: Path, world_from_scanner: Float[np.ndarray, "n 4 4"]) -> None:
        """The file again, with other poses (in the axes of `world_from_scanner`); all else as it was."""
        kept = [i for i, c in enumerate(self.columns) if c != "angle"]
        values = _columns_of(world_from_scanner, self.metres_away)
        at = {i: values[c] for i, c in enumerate(self.columns) if c in values}
        lines = [self._kept_header(line, kept) for line in self.header]
        for k, row in enumerate(self.rows):
            words = [f"{at[i][k]:.9f}" if i in at else row[i] for i in kept]
            lines.append(self.separator.join(words))
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")

    def _kept_header(self, line: str, kept: list[int]) -> str:
        words = _SEPARATORS.split(line.strip())
        if len(kept) == len(self.columns) or len(words) != len(self.columns):
            return line
        return self.separator.join(words[i] for i in kept)


@dataclass(frozen=True)
class Columns:
    """Poses of a table, as listed; all else as `Trajectory` has it."""

    times: Float[np.ndarray, " n"]
    """In the unit of the table."""
    poses: Float[np.ndarray, "n 4 4"]
    columns: tuple[str, ...] = ("time", "x", "y", "z")
    header: tuple[str, ...] = ()
    rows: Sequence[tuple[str, ...]] = ()
    separator: str = " "


def read_trajectory(path: Path) -> Trajectory:
    """A trajectory of a text file.

    Raises:
        ScanError: it is missing, of another form, or leaves open what its columns mean.
    """
    return parse_trajectory(_read_text(path), path)


def named_columns(text: str) -> tuple[list[str], bool]:
    """What the header of a table says that its columns are, and whether it is a comment; nothing where there
    is no header that names places."""
    header: list[str] = []
    for line in islice(StringIO(text), _HEADER_LINES):
        if line.strip() and _is_number(_SEPARATORS.split(line.strip())[0]):
            break
        header.append(line)
    columns = [_MEANING.get(word, "") for word in _header_words(header)]
    return columns, all(line.lstrip()[:1] in ("", "#", "%") for line in header)


def parse_trajectory(text: str, path: Path) -> Trajectory:
    """As `read_trajectory`, of the text of a file; `path` is where it came from, for messages.

    Raises:
        ScanError: it is of another form, or leaves open what its columns mean.
    """
    table = parse_columns(text, path)
    return in_order(path, table)


def parse_columns(text: str, path: Path) -> Columns:
    """As `parse_trajectory`, as listed, and times as they are.

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
    columns = _columns(path, header, values)
    meant = [i for i, c in enumerate(columns) if c]
    known = np.flatnonzero(np.isfinite(values[:, meant]).all(axis=1))
    rows, values = [rows[i] for i in known], values[known]
    if len(values) < 2:
        raise ScanError(
            f"{path}: expected a trajectory, found {len(values)} poses with finite numbers"
        )
    named = {c: values[:, i] for i, c in enumerate(columns) if c}
    poses = _poses(path, named)
    times = named["time"] if "time" in named else named["time_ns"] / 1e9
    return Columns(times, poses, tuple(columns), tuple(header), rows, separator)


def in_order(path: Path, table: Columns) -> Trajectory:
    """Poses in the order of their times, as seconds.

    Raises:
        ScanError: times do not go on, or places are nowhere.
    """
    times, poses, rows = table.times, table.poses, table.rows
    if contradicts_path(times, poses[:, :3, 3]):
        back = int(np.argmax(np.diff(times) < 0))
        raise ScanError(
            f"{path}: expected times that go on along the path, found {times[back + 1]:.6f} after "
            f"{times[back]:.6f} (pose {back + 1}), as of several clocks, or durations; points of the cloud "
            "cannot be told their places: export it with times of the cloud's clock, or each part alone"
        )
    seconds_per_unit = seconds_of_unit(times, poses)
    order = np.argsort(times, kind="stable")
    times, poses = times[order] * seconds_per_unit, poses[order]
    if np.abs(poses[:, :3, 3]).max() >= MAX_ENTRY or not times[-1] > times[0]:
        raise ScanError(
            f"{path}: expected places in metres at times that go on, found coordinates up to "
            f"{np.abs(poses[:, :3, 3]).max():.4g} over {np.ptp(times):.4g} s"
        )
    ordered = tuple(rows[i] for i in order) if rows else ()
    return Trajectory(
        path, times, poses, table.columns, table.header, ordered, table.separator, np.zeros(3),
        seconds_per_unit,
    )  # fmt: skip


def seconds_of_unit(times: Float[np.ndarray, " n"], poses: Float[np.ndarray, "n 4 4"]) -> float:
    """Seconds of a unit of times that do not say it: 1, unless the scanner would hardly move at that; then
    that of `CLOCK_UNITS` by which it moves at a metre a second or so."""
    order = np.argsort(times, kind="stable")
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        length_m = np.linalg.norm(np.diff(poses[order, :3, 3], axis=0), axis=1).sum()
        speed_m_s = length_m / np.ptp(times)
    if not 0 < speed_m_s < MIN_SPEED_M_S:
        return 1.0
    return min(CLOCK_UNITS, key=lambda unit: abs(np.log(speed_m_s / unit)))


def clock_unit(seconds_per_unit: float) -> str:
    """What a clock counts, in words."""
    return _UNIT_NAMES.get(seconds_per_unit, f"counts of {seconds_per_unit:g} s")


def _read_text(path: Path) -> str:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ScanError(
            f"{path}: expected {EXPECTED}, found none that can be read ({error.strerror}); check the path"
        ) from error
    if b"\0" in data[:4096]:
        is_sbet = len(data) % 136 == 0
        found = "a binary SBET, which has latitude and longitude" if is_sbet else "a binary file"
        raise ScanError(
            f"{path}: expected {EXPECTED}, found {found}; export it as text in the coordinate system of the "
            "cloud"
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ScanError(
            f"{path}: expected {EXPECTED}, found other bytes ({error.reason})"
        ) from error


def _split(text: str) -> tuple[list[str], list[tuple[str, ...]], str]:
    """Lines before the first of numbers, words of all others, and what stands between words."""
    header: list[str] = []
    rows: list[tuple[str, ...]] = []
    separator = " "
    for line in text.splitlines():
        stripped = line.strip()
        if not stripped:
            continue
        if not rows and not _is_number(_SEPARATORS.split(stripped)[0]):
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


def _header_words(header: tuple[str, ...] | list[str]) -> list[str]:
    """Names of columns, without marks and units, in the last line of a header that has places in it."""
    for line in reversed(header):
        plain = line.strip().lstrip("#%/").replace(" [ns]", "_ns").replace("[ns]", "_ns")
        plain = re.sub(r"\s*[\[(][^\])]*[\])]", "", plain)
        names = plain.rpartition(": ")[2]  # NavVis: `# pano poses v1.0: ID; filename; ...`
        words = [word.strip().lower() for word in _SEPARATORS.split(names.strip())]
        if {"x", "y", "z"} <= {_MEANING.get(word, "") for word in words}:
            return words
        if "geographic" in {_MEANING.get(word, "") for word in words}:
            return words
    return []


def _columns(path: Path, header: list[str], values: np.ndarray) -> list[str]:
    """What each column means.

    Raises:
        ScanError: that cannot be told.
    """
    n = values.shape[1]
    words = _header_words(header)
    found = [_MEANING.get(word, "") for word in words]
    if "geographic" in found and "x" not in found:
        raise ScanError(
            f"{path}: expected coordinates in metres as the cloud has them, found latitude and longitude; "
            "export the trajectory in the coordinate system of the cloud"
        )
    # Columns beyond those that the header names are nobody's: `time x y z userfields`.
    named = [*found, *[""] * n][:n]
    if {"x", "y", "z"} <= set(named) and {"time", "time_ns"} & set(named):
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
        if np.abs(np.linalg.det(matrices) - 1).max() > 0.01:
            raise ScanError(f"{path}: expected rotations in pose00 to pose22, found other matrices")
        rotations = se3.project_to_so3(matrices)
    return se3.make_transform(rotations, positions)


def _columns_of(
    poses: Float[np.ndarray, "n 4 4"], metres_away: Float[np.ndarray, "3"]
) -> dict[str, np.ndarray]:
    """Values of all columns that a pose may have."""
    values = dict(zip("xyz", (poses[:, :3, 3] + metres_away).T, strict=True))
    quaternions = Rotation.from_matrix(poses[:, :3, :3]).as_quat(canonical=True)
    values |= dict(zip(_QUATERNION, quaternions.T, strict=True))
    return values | {c: poses[:, int(c[1]), int(c[2])] for c in _ROTATION}
