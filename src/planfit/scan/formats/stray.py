"""Stray Scanner: LiDAR iPhones and iPads.

    SCAN/rgb.mp4                 colour, HEVC, 1920 x 1440
    SCAN/odometry.csv            timestamp, frame, x, y, z, qx, qy, qz, qw [, fx, fy, cx, cy]: world_from_cam,
                                 OpenCV camera axes, world y-up (ARKit's)
    SCAN/camera_matrix.csv       3x3, of the colour
    SCAN/depth/NNNNNN.png        256 x 192, 16-bit millimetres (or .npy, millimetres)
    SCAN/confidence/NNNNNN.png   0 low, 1 medium, 2 high

Rows of odometry.csv belong to frames of the video by the column `frame`, and so do depth and confidence.
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
from planfit.scan.options import ScanOptions
from planfit.scan.poses import MAX_ENTRY, UP_Y
from planfit.scan.recording import (
    Frame,
    LensOfFrame,
    Recording,
    Size,
    make_camera,
    matrix_intrinsics,
)
from planfit.scan.source import FileSource, read_text
from planfit.scan.tables import read_matrix, shorten

EXPECTS = "rgb.mp4, odometry.csv and camera_matrix.csv"
VIDEO, POSES, CALIBRATION = "rgb.mp4", "odometry.csv", "camera_matrix.csv"
COLUMNS = ("timestamp", "frame", "x", "y", "z", "qx", "qy", "qz", "qw")
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
    if not source.path.is_dir():
        raise ScanError(
            f"{source.path}: expected this layout in a folder; unpack the archive first"
        )
    header, rows = _read_rows(source)
    video = Video.open(source.path / VIDEO)
    names = [f"{int(row[1]):06d}" for row in rows]
    in_video = [int(row[1]) < len(video) for row in rows]
    frames = [
        _frame(source, row, name)
        for row, name, is_there in zip(rows, names, in_video, strict=True)
        if is_there
    ]
    skipped = [
        f"frame {name}: the video ends after {len(video)} frames"
        for name, is_there in zip(names, in_video, strict=True)
        if not is_there
    ]
    last = int(rows[:, 1].max()) if len(rows) else -1
    skipped += [f"frame {n:06d}: {POSES} has no row" for n in range(last + 1, len(video))]
    row_of = dict(zip(names, rows, strict=True))
    images = VideoImages(source, options.depth_scale or 1e-3, options.min_confidence, video=video)

    def write_poses(
        directory: Path, written: Sequence[Frame], poses: Float[np.ndarray, "k 4 4"]
    ) -> None:
        _write(directory / POSES, header, [row_of[f.frame_id] for f in written], poses)

    return Recording(
        format="stray",
        path=source.path,
        frames=frames,
        images=images,
        color_lens=_lens_of_frame(source, header, row_of),
        write_poses=write_poses,
        fingerprint=images.fingerprint([POSES, CALIBRATION], frames, options),
        up_world=UP_Y,
        skipped=skipped,
    )


def _frame(source: FileSource, row: Float[np.ndarray, " columns"], name: str) -> Frame:
    depths = (f"depth/{name}.png", f"depth/{name}.npy")
    pose = np.full((4, 4), np.nan)
    if np.isfinite(row[2:9]).all():
        pose = se3.make_transform(Rotation.from_quat(row[5:9]).as_matrix(), row[2:5])
    return Frame(
        frame_id=name,
        time=float(row[0]),
        world_from_cam=pose,
        color=VIDEO,
        depth=next((n for n in depths if source.exists(n)), depths[0]),
        confidence=f"confidence/{name}.png",
    )


def _lens_of_frame(
    source: FileSource, header: list[str], row_of: dict[str, Float[np.ndarray, " columns"]]
) -> LensOfFrame:
    """Intrinsics of its own row where the table has them, else those that all frames share."""
    matrix = read_matrix(source, CALIBRATION, "a 3x3 matrix of intrinsics", ",")
    shared = matrix_intrinsics(matrix, str(source.path / CALIBRATION))
    own = [header.index(name) for name in ("fx", "fy", "cx", "cy") if name in header]

    def lens(frame: Frame, size: Size) -> Lens:
        if len(own) == 4:
            numbers = row_of[frame.frame_id][own].tolist()
            return Lens(make_camera(*size, numbers, str(source.path / POSES)))
        return Lens(make_camera(*size, shared, str(source.path / CALIBRATION)))

    return lens


def _read_rows(source: FileSource) -> tuple[list[str], Float[np.ndarray, "n columns"]]:
    lines = [line for line in read_text(source, POSES).splitlines() if line.strip()]
    header = [word.strip() for word in lines[0].split(",")] if lines else []
    if tuple(header[: len(COLUMNS)]) != COLUMNS:
        raise ScanError(
            f"{source.path / POSES}: expected columns {', '.join(COLUMNS)}, found "
            f"{shorten(', '.join(header)) or 'an empty file'}"
        )
    rows = []
    for number, line in enumerate(lines[1:], start=2):
        try:
            row = [float(word) for word in line.split(",")]
        except ValueError:
            row = []
        is_whole = len(row) == len(header) and np.isfinite([*row[:2], *row[9:]]).all()
        if is_whole and (not np.isfinite(row[2:9]).all() or np.abs(row[5:9]).max() < 1e-6):
            row[2:9] = LOST
        largest = max((abs(v) for v in row[2:] if np.isfinite(v)), default=0.0)
        if not is_whole or row[1] < 0 or largest >= MAX_ENTRY:
            raise ScanError(
                f"{source.path / POSES}, line {number}: expected {len(header)} finite numbers "
                f"({', '.join(header)}), found {shorten(line.strip())!r}"
            )
        rows.append(row)
    return header, np.array(rows).reshape(len(rows), len(header))


def _write(
    path: Path,
    header: Sequence[str],
    rows: Sequence[Float[np.ndarray, " columns"]],
    poses: Float[np.ndarray, "k 4 4"],
) -> None:
    """odometry.csv of some rows with poses in place of their own; what follows the poses stays."""
    quaternions = Rotation.from_matrix(poses[:, :3, :3]).as_quat(canonical=True)
    lines = [", ".join(header)]
    for row, pose, xyzw in zip(rows, poses, quaternions, strict=True):
        words = [np.format_float_positional(row[0], trim="-"), f"{int(row[1]):06d}"]
        words += [f"{v:.9f}" for v in (*pose[:3, 3], *xyzw)] + [f"{v:.9g}" for v in row[9:]]
        lines.append(", ".join(words))
    path.write_text("\n".join(lines) + "\n")
