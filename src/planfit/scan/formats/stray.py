"""Stray Scanner: a table whose rows belong to frames of a video."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan.images.lens import Lens, make_camera
from planfit.scan.images.video import Video, can_decode, stored_size
from planfit.scan.layout import FolderLayout, Listing, Refined
from planfit.scan.pairing import SharedLens
from planfit.scan.poses import MAX_ENTRY, ROUNDING, UP_Y
from planfit.scan.recording import Frame, LensOfFrame, Size
from planfit.scan.source import FileSource, read_text
from planfit.scan.tables import first_of, shorten
from planfit.scan.types import ScanOptions

VIDEO, POSES = "rgb.mp4", "odometry.csv"
CALIBRATION = SharedLens("camera_matrix.csv", separator=",")
COLUMNS = ("timestamp", "frame", "x", "y", "z", "qx", "qy", "qz", "qw")
INTRINSICS = ("fx", "fy", "cx", "cy")
WITHOUT_COLOUR = (
    f"{VIDEO} was not read, which takes the library PyAV: depth alone is used, by which places are found "
    "again less surely; pip install 'planfit[video]' brings it"
)


@dataclass(frozen=True)
class _Row:
    """One row of odometry.csv."""

    time: float
    number: int
    pose: list[float]
    """x y z qx qy qz qw; NaN where the tracker was lost."""
    words: list[str]
    """All cells as written, so that what is not the pose goes back as it came."""


@dataclass(frozen=True)
class _Table:
    """odometry.csv."""

    header: list[str]
    rows: dict[str, _Row]
    """By the frame's id."""
    size_without_video: Size | None = None
    """Of the colour that the lenses are of, where it is not decoded."""

    def intrinsics(self, frame_id: str) -> list[float] | None:
        """fx fy cx cy of a frame; nothing where the table lacks a column or the row leaves one empty."""
        columns = [self.header.index(name) for name in INTRINSICS if name in self.header]
        words = self.rows[frame_id].words
        cells = [words[c] for c in columns if c < len(words) and words[c]]
        return [float(cell) for cell in cells] if len(cells) == len(INTRINSICS) else None


def _frames(source: FileSource, options: ScanOptions) -> Listing[_Table]:  # noqa: ARG001
    table = _read_table(source)
    tables = [POSES, CALIBRATION.name]
    if not can_decode():
        table = replace(table, size_without_video=stored_size(source.on_disk(VIDEO)))
        frames = [_frame(source, row, name, color="") for name, row in table.rows.items()]
        return Listing(source, frames, table, tables, warnings=[WITHOUT_COLOUR])
    video = Video.open(source.path / VIDEO, source.on_disk(VIDEO))
    listed = table.rows.items()
    frames = [_frame(source, row, name) for name, row in listed if row.number < len(video)]
    skipped = [
        f"frame {name}: the video ends after {len(video)} frames"
        for name, row in listed
        if row.number >= len(video)
    ]
    last = max((row.number for row in table.rows.values()), default=-1)
    skipped += [f"frame {n:06d}: {POSES} has no row" for n in range(last + 1, len(video))]
    return Listing(source, frames, table, tables, skipped, video=video)


def _frame(source: FileSource, row: _Row, name: str, color: str = VIDEO) -> Frame:
    pose = np.full((4, 4), np.nan)
    if np.isfinite(row.pose).all():
        pose = se3.make_transform(
            Rotation.from_quat(row.pose[3:]).as_matrix(), np.array(row.pose[:3])
        )
    return Frame(
        frame_id=name,
        time=row.time,
        world_from_cam=pose,
        color=color,
        depth=first_of(source, [f"depth/{name}.png", f"depth/{name}.npy"]),
        confidence=f"confidence/{name}.png",
    )


def _lens(listing: Listing[_Table]) -> LensOfFrame:
    """Intrinsics of its own row where the table has them, else those that all frames share."""
    shared = CALIBRATION(listing)

    def lens(frame: Frame, size: Size) -> Lens:
        of_color = listing.content.size_without_video or size
        own = listing.content.intrinsics(frame.frame_id)
        found = shared(frame, of_color)
        if own is not None:
            found = Lens(make_camera(*of_color, own, str(listing.source.path / POSES)))
        return found.scaled(*size)

    return lens


