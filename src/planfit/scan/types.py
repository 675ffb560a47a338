"""A posed RGB-D scan: what every reader gives and every stage takes."""

from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from planfit.errors import ScanError
from planfit.geometry import se3
from planfit.geometry.camera import Camera
from planfit.scan.corrupt_frames import CorruptFrames

MAX_STEP_M = 20.0
"""Half of the steps between frames are shorter: nobody scans a building at strides of 20 m, but poses in
millimetres look like it."""

MAX_ENTRY = 1e9
"""Nothing is further from an origin, not even in millimetres around the Earth's axis."""

MAX_ROTATION_DEFECT = 0.02
"""Largest entry of R^T R - I that is taken for rounding. Recorded poses with four decimals are off
by 1e-4; a matrix that is off by more than this was not a rotation when it was written."""


class Label(IntEnum):
    """What a pixel shows, as far as the method cares."""

    NONE = 0
    FLOOR = 1
    WALL = 2
    CEILING = 3
    COLUMN = 4
    OTHER = 5


@runtime_checkable
class ScanFiles(Protocol):
    """The images behind a scan, read one frame at a time, and its own way of writing poses."""

    def color(self, frame_idx: int) -> np.ndarray:
        """Colour image (h, w, 3) uint8, RGB."""
        ...

    def depth(self, frame_idx: int) -> np.ndarray:
        """Depth (h, w) float32 m along the optical axis, NaN where there is no reading."""
        ...

    def labels(self, frame_idx: int) -> np.ndarray:
        """Label image (h, w) uint8 of `Label`; only where `Scan.has_labels`."""
        ...

    def write_poses(
        self, directory: Path, world_from_cams: np.ndarray, frame_idx: np.ndarray | None = None
    ) -> None:
        """Write poses (n, 4, 4) into an existing folder, in the format the scan came in.

        `frame_idx` (n,) tells the frames that they belong to; without it, all in order.
        """
        ...


@dataclass(frozen=True)
class Scan:
    """Posed RGB-D frames, in the order they were recorded.

    Poses that are rotations up to rounding are made exact; others raise `ScanError`.
    """

    name: str
    """Where it was read from, for messages."""
    frame_ids: tuple[str, ...]
    """What the format calls each frame."""
    timestamps: np.ndarray
    """(n,) s, or the frame number where the format has no time."""
    cameras: tuple[Camera, ...]
    """Intrinsics of each frame, shared by colour and depth."""
    world_from_cams: np.ndarray
    """(n, 4, 4) poses as recorded; OpenCV camera axes."""
    files: ScanFiles
    has_labels: bool = False
    """Whether `files.labels` gives what each pixel shows."""
    up_world: np.ndarray | None = None
    """(3,) unit vector against gravity, where the format knows it."""
    plan_from_world_axes: np.ndarray | None = None
    """(4, 4) turn between world and plan axes, for layouts that record poses in the plan's axes."""
    floorplan_path: Path | None = None
    """The plan that lies inside the layout, if there is one."""
    fingerprint: str = ""
    """Changes when any input file does (names, sizes, times); the cache is keyed by it.
    Without one, nothing about the scan is kept in a cache."""
    format: str = ""
    """Name of the format it was read from."""
    skipped: tuple[str, ...] = ()
    """Frames of the recording that are left out, and why, one line each."""
    warnings: tuple[str, ...] = ()
    """What to look at before trusting the scan."""
    damage: CorruptFrames | None = None
    """Frames that could not be decoded, noted as they are read."""

    def __post_init__(self) -> None:
        n = len(self.frame_ids)
        if n == 0:
            raise ScanError(f"{self.name}: expected posed frames, found none")
        if self.world_from_cams.shape != (n, 4, 4):
            raise ScanError(
                f"{self.name}: expected poses of shape ({n}, 4, 4), "
                f"found {self.world_from_cams.shape}"
            )
        object.__setattr__(self, "world_from_cams", self._checked_poses())
        steps_m = np.linalg.norm(np.diff(self.world_from_cams[:, :3, 3], axis=0), axis=1)
        if n > 1 and np.median(steps_m) > MAX_STEP_M:
            raise ScanError(
                f"{self.name}: expected poses in metres, found {np.median(steps_m):.4g} m between "
                "frames; divide translations by 1000 if they are millimetres"
            )
        if len(self.cameras) != n or len(self.timestamps) != n:
            raise ScanError(
                f"{self.name}: expected {n} cameras and timestamps, "
                f"found {len(self.cameras)} and {len(self.timestamps)}"
            )

        if not np.isfinite(self.timestamps).all():
            frame_id = self.frame_ids[int(np.argmin(np.isfinite(self.timestamps)))]
            raise ScanError(
                f"{self.name}: frame {frame_id}: expected a time, found NaN or infinity; "
                "remove the frame or export the scan again"
            )

    def __len__(self) -> int:
        return len(self.frame_ids)

    def _checked_poses(self) -> np.ndarray:
        poses = np.array(self.world_from_cams, dtype=float)
        for frame_id, pose in zip(self.frame_ids, poses, strict=True):
            check_pose(pose, f"{self.name}: frame {frame_id}")
        poses[:, :3, :3] = se3.project_to_so3(poses[:, :3, :3])
        poses[:, 3] = (0.0, 0.0, 0.0, 1.0)
        return poses


def check_pose(pose: np.ndarray, where: str) -> None:
    """Raise `ScanError`, beginning with `where`, unless `pose` is a rigid 4x4 transform up to rounding."""
    if pose.shape != (4, 4):
        raise ScanError(f"{where}: expected a 4x4 pose matrix, found shape {pose.shape}")
    if not (np.isfinite(pose).all() and np.abs(pose).max() < MAX_ENTRY):
        raise ScanError(
            f"{where}: expected finite numbers in the pose, found NaN, infinity or beyond "
            f"{MAX_ENTRY:g}; "
            "remove the frame or repair the tracker's output"
        )
    rotation = pose[:3, :3]
    defect = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
    if defect > MAX_ROTATION_DEFECT:
        raise ScanError(
            f"{where}: expected a rotation in the pose, found a matrix off by {defect:.3g} "
            f"(at most {MAX_ROTATION_DEFECT}); check for scaled or transposed poses"
        )
    if np.linalg.det(rotation) < 0:
        raise ScanError(
            f"{where}: expected a right-handed pose, found a mirrored one (determinant -1); "
            "check the axes that the poses were exported with"
        )
    if np.abs(pose[3] - (0, 0, 0, 1)).max() > 1e-6:
        raise ScanError(f"{where}: expected the last row 0 0 0 1, found {pose[3].tolist()}")
