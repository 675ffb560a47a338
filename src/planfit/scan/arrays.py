"""`scan_from_arrays`: a scan of images that are in memory, without files."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from planfit.errors import ScanError
from planfit.geometry.camera import Camera
from planfit.scan.depth_checks import checked_depth
from planfit.scan.images.decode import depth_from_metres
from planfit.scan.images.lens import Lens
from planfit.scan.recording import Frame, Recording, Size, StoredImages, write_trajectory
from planfit.scan.types import Label, Scan, ScanOptions
from planfit.scan.usable_frames import scan_from_recording

Images = Sequence[np.ndarray] | np.ndarray
"""One array a frame, or one array of all frames."""
Colors = Sequence[np.ndarray | None] | np.ndarray | None
"""The same of colour images, None for each frame that has none; None alone: no frame has one."""


def scan_from_arrays(
    colors: Colors,
    depths_m: Images,
    cameras: Camera | Sequence[Camera],
    world_from_cams: np.ndarray,
    *,
    timestamps_s: np.ndarray | None = None,
    labels: Images | None = None,
    up_world: np.ndarray | None = None,
    name: str = "arrays",
    options: ScanOptions | None = None,
) -> Scan:
    """A scan of n frames in memory, for `refine` and all else that takes a scan.

    The arrays are not copied; do not change them while the scan is in use. Such a scan has no fingerprint,
    so nothing of it is kept in a cache.

    Args:
        colors: (n, h, w, 3) uint8, RGB; None where there is no colour, or in a list for frames without.
        depths_m: (n, h', w') m along the optical axis, of any float type; NaN, 0 or infinity where nothing
            was measured. It shows what the colour shows, in its size or another.
        cameras: Intrinsics of the colour images (of the depth, where a frame has no colour): one camera for
            all, or one a frame. Without distortion.
        world_from_cams: (n, 4, 4) poses, OpenCV camera axes, in metres.
        timestamps_s: (n,) s; by default frames are numbered from 0.
        labels: (n, h, w) integers, what each pixel of the colour shows, as `Label`; without, labels come
            from depth.
        up_world: (3,) unit vector against gravity, where it is known; without, it is found from depth.
        name: What messages call the scan.
        options: Its `image_size_px` is the size worked on.

    Raises:
        ScanError: an array has another shape or type, or the frames cannot be used.
    """
    n = _count_poses(world_from_cams, name)
    each_camera = [cameras] * n if isinstance(cameras, Camera) else cameras
    times = np.arange(float(n)) if timestamps_s is None else np.asarray(timestamps_s, dtype=float)
    _check(each_camera, n, "cameras", "Camera", lambda camera: isinstance(camera, Camera), name)
    _check(times, n, "timestamps", "numbers, in s", np.isscalar, name)
    each_color: Images | Sequence[np.ndarray | None] = [None] * n if colors is None else colors
    _check_images(each_color, depths_m, labels, n, name)
    if up_world is not None and np.shape(up_world) != (3,):
        raise ScanError(f"{name}: expected up_world of shape (3,), found {_words(up_world)}")
    if up_world is not None and not 1e-9 < float(np.linalg.norm(up_world)) < np.inf:
        raise ScanError(f"{name}: expected up_world to be a direction, found {up_world}")

    def labels_of(frame: Frame) -> UInt8[np.ndarray, "h w"]:
        assert labels is not None
        return labels[int(frame.frame_id)].astype(np.uint8)

    poses = np.asarray(world_from_cams, dtype=float)
    named = ["" if color is None else f"colors[{i}]" for i, color in enumerate(each_color)]
    recording = Recording(
        format="arrays",
        path=Path(name),
        frames=[
            Frame(f"{i:06d}", float(times[i]), poses[i], named[i], f"depths_m[{i}]")
            for i in range(n)
        ],
        images=ArrayImages(each_color, depths_m),
        color_lens=lambda frame, _: Lens(each_camera[int(frame.frame_id)]),
        write_poses=write_trajectory,
        fingerprint="",
        labels=None if labels is None else labels_of,
        up_world=None if up_world is None else np.array(up_world) / np.linalg.norm(up_world),
        depth_read_in_m=1.0,
    )
    scan = scan_from_recording(recording, options or ScanOptions())
    return checked_depth(scan)


@dataclass(frozen=True)
class ArrayImages(StoredImages):
    """`StoredImages` that are arrays: the frame's id is its number."""

    colors: Images | Sequence[np.ndarray | None]
    depths_m: Images

    def sizes(self, frame: Frame) -> tuple[Size, Size]:
        """Of colour and depth."""
        i = int(frame.frame_id)
        depth = self.depths_m[i].shape
        color = self.colors[i]
        shape = depth if color is None else color.shape
        return (shape[1], shape[0]), (depth[1], depth[0])

    def color(self, frame: Frame) -> UInt8[np.ndarray, "h w 3"]:
        """Colour image, RGB."""
        color = self.colors[int(frame.frame_id)]
        assert color is not None  # not asked for where there is none
        return color.copy()

    def depth(self, frame: Frame) -> Float[np.ndarray, "h w"]:
        """float32 m, NaN where nothing was measured."""
        return depth_from_metres(self.depths_m[int(frame.frame_id)])


