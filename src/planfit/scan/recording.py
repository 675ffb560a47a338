"""What a reader finds: frames, one camera a frame, images read when asked for.

A reader lists `Frame`s and gives a `Recording`; `scan_from_recording` makes the `Scan`, the images of which
are `RecordedFiles`. All formats take this way: image files, videos, bags and arrays differ in their
`StoredImages` alone.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int, UInt8

from planfit.errors import ScanError
from planfit.geometry.camera import Camera
from planfit.runtime import short_repr
from planfit.scan.images.depth_registration import register_depth
from planfit.scan.images.lens import (
    Lens,
    make_camera,
    resample_color,
    resample_depth,
    resample_labels,
)
from planfit.scan.poses import write_tum
from planfit.scan.types import Image

Size = tuple[int, int]
"""(width, height) px."""


@dataclass(frozen=True)
class Frame:
    """One frame as a reader lists it, before anyone has looked whether its images are there."""

    frame_id: str
    time: float
    """s, or a number where the format has no time."""
    world_from_cam: Float[np.ndarray, "4 4"]
    """Of the colour camera, axes of OpenCV; NaN or infinity where the tracker was lost."""
    color: str
    """What its `StoredImages` know the colour image by: the name of a file, mostly. Empty, and not lacking:
    the frame is depth alone, and its pose and lens are those of the depth camera."""
    depth: str
    """Empty: there is none, and the frame goes with its neighbours."""
    confidence: str = ""
    """Of the depth; frames without use all of it."""
    size: Size | None = None
    """Of its colour and depth, as the format tells it for each frame; without, all must be of one size."""
    lacks: Image = ""
    """The image that others have and it has not: as a reader knows, or `scan_from_recording` finds."""

    @property
    def is_depth_alone(self) -> bool:
        """Whether the camera is that of depth."""
        return not self.color and self.lacks != "colour"


@runtime_checkable
class StoredImages(Protocol):
    """Images as they are stored, before lens and size are seen to. Safe to use from several threads."""

    def missing(self, frame: Frame) -> tuple[str, ...]:  # noqa: ARG002
        """Images that a frame names and are not there."""
        return ()

    def sizes(self, frame: Frame) -> tuple[Size, Size]:
        """Of colour and depth, without decoding them; of one that a frame does not name, that of the other.

        Raises:
            ScanError: one of them is no whole image.
        """
        ...

    def warnings(self, frames: Sequence[Frame]) -> list[str]:  # noqa: ARG002
        """What to look at before trusting the images of these frames."""
        return []

    def color(self, frame: Frame) -> UInt8[np.ndarray, "h w 3"]:
        """Colour image, RGB; not asked for where the frame has none.

        Raises:
            ScanError: it cannot be decoded.
        """
        ...

    def depth(self, frame: Frame) -> Float[np.ndarray, "h w"]:
        """float32 m along the optical axis; NaN where nothing was measured, or nothing to be trusted.

        Raises:
            ScanError: it cannot be decoded.
        """
        ...


CloudWriter = Callable[[Path, Sequence[Frame], Float[np.ndarray, "k 4 4"], bool], None]
"""Writes the whole cloud that a scan came as, moved with poses of frames (k), in world axes or in others."""

LensOfFrame = Callable[[Frame, Size], Lens]
"""Lens of a frame's image of a size."""


def pinhole_lens(intrinsics: object, where: str) -> LensOfFrame:
    """That of all frames, from what a file says of fx fy cx cy (see `make_camera`); `where` begins errors."""

    def lens(_: Frame, size: Size) -> Lens:
        return Lens(make_camera(*size, intrinsics, where))

    return lens


def write_trajectory(
    directory: Path, frames: Sequence[Frame], poses: Float[np.ndarray, "k 4 4"]
) -> None:
    """Write poses of frames as `trajectory.tum`: a `PoseWriter` for what has no form of its own."""
    write_tum(directory / "trajectory.tum", np.array([frame.time for frame in frames]), poses)


PoseWriter = Callable[[Path, Sequence[Frame], Float[np.ndarray, "k 4 4"]], None]
"""Writes poses of frames (k) into an existing folder, in the format's own way."""


