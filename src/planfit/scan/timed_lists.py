"""Images in lists with times, and a trajectory: colour, depth and poses of one moment belong together.

Clocks may count other units; where times are none of a clock at all, the lists are taken line by line.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from planfit.errors import ScanError
from planfit.scan.pose_files import PoseTable, in_seconds
from planfit.scan.poses import are_of_a_clock, contradicts_path, pair_times, poses_at
from planfit.scan.recording import Frame
from planfit.scan.source import FileSource
from planfit.scan.tables import read_rows, shorten, with_decimal_point


@dataclass(frozen=True)
class ImageList:
    """Images with their times, as listed."""

    file: str
    times: Float[np.ndarray, " n"]
    """s."""
    names: list[str]


@dataclass(frozen=True)
class TimedFrames:
    """Frames that have a pose."""

    frames: list[Frame]
    skipped: list[str]
    """Images that have none, one line each."""
    warnings: list[str]


def read_list(source: FileSource, file: str) -> ImageList:
    """A list of lines `time filename`.

    Raises:
        ScanError: lines are of another form.
    """
    return columns_of_list(source, file, read_rows(source, file, "lines `time filename`"))


def columns_of_list(
    source: FileSource, file: str, rows: Sequence[Sequence[str]], column: int = 0, more: str = ""
) -> ImageList:
    """A list out of rows that have been read: times in a column, names in the next.

    Raises:
        ScanError: lines are of another form than `time filename` and `more`.
    """
    try:
        times = np.array([float(with_decimal_point(row[column])) for row in rows])
        names = [row[column + 1] for row in rows]
        if not np.isfinite(times).all():
            raise ValueError(" ".join(rows[int(np.argmin(np.isfinite(times)))]))
    except (ValueError, IndexError) as error:
        raise ScanError(
            f"{source.path / file}: expected lines `time filename{more}`, found another ({shorten(error)})"
        ) from error
    return ImageList(file, times, names)


def frames_of_lists(
    path: Path,
    color: ImageList | None,
    depth: ImageList,
    table: PoseTable,
    table_name: str,
    max_gap_s: float,
    is_paired: bool = False,
) -> TimedFrames:
    """Colour, depth and poses whose times are no further apart than `max_gap_s`.

    Colour without depth is a frame, too, whose pose is recorded.

    Args:
        path: of the scan, for messages.
        color: without, frames are depth alone.
        depth: images of depth.
        table: poses with times.
        table_name: of its file.
        max_gap_s: largest difference.
        is_paired: whether colour and depth are of one moment, line by line.

    Raises:
        ScanError: no image has a pose.
    """
    leading, centres = color or depth, table.poses[:, :3, 3]
    table, told = in_seconds(table, leading.times, max_gap_s, table_name)
    if color is None or is_paired:
        mine, partner = (np.argsort(leading.times, kind="stable"),) * 2
    else:
        mine, partner = _by_time(color.times, depth.times, max_gap_s)
    listed = (leading, depth)
    agree = all(
        len(one.times) == len(table.keys) and np.abs(one.times - table.keys).max() <= max_gap_s
        for one in listed
    )
    if agree and not are_of_a_clock(table.keys, centres):
        n = len(table.keys)
        mine = partner = np.arange(n)
        times, poses, known = np.arange(float(n)), table.poses, np.ones(n, dtype=bool)
        told = [
            "times of the lists repeat or contradict the path, as durations or those of several clocks: "
            "frames are in the order of the lists, line by line, without times"
        ]
    else:
        if contradicts_path(table.keys, centres):
            told = [
                *told,
                f"times of {table_name} contradict the path, as of several clocks: check them",
            ]
        times = leading.times
        poses, known = poses_at(table.keys, table.poses, times[mine], max_gap_s)
    lacks_depth = bool((partner < 0).all())
    if lacks_depth or not known.any():
        what, other = ("depth", depth.times) if lacks_depth else ("poses", table.keys)
        images = "depth images" if color is None else "colour images"
        raise ScanError(
            f"{path}: expected {what} within {max_gap_s:g} s of {images} (times {times.min():.6f} to "
            f"{times.max():.6f}), found times {other.min():.6f} to {other.max():.6f}; are the lists of one "
            "recording? Else give --max-time-gap-s"
        )
    frames = [
        Frame(
            Path(leading.names[i]).stem,
            float(times[i]),
            pose,
            "" if color is None else color.names[i],
            depth.names[j] if j >= 0 else "",
        )
        for i, j, pose, ok in zip(mine, partner, poses, known, strict=True)
        if ok
    ]
    skipped = [f"frame {leading.names[i]}: no pose within {max_gap_s:g} s" for i in mine[~known]]
    return TimedFrames(frames, skipped, told)


def _by_time(
    times: Float[np.ndarray, " n"], depth_times: Float[np.ndarray, " m"], max_gap_s: float
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Images by time, and the depth of each; -1 where it has none."""
    order = np.argsort(times, kind="stable")
    mine, depth = pair_times(times, depth_times, max_gap_s)
    partner = np.full(len(times), -1)
    partner[mine] = depth
    return order, partner[order]