def _count_poses(world_from_cams: np.ndarray, name: str) -> int:
    shape = np.shape(world_from_cams)
    if len(shape) != 3 or shape[1:] != (4, 4):
        raise ScanError(
            f"{name}: expected poses of shape (n, 4, 4), found {_words(world_from_cams)}"
        )
    return shape[0]


def _check(
    items: Sequence[Any] | np.ndarray,
    n: int,
    what: str,
    expected: str,
    is_right: Callable[[Any], bool],
    name: str,
) -> None:
    """Raise `ScanError` unless there are n items, each of which is right."""
    # A list is not made an array of: that would copy every image, and fail where their sizes differ.
    if not isinstance(items, Sequence) and np.ndim(items) == 0:
        raise ScanError(f"{name}: expected {n} {what} ({expected}), found {_words(items)}")
    if len(items) != n:
        raise ScanError(f"{name}: expected {n} {what}, one a pose, found {len(items)}")
    for i, item in enumerate(items):
        if not is_right(item):
            raise ScanError(
                f"{name}: frame {i}: expected {what} as {expected}, found {_words(item)}"
            )


def _check_images(
    colors: Images | Sequence[np.ndarray | None],
    depths_m: Images,
    labels: Images | None,
    n: int,
    name: str,
) -> None:
    _check(colors, n, "colour images", "uint8 of shape (h, w, 3)", _is_color, name)
    _check(depths_m, n, "depth images", "floats of shape (h, w), in m", _is_depth, name)
    if labels is not None:
        expected = f"integers from 0 to {max(Label)}, of shape (h, w)"
        _check(labels, n, "label images", expected, _is_labels, name)
        for i, (label, color, depth) in enumerate(zip(labels, colors, depths_m, strict=True)):
            shape = (depth if color is None else color).shape[:2]
            if label.shape != shape:
                raise ScanError(
                    f"{name}: frame {i}: expected labels of shape {shape} as the colour, "
                    f"found {label.shape}"
                )


def _is_color(image: object) -> bool:
    if image is None:
        return True
    is_array = isinstance(image, np.ndarray)
    return is_array and image.dtype == np.uint8 and image.ndim == 3 and image.shape[2] == 3


def _is_depth(image: object) -> bool:
    return isinstance(image, np.ndarray) and image.dtype.kind == "f" and image.ndim == 2


def _is_labels(image: object) -> bool:
    if not isinstance(image, np.ndarray) or image.dtype.kind not in "iu" or image.ndim != 2:
        return False
    return image.size == 0 or bool(image.min() >= 0 and image.max() <= max(Label))


def _words(found: object) -> str:
    if not isinstance(found, np.ndarray):
        return type(found).__name__
    if found.ndim == 2 and found.dtype.kind in "iu" and found.size:
        return f"{found.dtype} {found.shape}, {found.min()} to {found.max()}"
    return f"{found.dtype} {found.shape}"
