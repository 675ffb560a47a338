"""A posed RGB-D scan: how it is read, what every reader gives and every stage takes."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int, UInt8

from planfit.errors import OptionError, ScanError, require, require_choice, require_positive
from planfit.geometry import se3
from planfit.geometry.camera import Camera
from planfit.runtime import Changeable, require_kinds, short_html, short_repr
from planfit.scan.poses import check_pose

MAX_STEP_M = 20.0
"""Half of the steps between frames are shorter: nobody scans a building at strides of 20 m, but poses in
millimetres look like it."""


Image = Literal["", "colour", "depth"]


@dataclass(frozen=True)
class ScanOptions(Changeable):
    """Choices of the readers; most formats need none."""

    format: str = "auto"
    """Name of the format (`planfit help formats`); `auto` tells it by what lies in the folder."""
    use_masks: bool = True
    """Whether floor and wall masks that lie beside the images are used."""
    poses: Path | None = None
    """Poses of another tracker (TUM, KITTI, EuRoC or Open3D log), of the colour camera, that take the place
    of the scan's own; `planfit evaluate` judges them against the scan's own."""
    calibration: Path | None = None
    """Calibration of the depth camera, as `planfit calibrate` wrote it from another scan of the same device;
    what a run finds comes on top."""
    depth_scale: float | None = None
    """Metres of one unit of the stored depth; overrules what the format says."""
    max_time_gap_s: float = 0.02
    """Colour, depth and poses with times of their own belong together up to this difference."""
    min_confidence: int = 1
    """Depth of less confidence is left out, where the format has confidence: 0 low, 1 medium, 2 high."""
    image_size_px: int | None = None
    """Longer side of the images worked on; by default colour is shrunk to VGA or to the size of the depth,
    whichever is larger."""
    color_topic: str = ""
    """Topic of the colour images in a bag; by default the one whose name and type fit best. Of `any-folder`,
    their folder, where there are several cameras."""
    depth_topic: str = ""
    """Topic of the depth images in a bag; by default the one registered to colour, if there is one. Of
    `any-folder`, their folder."""
    intrinsics: str = ""
    """Lens of the colour camera, in place of the scan's own: a file (YAML of ROS or OpenCV, JSON, a camera of
    COLMAP, or fx fy cx cy); in a bag, also the topic of its CameraInfo."""
    pose_topic: str = ""
    """Topic of the poses in a bag; by default tf, else poses or odometry. Of `any-folder`, their file."""
    instant_s: float = 0.5
    """A laser scan is cut into frames of this length."""
    cloud_up: Literal["auto", "x", "y", "z", "-x", "-y", "-z"] = "auto"
    """Axis of a laser scan's cloud that is up; `auto`: z, unless the path is level along another."""
    cloud_time_offset_s: float | None = None
    """Seconds to add to the times of a laser scan's cloud for those of its trajectory; by default the one
    usual relation that fits (same clock, GPS week, GPS seconds, Unix time)."""

    def __post_init__(self) -> None:
        require_kinds(self)
        require_positive(self, "max_time_gap_s", "instant_s")
        require_choice(self, "cloud_up", "auto", "x", "y", "z", "-x", "-y", "-z")
        for name in ("depth_scale", "image_size_px"):
            if getattr(self, name) is not None:
                require_positive(self, name)
        require(
            self.min_confidence in (0, 1, 2),
            f"ScanOptions.min_confidence: expected 0, 1 or 2, found {self.min_confidence}",
        )
        if self.image_size_px is not None and self.image_size_px < 32:
            raise OptionError(
                f"ScanOptions.image_size_px: expected 32 or more, found {self.image_size_px}"
            )


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

    def color(self, frame_idx: int) -> UInt8[np.ndarray, "h w 3"] | None:
        """Colour image, RGB; None where the frame is depth alone."""
        ...

    def depth(self, frame_idx: int) -> Float[np.ndarray, "h w"]:
        """Depth, float32 m along the optical axis, NaN where nothing was measured."""
        ...

    def labels(self, frame_idx: int) -> UInt8[np.ndarray, "h w"]:
        """Label image of `Label`; only where `Scan.has_labels`."""
        ...

    def write_poses(
        self,
        directory: Path,
        world_from_cams: Float[np.ndarray, "n 4 4"],
        frame_idx: Int[np.ndarray, " n"] | None = None,
    ) -> None:
        """Write poses into an existing folder, in the format the scan came in.

        `frame_idx` tells the frames that they belong to; without it, all in order.
        """
        ...


