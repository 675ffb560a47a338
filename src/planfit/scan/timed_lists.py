"""Images in lists with times, and a trajectory: colour, depth and poses of one moment belong together.

Clocks may count other units; where times are none of a clock at all, the lists are taken line by line.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from planfit.errors import ScanError
from planfit.scan.pose_files import NO_CLOCK, PoseTable, in_seconds
from planfit.scan.poses import are_of_a_clock, contradicts_path, join_times, poses_at
from planfit.scan.recording import Frame
from planfit.scan.source import FileSource
from planfit.scan.tables import read_rows, shorten, with_decimal_point
from planfit.scan.types import Image


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
        times = np.array([_seconds(with_decimal_point(row[column])) for row in rows])
        names = [row[column + 1] for row in rows]
        if not np.isfinite(times).all():
            raise ValueError(" ".join(rows[int(np.argmin(np.isfinite(times)))]))
    except (ValueError, IndexError) as error:
        raise ScanError(
            f"{source.path / file}: expected lines `time filename{more}`, found another ({shorten(error)})"
        ) from error
    return ImageList(file, times, names)


def _seconds(word: str) -> float:
    """A time, in s where it has as many digits as milli-, micro- or nanoseconds since 1970."""
    whole = word.partition(".")[0]
    of_1970 = whole.isdecimal() and len(whole) in (13, 16, 19)
    return float(word) / 10.0 ** (len(whole) - 10 if of_1970 else 0)


def image_lacked(color: int, depth: int) -> Image:
    """By the frame's images of two lists, -1 where it has none (`join_times`)."""
    return "colour" if color < 0 else "depth" if depth < 0 else ""


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

    Colour without depth is a frame, too, and depth without colour, where a pose is recorded.

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
    listed = (leading, depth)
    agree = all(
        len(one.times) == len(table.keys) and np.abs(one.times - table.keys).max() <= max_gap_s
        for one in listed
    )
    if agree and not are_of_a_clock(table.keys, centres):
        n = len(table.keys)
        mine = partner = np.arange(n)
        at, poses, known = np.arange(float(n)), table.poses, np.ones(n, dtype=bool)
        told = [NO_CLOCK.format("times of the lists")]
    else:
        if contradicts_path(table.keys, centres):
            told = [
                *told,
                f"times of {table_name} contradict the path, as of several clocks: check them",
            ]
        if color is None or is_paired:
            mine = partner = np.argsort(leading.times, kind="stable")
            at = leading.times[mine]
        else:
            mine, partner, at = join_times(color.times, depth.times, max_gap_s)
        poses, known = poses_at(table.keys, table.poses, at, max_gap_s)
    lacks_depth = not ((mine >= 0) & (partner >= 0)).any()
    if lacks_depth or not known.any():
        times = leading.times
        what, other = ("depth", depth.times) if lacks_depth else ("poses", table.keys)
        images = "depth images" if color is None else "colour images"
        raise ScanError(
            f"{path}: expected {what} within {max_gap_s:g} s of {images} (times {times.min():.6f} to "
            f"{times.max():.6f}), found times {other.min():.6f} to {other.max():.6f}; are the lists of one "
            "recording? Else give --max-time-gap-s"
        )
    frames, skipped = [], []
    for i, j, time, pose, ok in zip(mine, partner, at, poses, known, strict=True):
        colour = color.names[i] if color is not None and i >= 0 else ""
        own = depth.names[j] if j >= 0 else ""
        if not ok:
            skipped.append(f"frame {colour or own}: no pose within {max_gap_s:g} s")
            continue
        stem = Path(colour or own).stem
        frames.append(
            Frame(stem, float(time), pose, colour, own, lacks=image_lacked(int(i), int(j)))
        )
    return TimedFrames(frames, skipped, told)
