"""From what a format's reader found to a `Scan`: usable frames, one camera a frame, lazily read images."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from planfit.errors import ScanError
from planfit.geometry.camera import Camera
from planfit.scan.images.depth_registration import register_depth
from planfit.scan.images.lens import Lens, resample_color, resample_depth, working_camera
from planfit.scan.options import ScanOptions
from planfit.scan.types import Scan

PoseWriter = Callable[[Path, np.ndarray, np.ndarray], None]
"""Writes poses (k, 4, 4) of frames (k,) int into an existing folder, in the format's own way."""


@runtime_checkable
class StoredImages(Protocol):
    """Images as they are stored, before lens and size are seen to. Safe to use from several threads."""

    def color(self, frame_idx: int) -> np.ndarray:
        """(h, w, 3) uint8, RGB."""
        ...

    def depth(self, frame_idx: int) -> np.ndarray:
        """(h, w) float32 m along the optical axis; NaN where there is no reading or no trust in it."""
        ...


MAX_SIZE_PX = 100_000


@dataclass(frozen=True)
class Recording:
    """Frames that have colour, depth and a pose, in the order they were recorded."""

    frame_ids: Sequence[str]
    times: np.ndarray
    """(n,) s, or numbers."""
    world_from_cams: np.ndarray
    """(n, 4, 4) of the colour camera, axes of OpenCV."""
    images: StoredImages
    color_lenses: Sequence[Lens]
    depth_lenses: Sequence[Lens]
    write_poses: PoseWriter
    fingerprint: str
    up_world: np.ndarray | None = None
    skipped: Sequence[str] = field(default_factory=tuple)
    """Frames that lack something, one line each."""
    warnings: Sequence[str] = field(default_factory=tuple)
    color_from_depth: np.ndarray | None = None
    """(4, 4) between the two cameras' axes; without, depth was stored as the colour camera sees it."""


@dataclass(frozen=True)
class FrameFiles:
    """Stored images as the frame's pinhole camera sees them."""

    images: StoredImages
    color_lenses: tuple[Lens, ...]
    depth_lenses: tuple[Lens, ...]
    cameras: tuple[Camera, ...]
    pose_writer: PoseWriter
    name: str
    color_from_depth: np.ndarray | None = None

    def color(self, frame_idx: int) -> np.ndarray:
        """Colour image (h, w, 3) uint8, RGB."""
        lens = self.color_lenses[frame_idx]
        image = self.images.color(frame_idx)
        self._check_size(frame_idx, "colour", image, lens)
        return resample_color(image, lens, self.cameras[frame_idx])

    def depth(self, frame_idx: int) -> np.ndarray:
        """Depth (h, w) float32 m, NaN where there is no reading."""
        lens = self.depth_lenses[frame_idx]
        depth = self.images.depth(frame_idx)
        self._check_size(frame_idx, "depth", depth, lens)
        camera = self.cameras[frame_idx]
        if self.color_from_depth is None:
            return resample_depth(depth, lens, camera)
        straight = resample_depth(depth, lens, lens.camera)
        return register_depth(straight, lens.camera, self.color_from_depth, camera)

    def labels(self, frame_idx: int) -> np.ndarray:
        """These formats have no labels."""
        raise ScanError(
            f"{self.name}: expected labels for frame {frame_idx}, but this format has none; "
            "use --segmentation.back-end geometry"
        )

    def write_poses(
        self, directory: Path, world_from_cams: np.ndarray, frame_idx: np.ndarray | None = None
    ) -> None:
        """As the format has it."""
        frames = np.arange(len(self.cameras)) if frame_idx is None else frame_idx
        self.pose_writer(directory, frames, world_from_cams)

    def _check_size(self, frame_idx: int, kind: str, image: np.ndarray, lens: Lens) -> None:
        if image.shape[:2] != (lens.camera.height, lens.camera.width):
            raise ScanError(
                f"{self.name}: expected {kind} of {lens.camera.width} x {lens.camera.height} px in "
                f"frame {frame_idx}, found {image.shape[1]} x {image.shape[0]}; "
                "all images of one camera must have one size"
            )


def scan_from(name: Path, kind: str, recording: Recording, options: ScanOptions) -> Scan:
    """The scan of a recording.

    Raises:
        ScanError: it has no frames, or they cannot be used.
    """
    if not recording.frame_ids:
        why = f" ({recording.skipped[0]})" if recording.skipped else ""
        raise ScanError(
            f"{name}: expected frames with colour, depth and a pose, found none{why}; check that all "
            "three were exported"
        )
    cameras = _working_cameras(recording, options.image_size_px)
    files = FrameFiles(
        recording.images,
        tuple(recording.color_lenses),
        tuple(recording.depth_lenses),
        cameras,
        recording.write_poses,
        str(name),
        recording.color_from_depth,
    )
    return Scan(
        name=str(name),
        frame_ids=tuple(recording.frame_ids),
        timestamps=np.asarray(recording.times, dtype=float),
        cameras=cameras,
        world_from_cams=np.asarray(recording.world_from_cams, dtype=float),
        files=files,
        up_world=recording.up_world,
        fingerprint=recording.fingerprint,
        format=kind,
        skipped=tuple(recording.skipped),
        warnings=tuple(recording.warnings),
    )


def _working_cameras(recording: Recording, size_px: int | None) -> tuple[Camera, ...]:
    """One camera object where lenses are the same, so that a long scan holds few of them."""
    known: dict[tuple[Lens, Lens], Camera] = {}
    cameras = []
    for pair in zip(recording.color_lenses, recording.depth_lenses, strict=True):
        if pair not in known:
            known[pair] = working_camera(*pair, size_px)
        cameras.append(known[pair])
    return tuple(cameras)


def make_camera(width: float, height: float, intrinsics: Sequence[float], where: str) -> Camera:
    """Camera from fx fy cx cy, integer pixels being pixel centres.

    Raises:
        ScanError: they cannot be those of a camera; it begins with `where`.
    """
    try:
        fx, fy, cx, cy = (float(v) for v in intrinsics)
        if max(width, height) > MAX_SIZE_PX:
            raise ValueError(f"width and height must be at most {MAX_SIZE_PX}")
        return Camera(int(width), int(height), fx, fy, cx, cy)
    except (ValueError, TypeError, OverflowError) as error:
        raise ScanError(
            f"{where}: expected usable intrinsics (width height fx fy cx cy), {error}; "
            "export the calibration again"
        ) from error


def matrix_intrinsics(matrix: np.ndarray, where: str) -> tuple[float, float, float, float]:
    """fx fy cx cy of a calibration matrix (3, 3) or (4, 4).

    Raises:
        ScanError: it is no such matrix.
    """
    if matrix.shape not in ((3, 3), (4, 4)):
        raise ScanError(f"{where}: expected a 3x3 matrix of intrinsics, found shape {matrix.shape}")
    return (
        float(matrix[0, 0]),
        float(matrix[1, 1]),
        float(matrix[0, 2]),
        float(matrix[1, 2]),
    )