class RoutedFiles(ABC):
    """The images of frames that are some other files' frames: each frame is looked up there."""

    @abstractmethod
    def route(self, frame_idx: int) -> tuple[ScanFiles, int]:
        """The files that a frame is of, and its number there."""

    def color(self, frame_idx: int) -> UInt8[np.ndarray, "h w 3"] | None:
        """Colour image, RGB; None where the frame is depth alone."""
        files, own_idx = self.route(frame_idx)
        return files.color(own_idx)

    def depth(self, frame_idx: int) -> Float[np.ndarray, "h w"]:
        """Depth, float32 m, NaN where nothing was measured."""
        files, own_idx = self.route(frame_idx)
        return files.depth(own_idx)

    def labels(self, frame_idx: int) -> UInt8[np.ndarray, "h w"]:
        """Label image of `Label`."""
        files, own_idx = self.route(frame_idx)
        return files.labels(own_idx)


@runtime_checkable
class CloudFiles(Protocol):
    """Files of a scan that came as one cloud, which can be written again."""

    def write_cloud(
        self,
        path: Path,
        target_from_cams: Float[np.ndarray, "n 4 4"],
        frame_idx: Int[np.ndarray, " n"],
        is_world: bool,
    ) -> None:
        """Write the whole cloud in its own format, each point moved with the frames of its time.

        Raises:
            ScanError: it came as no cloud.
        """
        ...


@dataclass(frozen=True)
class Scan:
    """Posed RGB-D frames, in the order they were recorded.

    Poses that are rotations up to rounding are made exact; others raise `ScanError`, as do arrays of
    another shape (so the types below leave the shapes of times and poses to the check).
    """

    name: str
    """Where it was read from, for messages."""
    frame_ids: tuple[str, ...]
    """What the format calls each frame."""
    timestamps: Float[np.ndarray, "..."]
    """(n,) s, or the frame number where the format has no time."""
    cameras: tuple[Camera, ...]
    """Intrinsics of each frame, shared by colour and depth."""
    world_from_cams: Float[np.ndarray, "..."]
    """(n, 4, 4) poses as recorded; OpenCV camera axes."""
    files: ScanFiles
    has_color: bool = True
    """Whether any frame has a colour image; without, `files.color` gives None for all."""
    lacking: tuple[Image, ...] = ()
    """The image that each frame lacks while others have it: those follow the recorded motion between their
    neighbours, or are matched by depth alone. Without, none lacks any."""
    has_labels: bool = False
    """Whether `files.labels` gives what each pixel shows."""
    up_world: Float[np.ndarray, "3"] | None = None
    """Unit vector against gravity, where the format knows it."""
    plan_from_world_axes: Float[np.ndarray, "4 4"] | None = None
    """Rotation between world and plan axes, for layouts that record poses in the plan's axes."""
    floorplan_path: Path | None = None
    """The plan that lies inside the layout, if there is one."""
    fingerprint: str = ""
    """Changes when any input file does (names, sizes, times); the cache is keyed by it.
    Without one, nothing about the scan is kept in a cache."""
    format: str = ""
    """Name of the format it was read from."""
    depth_read_in_m: float | None = None
    """Metres of a stored unit of depth that its format usually has, where neither files nor the user say
    which: depth may be in another. None: it is stated."""
    skipped: tuple[str, ...] = ()
    """Frames of the recording that are left out, and why, one line each."""
    warnings: tuple[str, ...] = ()
    """What to look at before trusting the scan."""

    __repr__ = short_repr
    _repr_html_ = short_html

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
        if len(self.lacking) != n:
            object.__setattr__(self, "lacking", ("",) * n)
        whole = np.array([not image for image in self.lacking])
        steps_m = np.linalg.norm(np.diff(self.world_from_cams[whole, :3, 3], axis=0), axis=1)
        if len(steps_m) and np.median(steps_m) > MAX_STEP_M:
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

    def _checked_poses(self) -> Float[np.ndarray, "n 4 4"]:
        poses = np.array(self.world_from_cams, dtype=float)
        for frame_id, pose in zip(self.frame_ids, poses, strict=True):
            check_pose(pose, f"{self.name}: frame {frame_id}")
        poses[:, :3, :3] = se3.project_to_so3(poses[:, :3, :3])
        poses[:, 3] = (0.0, 0.0, 0.0, 1.0)
        return poses
