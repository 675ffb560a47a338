"""From what a reader found to a `Scan`: usable frames, one camera a frame, images read when asked for.

A reader lists `Frame`s and gives a `Recording`; `scan_from_recording` makes the `Scan`, the images of which
are `RecordedFiles`. All formats take this way: image files, videos, bags and arrays differ in their
`StoredImages` alone.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
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
    working_camera,
)
from planfit.scan.poses import is_lost, name_lost_frames
from planfit.scan.types import Image, Scan, ScanOptions
from planfit.scan.views import MAX_CORRUPT_SHARE

Size = tuple[int, int]
"""(width, height) px."""

MAX_ASPECT_DEFECT = 0.02
"""Colour and depth whose proportions differ by more do not show the same view."""

MAX_DISTORTION = 1e3
"""Coefficients of real lenses are below 100."""


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
class UsableFrame:
    """A frame with a pose, whose images are there and begin and end as images do."""

    frame: Frame
    color_size: Size
    depth_size: Size


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


def scan_from_recording(recording: Recording, options: ScanOptions) -> Scan:
    """The scan of a recording; frames without a pose or any image are left out and named.

    Raises:
        ScanError: no frames are left, or their files contradict each other.
    """
    usable, skipped = _usable_frames(recording)
    ids = [frame.frame_id for frame in recording.frames]
    are_lost = [bool(is_lost(frame.world_from_cam)) for frame in recording.frames]
    lost = name_lost_frames(ids, are_lost, str(recording.path))
    if not usable:
        why = f" ({skipped[0]})" if skipped else ""
        raise ScanError(
            f"{recording.path}: expected frames with colour, depth and a pose, found none{why}; check that "
            "all three were exported"
        )
    frames = tuple(one.frame for one in usable)
    views = _views(recording, usable, options.image_size_px)
    return Scan(
        name=str(recording.path),
        frame_ids=tuple(frame.frame_id for frame in frames),
        timestamps=np.array([frame.time for frame in frames], dtype=float),
        cameras=tuple(view.camera for view in views),
        world_from_cams=np.stack([frame.world_from_cam for frame in frames]).astype(float),
        files=RecordedFiles(recording, frames, views),
        has_color=any(frame.color for frame in frames),
        lacking=tuple(frame.lacks for frame in frames),
        has_labels=recording.labels is not None,
        up_world=recording.up_world,
        plan_from_world_axes=recording.plan_from_world_axes,
        floorplan_path=recording.floorplan_path,
        fingerprint=recording.fingerprint,
        format=recording.format,
        depth_read_in_m=recording.depth_read_in_m,
        skipped=tuple(skipped),
        warnings=(*recording.warnings, *lost, *recording.images.warnings(frames), *_lacks(frames)),
    )


def _lacks(frames: Sequence[Frame]) -> list[str]:
    """What to say of frames that lack an image."""
    held: dict[Image, str] = {
        "colour": "are held by the recorded motion between their neighbours, or by depth alone",
        "depth": "are held by the recorded motion between their neighbours",
    }
    found = []
    for image, by in held.items():
        own = [frame for frame in frames if frame.lacks == image]
        if own:
            names = [frame.color if image == "colour" else frame.depth for frame in own[:3]]
            named = "; ".join(
                f"frame {frame.frame_id}{f': {name} is missing' if name else ''}"
                for frame, name in zip(own, names, strict=False)
            )
            named += f"; and {len(own) - 3} more" if len(own) > 3 else ""
            found.append(f"{len(own)} of {len(frames)} frames have no {image} and {by}: {named}")
    return found


def _usable_frames(recording: Recording) -> tuple[list[UsableFrame], list[str]]:
    """Frames that have a pose and an image, and a line for each that is left out.

    Of an image that one lacks the size is that of the others.
    Only headers and ends of files are looked at, so that long scans are listed in seconds.

    Raises:
        ScanError: sizes are mixed, or more than one frame in a hundred is corrupt.
    """
    lost = [frame for frame in recording.frames if is_lost(frame.world_from_cam)]
    posed = [frame for frame in recording.frames if not is_lost(frame.world_from_cam)]
    skipped = [*recording.skipped]
    skipped += [f"frame {frame.frame_id}: the tracker had no pose" for frame in lost]
    kept: list[UsableFrame] = []
    partial: list[tuple[int, UsableFrame]] = []  # and how many others stand before it
    errors: list[ScanError] = []
    first: dict[bool, UsableFrame] = {}  # with colour and without
    for frame in posed:
        missing = recording.images.missing(frame)
        lacks_depth = not frame.depth or frame.depth in missing
        lacks_color = frame.color in missing or frame.lacks == "colour"
        if lacks_depth and (lacks_color or not frame.color):
            skipped.append(f"frame {frame.frame_id}: {(*missing, 'an image')[0]} is missing")
            continue
        if lacks_depth or lacks_color:
            frame = replace(frame, lacks="depth" if lacks_depth else "colour")
        try:
            found = UsableFrame(frame, *recording.images.sizes(_with_images_there(frame)))
        except ScanError as error:
            errors.append(error)
            skipped.append(f"frame {frame.frame_id}: {error}")
            continue
        if frame.lacks:
            partial.append((len(kept), found))
            continue
        alike = first.setdefault(bool(frame.color), found)
        _check_sizes(recording.path, found, alike)
        kept.append(found)
    if len(errors) > MAX_CORRUPT_SHARE * len(posed):
        raise errors[0]
    if (whole := first.get(True)) is None:
        for frame in (one.frame for _, one in partial):
            name = frame.depth if frame.lacks == "depth" else frame.color
            skipped.append(f"frame {frame.frame_id}: {name or 'depth'} is missing")
        return kept, skipped
    for place, found in reversed(partial):
        size = found.frame.size
        if found.frame.lacks == "depth":
            filled = replace(found, depth_size=size or whole.depth_size)
        else:
            filled = replace(found, color_size=size or whole.color_size)
        _check_sizes(recording.path, filled, whole)
        kept.insert(place, filled)
    return kept, skipped


def _with_images_there(frame: Frame) -> Frame:
    """A frame that names no image which is not there."""
    if frame.lacks == "depth":
        return replace(frame, depth="")
    return replace(frame, color="") if frame.lacks == "colour" else frame


def _check_sizes(path: Path, found: UsableFrame, first: UsableFrame) -> None:
    """Raise `ScanError` unless images are as large as the format tells, or as the first such frame's."""
    frame = found.frame
    for kind, name, size, first_name, first_size in (
        ("colour", frame.color, found.color_size, first.frame.color, first.color_size),
        ("depth", frame.depth, found.depth_size, first.frame.depth, first.depth_size),
    ):
        if frame.size is not None and size != frame.size:
            raise _contradicts_intrinsics(path / name, frame.size, size)
        if frame.size is None and size != first_size:
            raise ScanError(
                f"{path / name}: expected {kind} of {first_size[0]} x {first_size[1]} px "
                f"as {first_name}, found {size[0]} x {size[1]}; "
                "all images of one camera must have one size"
            )


