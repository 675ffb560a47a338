"""From a `Recording` to a `Scan`: frames that can be used, and the one camera of each."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from planfit.errors import ScanError
from planfit.scan.images.lens import Lens, working_camera
from planfit.scan.poses import is_lost, name_lost_frames
from planfit.scan.recording import Frame, RecordedFiles, Recording, Size, View
from planfit.scan.types import Image, Scan, ScanOptions
from planfit.scan.views import MAX_CORRUPT_SHARE

MAX_ASPECT_DEFECT = 0.02
"""Colour and depth whose proportions differ by more do not show the same view."""

MAX_DISTORTION = 1e3
"""Coefficients of real lenses are below 100."""


@dataclass(frozen=True)
class UsableFrame:
    """A frame with a pose, whose images are there and begin and end as images do."""

    frame: Frame
    color_size: Size
    depth_size: Size


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
