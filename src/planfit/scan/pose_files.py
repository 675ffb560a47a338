"""Poses of another tracker, which take the place of a scan's own: TUM, KITTI, EuRoC, Open3D log, and tables
whose header names the columns."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from planfit.errors import ScanError
from planfit.scan.laser.cloud import MIN_SPAN_SHARE
from planfit.scan.laser.trajectory import CLOCK_UNITS, clock_unit
from planfit.scan.pose_columns import TUM, named_columns, parse_columns
from planfit.scan.poses import (
    MAX_ROTATION_DEFECT,
    are_of_a_clock,
    check_recorded_poses,
    is_lost,
    parse_tum,
    poses_at,
    tum_poses,
)
from planfit.scan.source import FileSource, read_text
from planfit.scan.tables import number_table, shorten, with_decimal_points
from planfit.scan.types import Scan
from planfit.scan.views import select_frames

NO_CLOCK = (
    "{} repeat or contradict the path, as durations or those of several clocks: frames are in the order of "
    "the lists, line by line, without times"
)
"""What to say of times that are left aside."""
_WIDTHS = (7, 8, 9, 12, 13, 16, 17)
"""Numbers a line of tables of poses."""
MIN_NS_DIGITS = 15
"""Nanoseconds since 1970 have nineteen digits; no time in seconds has so many before its point."""


@dataclass(frozen=True)
class PoseTable:
    """Poses out of a file, and what tells the frames they belong to."""

    kind: str
    """`tum` (of EuRoC too), `kitti` or `log`."""
    keys: Shaped[np.ndarray, " n"]
    """Times (TUM, EuRoC), numbers (log), or rows (KITTI)."""
    poses: Float[np.ndarray, "n 4 4"]
    """target_from_cam, OpenCV camera axes."""
    numbers: Float[np.ndarray, " n"] | None = None
    """Of RTAB-Map's nodes, where the file has them."""