def _read_table(source: FileSource) -> _Table:
    lines = [line for line in read_text(source, POSES).splitlines() if line.strip()]
    header = [word.strip() for word in lines[0].split(",")] if lines else []
    if tuple(header[: len(COLUMNS)]) != COLUMNS:
        raise ScanError(
            f"{source.path / POSES}: expected columns {', '.join(COLUMNS)}, found "
            f"{shorten(', '.join(header)) or 'an empty file'}"
        )
    rows = {}
    for number, line in enumerate(lines[1:], start=2):
        row = _parse_row(line, len(header))
        if row is None:
            raise ScanError(
                f"{source.path / POSES}, line {number}: expected {len(header)} finite numbers "
                f"({', '.join(header)}), found {shorten(line.strip())!r}"
            )
        rows[f"{row.number:06d}"] = row
    return _Table(header, rows)


def _parse_row(line: str, n_columns: int) -> _Row | None:
    """A row; None where it is none. Empty cells are missing values: only time and number must be there."""
    words = [word.strip() for word in line.split(",")]
    try:
        values = [float(word) if word else np.nan for word in words]
    except ValueError:
        return None
    is_known = [np.isfinite(v) or not word for v, word in zip(values, words, strict=True)]
    if len(words) != n_columns or not all(is_known[9:]) or not np.isfinite(values[:2]).all():
        return None
    if max((abs(v) for v in values[2:] if np.isfinite(v)), default=0.0) >= MAX_ENTRY:
        return None
    pose = values[2:9]
    if not np.isfinite(pose).all() or max(abs(v) for v in pose[3:]) < ROUNDING:
        pose = [np.nan] * 7
    return _Row(values[0], int(values[1]), pose, words) if values[1] >= 0 else None


def _write(refined: Refined[_Table]) -> None:
    """odometry.csv of some rows with poses in place of their own; all other cells stay as they came."""
    table = refined.content
    quaternions = Rotation.from_matrix(refined.poses[:, :3, :3]).as_quat(canonical=True)
    lines = [", ".join(table.header)]
    for frame, pose, xyzw in zip(refined.frames, refined.poses, quaternions, strict=True):
        words = table.rows[frame.frame_id].words
        cells = [f"{v:.9f}" for v in (*pose[:3, 3], *xyzw)]
        lines.append(", ".join([*words[:2], *cells, *words[9:]]))
    (refined.directory / POSES).write_text("\n".join(lines) + "\n")


STRAY = FolderLayout(
    name="stray",
    page="""Stray Scanner: LiDAR iPhones and iPads.

    SCAN/rgb.mp4                 colour, HEVC, 1920 x 1440; pip install 'planfit[video]' reads it, and without
                                 it the scan is depth alone, with a warning
    SCAN/odometry.csv            timestamp, frame, x, y, z, qx, qy, qz, qw [, fx, fy, cx, cy
                                 [, distortion_center_x, distortion_center_y]]: world_from_cam, OpenCV camera
                                 axes, world y-up (ARKit's); cells may be empty
    SCAN/camera_matrix.csv       3x3, of the colour; the last frame's
    SCAN/depth/NNNNNN.png        256 x 192, 16-bit millimetres (or .npy, millimetres)
    SCAN/confidence/NNNNNN.png   0 low, 1 medium, 2 high

Rows of odometry.csv belong to frames of the video by the column `frame`, and so do depth and confidence. The
app counts the video's frames from -1, so that an edit list hides the first one: tools that follow the list
find the video a frame short, and each colour image one frame late. All frames of the file are read here.
""",
    expects="rgb.mp4, odometry.csv and camera_matrix.csv",
    checked=(
        "the app's docs/format.md, OdometryEncoder, VideoEncoder and DatasetEncoder "
        "(github.com/strayrobots/scanner and a fork of its current version); tables of two "
        "real recordings, of 9 and of 15 columns",
        "columns, empty cells, axes, units, the lens of each frame, which image of the video "
        "a row belongs to",
    ),
    told_by=(POSES, VIDEO),
    parts=(VIDEO, POSES, CALIBRATION.name, "depth/"),
    frames=_frames,
    metres_per_float=1e-3,
    lens=_lens,
    write=_write,
    up_world=UP_Y,
)