def _views(
    recording: Recording, usable: list[UsableFrame], size_px: int | None
) -> tuple[View, ...]:
    """One object where lenses are the same, so that a long scan holds few of them."""
    known: dict[tuple[Lens, Lens], View] = {}
    views = []
    for one in usable:
        color = recording.color_lens(one.frame, one.color_size)
        if recording.depth_lens is not None:
            depth = recording.depth_lens(one.frame, one.depth_size)
            color = depth if one.frame.is_depth_alone else color
        else:
            check_proportions(one.color_size, one.depth_size, str(recording.path))
            depth = color.scaled(*one.depth_size)
        if (color, depth) not in known:
            _check_lens(recording.path / one.frame.color, one.color_size, color)
            _check_lens(recording.path / one.frame.depth, one.depth_size, depth)
            known[color, depth] = View(color, depth, working_camera(color, depth, size_px))
        views.append(known[color, depth])
    return tuple(views)


def check_proportions(color_size: Size, depth_size: Size, name: str) -> None:
    """Raise `ScanError` unless colour and depth have the same proportions."""
    # The ratio of the two aspects, less one.
    defect = color_size[0] * depth_size[1] / (color_size[1] * depth_size[0]) - 1
    if abs(defect) > MAX_ASPECT_DEFECT:
        raise ScanError(
            f"{name}: expected depth that shows what the colour shows, found colour of "
            f"{color_size[0]} x {color_size[1]} px and depth of {depth_size[0]} x {depth_size[1]}; "
            "register depth to colour, or give the depth camera's intrinsics where the format has them"
        )


def _check_lens(image: Path, size: Size, lens: Lens) -> None:
    if not all(abs(v) < MAX_DISTORTION for v in lens.distortion):
        raise ScanError(
            f"{image}: expected finite distortion of its lens, found "
            f"{', '.join(f'{v:g}' for v in lens.distortion)}; export the calibration again"
        )
    expected = (lens.camera.width, lens.camera.height)
    if expected != size:
        raise _contradicts_intrinsics(image, expected, size)


def _contradicts_intrinsics(image: Path, expected: Size, found: Size) -> ScanError:
    return ScanError(
        f"{image}: expected {expected[0]} x {expected[1]} px as the intrinsics say, "
        f"found {found[0]} x {found[1]}; resample it or correct the intrinsics"
    )


def id_of_name(name: str) -> str:
    """What to call the frame of an image file by its name with folders: fit for the name of a file."""
    return str(PurePosixPath(name).with_suffix("")).replace("../", "").replace("/", "_")