@dataclass(frozen=True)
class Recording:
    """What a reader knows of its format, and what it found."""

    format: str
    path: Path
    """The folder or file that was read, for messages."""
    frames: Sequence[Frame]
    """In the order they were recorded."""
    images: StoredImages
    color_lens: LensOfFrame
    write_poses: PoseWriter
    fingerprint: str
    """Changes when any input file does; empty: nothing of the scan may be cached."""
    depth_lens: LensOfFrame | None = None
    """Without, depth shows what the colour shows, in another size."""
    color_from_depth: Float[np.ndarray, "4 4"] | None = None
    """Between the axes of two cameras that stand apart; needs `depth_lens`."""
    write_cloud: CloudWriter | None = None
    """Where the scan came as one cloud."""
    labels: Callable[[Frame], UInt8[np.ndarray, "h w"]] | None = None
    """What each pixel of a frame's colour image shows, as `Label`, where the format knows it."""
    up_world: Float[np.ndarray, "3"] | None = None
    """Unit vector against gravity, where the format guarantees it."""
    plan_from_world_axes: Float[np.ndarray, "4 4"] | None = None
    """Rotation between world and plan axes, where poses are recorded in the plan's axes."""
    floorplan_path: Path | None = None
    """The plan that lies beside the frames."""
    depth_read_in_m: float | None = None
    """See `Scan`."""
    skipped: Sequence[str] = ()
    """Frames that the reader left out because they lack something, one line each."""
    warnings: Sequence[str] = ()
    """What to look at before trusting the scan."""

    def __post_init__(self) -> None:
        if self.color_from_depth is not None and self.depth_lens is None:
            raise ValueError("a depth camera of its own needs a lens of its own")


@dataclass(frozen=True)
class View:
    """How a frame's stored images are brought to one pinhole camera."""

    color_lens: Lens
    depth_lens: Lens
    camera: Camera


@dataclass(frozen=True)
class RecordedFiles:
    """The images of a recording as each frame's pinhole camera sees them: the `ScanFiles` of all formats."""

    recording: Recording
    frames: tuple[Frame, ...]
    views: tuple[View, ...]

    __repr__ = short_repr

    def color(self, frame_idx: int) -> UInt8[np.ndarray, "h w 3"] | None:
        """Colour image, RGB; None where the frame is depth alone."""
        if not self.frames[frame_idx].color or self.frames[frame_idx].lacks == "colour":
            return None
        view = self.views[frame_idx]
        image = self.recording.images.color(self.frames[frame_idx])
        self._check_size(frame_idx, "colour", image, view.color_lens)
        return resample_color(image, view.color_lens, view.camera)

    def depth(self, frame_idx: int) -> Float[np.ndarray, "h w"]:
        """Depth, float32 m along the optical axis, NaN where nothing was measured."""
        view = self.views[frame_idx]
        if self.frames[frame_idx].lacks == "depth":
            return np.full((view.camera.height, view.camera.width), np.nan, dtype=np.float32)
        depth = self.recording.images.depth(self.frames[frame_idx])
        self._check_size(frame_idx, "depth", depth, view.depth_lens)
        color_from_depth = self.recording.color_from_depth
        if color_from_depth is None or self.frames[frame_idx].is_depth_alone:
            return resample_depth(depth, view.depth_lens, view.camera)
        pinhole = view.depth_lens.camera
        undistorted = resample_depth(depth, view.depth_lens, pinhole)
        return register_depth(undistorted, pinhole, color_from_depth, view.camera)

    def labels(self, frame_idx: int) -> UInt8[np.ndarray, "h w"]:
        """Label image of `Label`."""
        if self.recording.labels is None:
            raise ScanError(
                f"{self.recording.path}: expected labels for frame {frame_idx}, but this format has none; "
                "use --segmentation.back-end geometry"
            )
        view = self.views[frame_idx]
        labels = self.recording.labels(self.frames[frame_idx])
        self._check_size(frame_idx, "labels", labels, view.color_lens)
        return resample_labels(labels, view.color_lens, view.camera)

    def write_poses(
        self,
        directory: Path,
        world_from_cams: Float[np.ndarray, "k 4 4"],
        frame_idx: Int[np.ndarray, " k"] | None = None,
    ) -> None:
        """In the format's own way."""
        chosen = range(len(self.frames)) if frame_idx is None else frame_idx
        frames = [self.frames[i] for i in chosen]
        self.recording.write_poses(directory, frames, world_from_cams)

    def write_cloud(
        self,
        path: Path,
        target_from_cams: Float[np.ndarray, "k 4 4"],
        frame_idx: Int[np.ndarray, " k"],
        is_world: bool,
    ) -> None:
        """See `CloudFiles`."""
        if self.recording.write_cloud is None:
            raise ScanError(
                f"{self.recording.path}: expected a laser scanner's cloud, found a scan of images; export it "
                "as ply, mesh, or poses"
            )
        frames = [self.frames[i] for i in frame_idx]
        self.recording.write_cloud(path, frames, target_from_cams, is_world)

    def _check_size(self, frame_idx: int, kind: str, image: np.ndarray, lens: Lens) -> None:
        if image.shape[:2] != (lens.camera.height, lens.camera.width):
            raise ScanError(
                f"{self.recording.path}: expected {kind} of {lens.camera.width} x {lens.camera.height} px "
                f"in frame {frame_idx}, found {image.shape[1]} x {image.shape[0]}; "
                "all images of one camera must have one size"
            )


def id_of_name(name: str) -> str:
    """What to call the frame of an image file by its name with folders: fit for the name of a file."""
    return str(PurePosixPath(name).with_suffix("")).replace("../", "").replace("/", "_")