def read_poses(path: Path) -> PoseTable:
    """Poses of a file; its kind is told by how many numbers a line has.

    Raises:
        ScanError: it is missing or of none of these kinds.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ScanError(
            f"{path}: expected a file of poses, found none that can be read ({reason}); check the path"
        ) from error
    return parse_poses(text, path)


def read_poses_of(source: FileSource, name: str) -> PoseTable:
    """As `read_poses`, of a file of a scan."""
    return parse_poses(read_text(source, name), source.path / name)


def parse_poses(content: str, path: Path) -> PoseTable:
    """As `read_poses`, of the text of a file; `path` is where it came from, for messages.

    Raises:
        ScanError: it is of none of these kinds.
    """
    content = with_decimal_points(content, path)
    if not _is_euroc(content) and _has_names(content):
        named = parse_columns(content, path, needs_times=False)
        is_timed = not {"time", "time_ns"}.isdisjoint(named.columns)
        return PoseTable("tum" if is_timed else "kitti", named.times, named.poses)
    content = content.replace(";", " ")
    table = number_table(content.replace(",", " "))
    if table is not None and table.shape[1] == 4:
        table = _blocks(table)
    if table is not None and table.shape[1] in _WIDTHS and not _is_euroc(content):
        return _of_numbers(table, content, path)
    rows = [
        text.split()
        for line in content.splitlines()
        if (text := line.split("#")[0].replace(",", " ")).strip()
    ]
    lengths = [len(row) for row in rows]
    if lengths and min(lengths) >= 8 and _is_euroc(content):
        return PoseTable("tum", *parse_tum(_tum_of_euroc(rows), path))
    if lengths and set(lengths) == {8}:
        return PoseTable("tum", *parse_tum(content, path))
    values = _numbers(rows, path)
    # Blocks of five lines: the frame's numbers, then the rows of its pose.
    if lengths and len(rows) % 5 == 0 and lengths == [3, 4, 4, 4, 4] * (len(rows) // 5):
        poses = np.array([values[i + 1 : i + 5] for i in range(0, len(rows), 5)])
        table = PoseTable("log", np.array([row[0] for row in values[::5]]), poses)
    else:
        raise ScanError(
            f"{path}: expected poses as TUM (8 numbers a line, or 7), KITTI (12 a line, or 16), EuRoC (csv), "
            f"matrices below each other, or Open3D log (a line of 3 and four of 4), found lines of "
            f"{', '.join(map(str, sorted(set(lengths)))) or 'nothing'}; or name the columns in a first line: "
            "time,x,y,z,qx,qy,qz,qw"
        )
    check_recorded_poses(table.poses, f"{path}: pose")
    return table


def _blocks(rows: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "k c"] | None:
    """Matrices of 4x4 or of 3x4 below each other as one a row; None where rows are neither."""
    last = rows[3::4]
    if len(rows) % 4 == 0 and ((last == (0, 0, 0, 1)) | ~np.isfinite(last)).all():
        return rows.reshape(-1, 16)
    return rows.reshape(-1, 12) if len(rows) % 3 == 0 else None


def _of_numbers(values: Float[np.ndarray, "n c"], content: str, path: Path) -> PoseTable:
    """Poses of a table of 7 columns (TUM's without time), 8 (TUM), 9 (RTAB-Map's, which adds the node's
    number), 12 (KITTI) or 16 (whole matrices, as Replica and programs that render have them), or of 13 or 17,
    with a time or number before a matrix."""
    if values.shape[1] == 7:
        if np.abs(np.linalg.norm(values[:, 3:], axis=1) - 1).max() > MAX_ROTATION_DEFECT:
            raise ScanError(
                f"{path}: expected lines x y z qx qy qz qw, found lines of 7 numbers whose last four are no "
                "unit quaternion; name the columns in a first line, such as qw,qx,qy,qz,x,y,z"
            )
        timed = np.column_stack([np.arange(len(values)), values])
        return PoseTable("kitti", *tum_poses(timed, content, path))
    if values.shape[1] in (13, 17):
        table = _of_numbers(values[:, 1:], content, path)
        return replace(table, kind="tum", keys=values[:, 0])
    if values.shape[1] in (12, 16):
        poses = np.tile(np.eye(4), (len(values), 1, 1))  # of KITTI, the last row is not in the file
        poses[:, : values.shape[1] // 4] = values.reshape(len(values), -1, 4)
        if (poses[:, :3, 3] == 0).all() and (poses[:, 3, 3] == 1).all() and values.shape[1] == 16:
            poses = poses.transpose(0, 2, 1)  # by column, as OpenGL and ARKit lay matrices out
        check_recorded_poses(poses, f"{path}: pose")
        return PoseTable("kitti", np.arange(len(values)), poses)
    if values.shape[1] == 8:
        return PoseTable("tum", *tum_poses(values, content, path))
    # Lines of a tracker that was lost are left out here, so that poses and numbers are of the same lines.
    values = values[np.isfinite(values).all(axis=1) & values[:, 4:8].any(axis=1)]
    return PoseTable("tum", *tum_poses(values[:, :8], content, path), values[:, 8])


def _has_names(content: str) -> bool:
    """Whether a header names all columns of poses, and no plain reader of TUM would take them for what they
    are: it is no comment, or says another order."""
    columns, is_comment = named_columns(content)
    is_whole = {"x", "y", "z", *TUM[4:]} <= set(columns)
    return is_whole and not (is_comment and columns[:8] == TUM)


def _is_euroc(content: str) -> bool:
    """Whether the first row begins with whole nanoseconds since 1970 and a comma: no other kind does."""
    for line in StringIO(content):
        if text := line.split("#")[0].strip():
            return is_ns(text.split(",")[0]) and "," in text
    return False


def is_ns(word: str) -> bool:
    """Whether a word is a time in whole nanoseconds since 1970."""
    return word.isdecimal() and len(word) > MIN_NS_DIGITS


def _tum_of_euroc(rows: list[list[str]]) -> str:
    """EuRoC's table (time ns, x y z, quaternion with w first, then velocities and biases) as TUM's."""
    lines = []
    for ns, x, y, z, w, *xyz in (row[:8] for row in rows):
        time = f"{ns[:-9]}.{ns[-9:]}" if is_ns(ns) else "nan"
        lines.append(" ".join([time, x, y, z, *xyz, w]))
    return "\n".join(lines)


def take_poses(scan: Scan, path: Path, max_gap_s: float) -> Scan:
    """The scan with poses of a file instead of its own; frames without one are left out and named.

    TUM poses belong to frames by time (by number, where the scan counts frames; by row, where there are as
    many and their times are none of a clock), logs by number, KITTI poses by row. The file's world is its
    own: neither up nor the plan's axes are known in it.

    Raises:
        ScanError: the file cannot be read, or its poses belong to none of the frames.
    """
    table = read_poses(path)
    poses, known, told = poses_of_images(scan.frame_ids, scan.timestamps, table, path, max_gap_s)
    if not known.any():
        raise ScanError(
            f"{path}: expected poses at times between {scan.timestamps.min():.3f} and "
            f"{scan.timestamps.max():.3f}, as the frames of {scan.name} have them, found "
            f"{table.keys.min():.3f} to {table.keys.max():.3f}, none within {max_gap_s:g} s of a frame; "
            "are they of this scan? Else give --max-time-gap-s"
        )
    without = [
        f"frame {scan.frame_ids[i]}: {path.name} has no pose" for i in np.flatnonzero(~known)
    ]
    digest = hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    chosen = select_frames(scan, np.flatnonzero(known), poses[known])
    return replace(
        chosen,
        up_world=None,
        plan_from_world_axes=None,
        fingerprint=f"{scan.fingerprint}-{digest}" if scan.fingerprint else "",
        skipped=(*scan.skipped, *without),
        warnings=tuple(dict.fromkeys((*scan.warnings, *told))),
    )


def poses_of_images(
    ids: Sequence[str],
    times: Float[np.ndarray, " n"],
    table: PoseTable,
    path: Path,
    max_gap_s: float,
) -> tuple[Float[np.ndarray, "n 4 4"], Bool[np.ndarray, " n"], list[str]]:
    """A pose for each image, whether it is known, and what to say of how they were told.

    By time, or by row where there are as many and the times are none of a clock, or the images have none:
    the first, second ... image was not taken one, two ... seconds after the epoch.

    Raises:
        ScanError: rows are not as many as images that have no times; names the file by `path`.
    """
    told: list[str] = []
    numbers, where = _frame_numbers(ids), f"{path}: expected"
    are_counted = numbers is not None and bool(
        (numbers == times).all() and np.ptp(numbers) == len(numbers) - 1 and (table.keys % 1).any()
    )
    if table.kind == "tum":
        if not are_counted:
            table, told = in_seconds(table, times, max_gap_s, path.name)
        is_clocked = are_of_a_clock(table.keys, table.poses[:, :3, 3])
        if len(table.keys) == len(ids) and (are_counted or not is_clocked):
            rows = f"images are numbered, {path.name} has times: rows are taken in order"
            told = [rows if is_clocked else NO_CLOCK.format(f"times of {path.name}")]
            return table.poses, ~is_lost(table.poses), told
    poses, known = poses_of_frames(ids, times, table, where, max_gap_s)
    if table.kind == "tum" and are_counted and known.mean() < 0.5:
        raise ScanError(
            f"{where} a row for each of {len(ids)} images, which are numbered {ids[0]} to {ids[-1]}, found "
            f"{len(table.keys)} rows with times; write the numbers of the images in place of the times"
        )
    return poses, known, told


def in_seconds(
    table: PoseTable, times: Float[np.ndarray, " n"], max_gap_s: float, name: str = "the trajectory"
) -> tuple[PoseTable, list[str]]:
    """Poses by a clock that counts seconds, as images at `times` (s) show that theirs does not, and what to
    say of it.
    """
    ordered, known = np.sort(table.keys), {1.0: 0}
    for unit in CLOCK_UNITS if np.ptp(times) > 0 else ():
        at = np.searchsorted(ordered, times / unit)
        ends = ordered[np.clip([at - 1, at], 0, len(ordered) - 1)]
        # In too small a unit all poses are at the origin of time, where a few images may be.
        is_as_long = MIN_SPAN_SHARE < np.ptp(ordered) * unit / np.ptp(times) < 1 / MIN_SPAN_SHARE
        if unit == 1.0 or is_as_long:
            known[unit] = int((np.abs(ends * unit - times).min(axis=0) <= max_gap_s).sum())
    unit = max(known, key=lambda one: known[one])  # the first of equals
    if unit == 1.0:
        return table, []
    told = f"times of {name} are {clock_unit(unit)}, not seconds, as those of the images show"
    return replace(table, keys=table.keys * unit), [told]


def poses_of_frames(
    ids: Sequence[str],
    times: Float[np.ndarray, " n"],
    table: PoseTable,
    where: str,
    max_gap_s: float,
) -> tuple[Float[np.ndarray, "n 4 4"], Bool[np.ndarray, " n"]]:
    """A pose for each frame, by its time (s), number or row, and whether it is known.

    Raises:
        ScanError: rows are not as many as frames; it begins with `where`.
    """
    if table.kind == "tum":
        return poses_at(table.keys, table.poses, times, max_gap_s)
    n = len(ids)
    poses, known = np.tile(np.eye(4), (n, 1, 1)), np.zeros(n, dtype=bool)
    if table.kind == "kitti" and len(table.keys) == n:
        return table.poses, ~is_lost(table.poses)
    numbers = _frame_numbers(ids)
    if table.kind == "kitti" and (numbers is None or len(table.keys) <= numbers.max()):
        raise ScanError(
            f"{where} a row for each of {n} frames, found {len(table.keys)}; KITTI poses "
            "belong to frames by their row, use TUM poses with times instead"
        )
    if numbers is None or (table.kind == "log" and len(table.keys) == n):
        numbers = np.arange(n)
    row_of = {int(key): row for row, key in enumerate(table.keys)}
    for i, number in enumerate(numbers):
        if int(number) in row_of:
            poses[i] = table.poses[row_of[int(number)]]
            known[i] = not is_lost(poses[i])
    return poses, known


def _frame_numbers(ids: Sequence[str]) -> Int[np.ndarray, " n"] | None:
    """What frames are called, where all names are numbers."""
    # More digits than a 64-bit integer has are a name.
    if all(name.isdecimal() and len(name) < 19 for name in ids):
        return np.array([int(frame_id) for frame_id in ids])
    return None


def _numbers(rows: list[list[str]], path: Path) -> list[list[float]]:
    try:
        return [[float(word) for word in row] for row in rows]
    except ValueError as error:
        raise ScanError(
            f"{path}: expected numbers alone, or columns named in a first line (time,x,y,z,qx,qy,qz,qw; "
            f"angles as quaternions), found {shorten(error)}"
        ) from error
