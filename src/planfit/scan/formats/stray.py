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
from scipy.spatial.transform import Rotation

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.scan.axes import UP_Y
from planfit.scan.frames import Recording, make_camera, matrix_intrinsics, scan_from
from planfit.scan.images.image_files import ImageFiles, whole_image_size
from planfit.scan.images.lens import Lens
from planfit.scan.images.video import Video
from planfit.scan.layout import check_proportions, missing_confidence
from planfit.scan.options import ScanOptions
from planfit.scan.source import Source, fingerprint, read_text
from planfit.scan.tables import read_matrix, shorten
from planfit.scan.types import MAX_ENTRY, Scan

LOOKS_FOR = "rgb.mp4, odometry.csv and camera_matrix.csv"
VIDEO, POSES, CALIBRATION = "rgb.mp4", "odometry.csv", "camera_matrix.csv"
COLUMNS = ("timestamp", "frame", "x", "y", "z", "qx", "qy", "qz", "qw")
PARTS = (VIDEO, POSES, CALIBRATION, "depth/")


def recognise(source: Source) -> bool:
    """Whether a folder has this layout."""
    return source.exists(POSES) and source.exists(VIDEO)


@dataclass(frozen=True)
class StrayImages:
    """Colour out of the video, depth out of files."""

    video: Video
    numbers: tuple[int, ...]
    depths: ImageFiles

    def color(self, frame_idx: int) -> np.ndarray:
        """(h, w, 3) uint8, RGB."""
        return self.video.frame(self.numbers[frame_idx])

    def depth(self, frame_idx: int) -> np.ndarray:
        """(h, w) float32 m."""
        return self.depths.depth(frame_idx)


def read(source: Source, options: ScanOptions) -> Scan:
    """Read a scan.

    Raises:
        ScanError: its files are missing, unreadable, or contradict each other.
    """
    if not source.path.is_dir():
        raise ScanError(
            f"{source.path}: expected this layout in a folder; unpack the archive first"
        )
    header, rows = _read_rows(source)
    video = Video.open(source.path / VIDEO)
    matrix = read_matrix(source, CALIBRATION, "a 3x3 matrix of intrinsics", ",")
    shared = matrix_intrinsics(matrix, str(source.path / CALIBRATION))
    kept, skipped, depths = [], [], []
    depth_size = (0, 0)
    for row in rows:
        number = int(row[1])
        depth = next(
            (n for n in (f"depth/{number:06d}.png", f"depth/{number:06d}.npy") if source.exists(n)),
            "",
        )
        if number >= len(video):
            skipped.append(f"frame {number:06d}: the video ends after {len(video)} frames")
        elif not depth:
            skipped.append(f"frame {number:06d}: depth/{number:06d}.png is missing")
        else:
            size = depth_size if depth_size[0] else whole_image_size(source, depth)
            depth_size = size
            kept.append(row)
            depths.append(depth)
    last = max((int(row[1]) for row in rows), default=-1)
    skipped += [f"frame {n:06d}: {POSES} has no row" for n in range(last + 1, len(video))]
    values = np.array(kept).reshape(len(kept), len(header))
    turns = Rotation.from_quat(values[:, 5:9]).as_matrix() if kept else np.zeros((0, 3, 3))
    own = [header.index(name) for name in ("fx", "fy", "cx", "cy") if name in header]
    where = str(source.path / (POSES if len(own) == 4 else CALIBRATION))
    lenses = [
        Lens(
            make_camera(
                video.width, video.height, row[own].tolist() if len(own) == 4 else shared, where
            )
        )
        for row in values
    ]
    if kept:
        check_proportions((video.width, video.height), depth_size, str(source.path))
    names = [f"{int(row[1]):06d}" for row in values]
    confidences = [f"confidence/{name}.png" for name in names]
    files = ImageFiles(
        source,
        (),
        tuple(depths),
        options.depth_scale or 1e-3,
        tuple(name if source.exists(name) else "" for name in confidences),
        options.min_confidence,
    )

    def write_poses(directory: Path, frame_idx: np.ndarray, poses: np.ndarray) -> None:
        _write(directory / POSES, header, values[frame_idx], poses)

    tables = [VIDEO, POSES, CALIBRATION]
    recording = Recording(
        frame_ids=names,
        times=values[:, 0],
        world_from_cams=se3.make_transform(turns, values[:, 2:5]),
        images=StrayImages(video, tuple(int(n) for n in values[:, 1]), files),
        color_lenses=lenses,
        depth_lenses=[lens.scaled(*depth_size) for lens in lenses],
        write_poses=write_poses,
        fingerprint=fingerprint(source, [*tables, *depths], options),
        up_world=UP_Y,
        skipped=skipped,
        warnings=missing_confidence(source, confidences) if options.min_confidence else (),
    )
    return scan_from(source.path, "stray", recording, options)


def _read_rows(source: Source) -> tuple[list[str], list[list[float]]]:
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
        ok = (
            len(row) == len(header) and np.isfinite(row).all() and np.abs(row[2:]).max() < MAX_ENTRY
        )
        if not ok or np.abs(row[5:9]).max() < 1e-6 or row[1] < 0:
            raise ScanError(
                f"{source.path / POSES}, line {number}: expected {len(header)} finite numbers "
                f"({', '.join(header)}), found {shorten(line.strip())!r}"
            )
        rows.append(row)
    return header, rows


def _write(path: Path, header: Sequence[str], values: np.ndarray, poses: np.ndarray) -> None:
    quaternions = Rotation.from_matrix(poses[:, :3, :3]).as_quat(canonical=True)
    lines = [", ".join(header)]
    for row, pose, xyzw in zip(values, poses, quaternions, strict=True):
        words = [np.format_float_positional(row[0], trim="-"), f"{int(row[1]):06d}"]
        words += [f"{v:.9f}" for v in (*pose[:3, 3], *xyzw)] + [f"{v:.9g}" for v in row[9:]]
        lines.append(", ".join(words))
    path.write_text("\n".join(lines) + "\n")
