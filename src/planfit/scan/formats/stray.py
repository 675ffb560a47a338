"""Stray Scanner: LiDAR iPhones and iPads.

    SCAN/rgb.mp4                 colour, HEVC, 1920 x 1440
    SCAN/odometry.csv            timestamp, frame, x, y, z, qx, qy, qz, qw [, fx, fy, cx, cy
                                 [, distortion_center_x, distortion_center_y]]: world_from_cam, OpenCV camera
                                 axes, world y-up (ARKit's); cells may be empty
    SCAN/camera_matrix.csv       3x3, of the colour; the last frame's
    SCAN/depth/NNNNNN.png        256 x 192, 16-bit millimetres (or .npy, millimetres)
    SCAN/confidence/NNNNNN.png   0 low, 1 medium, 2 high

Rows of odometry.csv belong to frames of the video by the column `frame`, and so do depth and confidence. The
app counts the video's frames from -1, so that an edit list hides the first one: tools that follow the list
find the video a frame short, and each colour image one frame late. All frames of the file are read here.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8
from scipy.spatial.transform import Rotation

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan.images.files import ImageFiles, whole_image_size
from planfit.scan.images.lens import Lens
from planfit.scan.images.video import Video
from planfit.scan.intrinsics import make_camera, matrix_intrinsics
from planfit.scan.options import ScanOptions
from planfit.scan.poses import MAX_ENTRY, UP_Y
from planfit.scan.recording import Frame, LensOfFrame, Recording, Size
from planfit.scan.source import FileSource, read_text
from planfit.scan.tables import read_matrix, shorten

EXPECTS = "rgb.mp4, odometry.csv and camera_matrix.csv"
CHECKED = (
    "the app's docs/format.md, OdometryEncoder, VideoEncoder and DatasetEncoder "
    "(github.com/strayrobots/scanner and a fork of its current version); tables of two "
    "real recordings, of 9 and of 15 columns",
    "columns, empty cells, axes, units, the lens of each frame, which image of the video "
    "a row belongs to",
)
"""Where the layout is known from, and what was checked with it."""
VIDEO, POSES, CALIBRATION = "rgb.mp4", "odometry.csv", "camera_matrix.csv"
COLUMNS = ("timestamp", "frame", "x", "y", "z", "qx", "qy", "qz", "qw")
INTRINSICS = ("fx", "fy", "cx", "cy")
PARTS = (VIDEO, POSES, CALIBRATION, "depth/")
LOST = [float("nan")] * 7
"""In the place of position and quaternion where the tracker had none."""


def recognise(source: FileSource) -> bool:
    """Whether a folder has this layout."""
    return source.exists(POSES) and source.exists(VIDEO)


@dataclass(frozen=True, kw_only=True)
class VideoImages(ImageFiles):
    """Colour out of the video, by the number that is the frame's id; depth and confidence out of files."""

    video: Video

    def sizes(self, frame: Frame) -> tuple[Size, Size]:
        """Of the video, and of the depth from its header."""
        return (self.video.width, self.video.height), whole_image_size(self.source, frame.depth)

    def color(self, frame: Frame) -> UInt8[np.ndarray, "h w 3"]:
        """Colour image, RGB."""
        return self.video.frame(int(frame.frame_id))


def read(source: FileSource, options: ScanOptions) -> Recording:
    """List a scan.

    Raises:
        ScanError: its files are missing, unreadable, or contradict each other.
    """
    table = _read_table(source)
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
    scale = options.depth_scale or 1e-3
    images = VideoImages(source, scale, options.min_confidence, metres_per_float=scale, video=video)

    def write_poses(
        directory: Path, written: Sequence[Frame], poses: Float[np.ndarray, "k 4 4"]
    ) -> None:
        rows = [table.rows[frame.frame_id] for frame in written]
        _write(directory / POSES, table.header, rows, poses)

    return Recording(
        format="stray",
        path=source.path,
        frames=frames,
        images=images,
        color_lens=_lens_of_frame(source, table),
        write_poses=write_poses,
        fingerprint=images.fingerprint([POSES, CALIBRATION], frames, options),
        up_world=UP_Y,
        skipped=skipped,
    )


def _frame(source: FileSource, row: "_Row", name: str) -> Frame:
    depths = (f"depth/{name}.png", f"depth/{name}.npy")
    pose = np.full((4, 4), np.nan)
    if np.isfinite(row.pose).all():
        pose = se3.make_transform(
            Rotation.from_quat(row.pose[3:]).as_matrix(), np.array(row.pose[:3])
        )
    return Frame(
        frame_id=name,
        time=row.time,
        world_from_cam=pose,
        color=VIDEO,
        depth=next((n for n in depths if source.exists(n)), depths[0]),
        confidence=f"confidence/{name}.png",
    )


def _lens_of_frame(source: FileSource, table: "_Table") -> LensOfFrame:
    """Intrinsics of its own row where the table has them, else those that all frames share."""
    matrix = read_matrix(source, CALIBRATION, "a 3x3 matrix of intrinsics", ",")
    shared = matrix_intrinsics(matrix, str(source.path / CALIBRATION))

    def lens(frame: Frame, size: Size) -> Lens:
        own = table.intrinsics(frame.frame_id)
        if own is not None:
            return Lens(make_camera(*size, own, str(source.path / POSES)))
        return Lens(make_camera(*size, shared, str(source.path / CALIBRATION)))

    return lens


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

    def intrinsics(self, frame_id: str) -> list[float] | None:
        """fx fy cx cy of a frame; nothing where the table lacks a column or the row leaves one empty."""
        columns = [self.header.index(name) for name in INTRINSICS if name in self.header]
        words = self.rows[frame_id].words
        cells = [words[c] for c in columns if c < len(words) and words[c]]
        return [float(cell) for cell in cells] if len(cells) == len(INTRINSICS) else None


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
    if not np.isfinite(pose).all() or max(abs(v) for v in pose[3:]) < 1e-6:
        pose = LOST
    return _Row(values[0], int(values[1]), pose, words) if values[1] >= 0 else None


def _write(
    path: Path, header: Sequence[str], rows: Sequence[_Row], poses: Float[np.ndarray, "k 4 4"]
) -> None:
    """odometry.csv of some rows with poses in place of their own; all other cells stay as they came."""
    quaternions = Rotation.from_matrix(poses[:, :3, :3]).as_quat(canonical=True)
    lines = [", ".join(header)]
    for row, pose, xyzw in zip(rows, poses, quaternions, strict=True):
        refined = [f"{v:.9f}" for v in (*pose[:3, 3], *xyzw)]
        lines.append(", ".join([*row.words[:2], *refined, *row.words[9:]]))
    path.write_text("\n".join(lines) + "\n")
