"""Scans seen through something: corrupt frames left blank, a choice of frames, a sensor corrected, images
decoded once in a run, whose stages ask for depth four times and for colour twice."""

import hashlib
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass, field, replace
from io import FileIO
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
from jaxtyping import Float, Int, UInt8

from planfit.errors import ScanError
from planfit.geometry.calibration import SensorCalibration
from planfit.geometry.camera import Camera
from planfit.runtime import short_repr
from planfit.scan.types import CloudFiles, RoutedFiles, Scan, ScanFiles

MAX_CORRUPT_SHARE = 0.01
"""A file system or a transfer spoils single frames; where more than one in a hundred are corrupt, something
is wrong with the scan as a whole."""


def tolerate_corrupt_frames(scan: Scan) -> Scan:
    """The scan, a hundredth of whose frames may turn out to be corrupt when they are decoded."""
    max_corrupt = int(MAX_CORRUPT_SHARE * len(scan))
    return replace(scan, files=TolerantFiles(scan.files, scan.cameras, max_corrupt))


def corrupt_frames(scan: Scan) -> dict[str, str]:
    """Frames that could not be decoded since the scan was read, and why: by their ids, in order.

    Frames are decoded when a stage asks for them, so ask after the work.
    """
    found = {}
    for i, frame_id in enumerate(scan.frame_ids):
        files, own_idx = scan.files, i
        while isinstance(files, RoutedFiles) and not isinstance(files, TolerantFiles):
            files, own_idx = files.route(own_idx)
        if isinstance(files, TolerantFiles) and (why := files.reason(own_idx)):
            found[frame_id] = why
    return found


def select_frames(
    scan: Scan, frame_idx: Int[np.ndarray, " k"], world_from_cams: Float[np.ndarray, "k 4 4"]
) -> Scan:
    """Some frames of a scan, in this order, with poses of their own.

    The fingerprint tells which, so that nothing of the whole scan, or of others, is taken from the cache.
    """
    digest = hashlib.sha256(np.asarray(frame_idx, np.int64).tobytes()).hexdigest()[:16]
    return replace(
        scan,
        fingerprint=f"{scan.fingerprint}-{digest}" if scan.fingerprint else "",
        frame_ids=tuple(scan.frame_ids[i] for i in frame_idx),
        timestamps=scan.timestamps[frame_idx],
        lacking=tuple(scan.lacking[i] for i in frame_idx),
        cameras=tuple(scan.cameras[i] for i in frame_idx),
        world_from_cams=world_from_cams,
        files=SelectedFiles(scan.files, frame_idx),
    )


def calibrated_scan(scan: Scan, sensor: SensorCalibration) -> Scan:
    """The scan as its sensor should have measured it; the very same one where nothing is corrected.

    Points lifted from it are those of the scan, corrected: `sensor.points`. Corrections of a scan that is
    corrected already come on top. The fingerprint tells corrected scans apart, behind a dash as for other
    poses, so that nothing of one is taken from the other's cache.
    """
    if sensor.is_nominal:
        return scan
    digest = hashlib.sha256(repr(sensor.vector.tolist()).encode()).hexdigest()[:16]
    corrected = {camera: sensor.camera(camera) for camera in dict.fromkeys(scan.cameras)}
    return replace(
        scan,
        cameras=tuple(corrected[camera] for camera in scan.cameras),
        files=CalibratedFiles(scan.files, sensor),
        fingerprint=f"{scan.fingerprint}-{digest}" if scan.fingerprint else "",
    )


def write_cloud(
    scan: Scan, path: Path, target_from_cams: Float[np.ndarray, "n 4 4"], is_world: bool
) -> None:
    """Write the cloud that a laser scan came as, in its own format, moved with refined poses of its frames.

    Args:
        scan: as `read_scan` gave it, or seen through anything of this module.
        path: file to write.
        target_from_cams: poses of its frames.
        is_world: whether the target's axes are those of the scan.

    Raises:
        ScanError: it came as no cloud, or the cloud is damaged.
    """
    files, frame_idx = scan.files, np.arange(len(scan))
    while isinstance(files, FilesView):
        if isinstance(files, SelectedFiles):
            frame_idx = files.selected[frame_idx]
        files = files.files
    if not isinstance(files, CloudFiles):
        raise ScanError(f"{scan.name}: expected a laser scanner's cloud, found a scan of images")
    files.write_cloud(path, target_from_cams, frame_idx, is_world)


@dataclass(frozen=True)
class FilesView(RoutedFiles):
    """A scan's files as they are: what sees them through something changes what it has to."""

    files: ScanFiles

    def route(self, frame_idx: int) -> tuple[ScanFiles, int]:
        """The same frame."""
        return self.files, frame_idx

    def write_poses(
        self,
        directory: Path,
        world_from_cams: Float[np.ndarray, "n 4 4"],
        frame_idx: Int[np.ndarray, " n"] | None = None,
    ) -> None:
        """As the format has it."""
        self.files.write_poses(directory, world_from_cams, frame_idx)


@dataclass(frozen=True)
class CalibratedFiles(FilesView):
    """A scan's files, depth corrected when it is read; cameras are not theirs to correct."""

    sensor: SensorCalibration

    def depth(self, frame_idx: int) -> Float[np.ndarray, "h w"]:
        """Depth, float32 m, NaN where nothing was measured, or what was measured is behind the camera."""
        depth = self.sensor.depths(self.files.depth(frame_idx)).astype(np.float32, copy=False)
        return np.where(depth > 0, depth, np.float32(np.nan))


@dataclass(frozen=True)
class SelectedFiles(FilesView):
    """Some frames of a scan's files."""

    selected: Int[np.ndarray, " k"]

    def route(self, frame_idx: int) -> tuple[ScanFiles, int]:
        """The frame that was selected."""
        return self.files, int(self.selected[frame_idx])

    def write_poses(
        self,
        directory: Path,
        world_from_cams: Float[np.ndarray, "n 4 4"],
        frame_idx: Int[np.ndarray, " n"] | None = None,
    ) -> None:
        """As the format has it."""
        frames = self.selected if frame_idx is None else self.selected[frame_idx]
        self.files.write_poses(directory, world_from_cams, frames)


@dataclass(frozen=True)
class TolerantFiles(FilesView):
    """Images of which a few may be corrupt: such a frame is black, without depth and without labels.

    It then has no keypoints and no points, takes no part, and its pose moves with its neighbours. Up to
    `max_corrupt` frames are stood; the next one raises its own `ScanError`. Safe to use from several threads.
    """

    cameras: tuple[Camera, ...]
    max_corrupt: int
    _reasons: dict[int, str] = field(default_factory=dict, init=False, compare=False)
    _lock: Lock = field(default_factory=Lock, init=False, compare=False, repr=False)

    __repr__ = short_repr

    def color(self, frame_idx: int) -> UInt8[np.ndarray, "h w 3"] | None:
        """Colour image, RGB; None where the frame is depth alone."""
        return self._or_blank(self.files.color, frame_idx, np.zeros(3, dtype=np.uint8))

    def depth(self, frame_idx: int) -> Float[np.ndarray, "h w"]:
        """Depth, float32 m, NaN where nothing was measured."""
        return self._or_blank(self.files.depth, frame_idx, np.array(np.nan, dtype=np.float32))

    def labels(self, frame_idx: int) -> UInt8[np.ndarray, "h w"]:
        """Label image of `Label`."""
        return self._or_blank(self.files.labels, frame_idx, np.array(0, dtype=np.uint8))

    def reason(self, frame_idx: int) -> str:
        """Why a frame could not be decoded; empty where it was, or was not asked for so far."""
        with self._lock:
            return self._reasons.get(frame_idx, "")

    def _or_blank(self, read: Callable[[int], Any], frame_idx: int, blank: np.ndarray) -> Any:
        """What is read of a frame; an image of `blank` where it is corrupt, which is noted."""
        try:
            return read(frame_idx)
        except ScanError as error:
            with self._lock:
                self._reasons.setdefault(frame_idx, str(error))
                if len(self._reasons) > self.max_corrupt:
                    raise
        camera = self.cameras[frame_idx]
        return np.full((camera.height, camera.width, *blank.shape), blank)


MAX_KEPT_BYTES = 512 * 2**20
"""Temporary files may lie in memory. That is 240 frames of 640 x 480; of longer scans, others are decoded."""


@contextmanager
def decoded_once(scans: Sequence[Scan]) -> Iterator[list[Scan]]:
    """The scans, whose colour and depth are kept as they were decoded while the context lasts.

    After it they are decoded each time again, as are those beyond `MAX_KEPT_BYTES` or a full disk. They lie
    in a temporary file without a name, which goes with the process at the latest, whatever ends it.
    """
    with tempfile.TemporaryFile(buffering=0, prefix="planfit-") as file:
        kept = _Kept(file)
        try:
            yield [_seen(one, _KeptFiles(one.files, kept, k)) for k, one in enumerate(scans)]
        finally:
            kept.close()


def _seen(scan: Scan, files: ScanFiles) -> Scan:
    """The scan with other files; `replace` would make its poses exact once more, and move them by a bit."""
    seen = copy(scan)
    object.__setattr__(seen, "files", files)
    return seen


class _Kept:
    """Arrays in a file, by key. Safe to use from several threads."""

    def __init__(self, file: FileIO) -> None:
        self._file, self._lock = file, Lock()
        self._end, self._max_bytes = 0, MAX_KEPT_BYTES
        self._places: dict[tuple[object, ...], tuple[int, tuple[int, ...], np.dtype]] = {}

    def array(self, key: tuple[object, ...], decode: Callable[[int], Any], frame_idx: int) -> Any:
        """A new array of what is kept of a frame; else what `decode` gives, which is then kept."""
        with self._lock:
            if key in self._places:
                begin, shape, dtype = self._places[key]
                found = np.zeros(shape, dtype)
                self._file.seek(begin)
                self._file.readinto(found.data)
                return found
        found = decode(frame_idx)
        if found is not None:
            with self._lock:
                self._keep(key, found)
        return found

    def _keep(self, key: tuple[object, ...], array: np.ndarray) -> None:
        if key in self._places or self._end + array.nbytes > self._max_bytes:
            return
        try:
            self._file.seek(self._end)
            n_written = self._file.write(np.ascontiguousarray(array).data)
        except OSError:
            n_written = 0
        if n_written == array.nbytes:
            self._places[key] = (self._end, array.shape, array.dtype)
            self._end += array.nbytes
        else:  # a full disk
            self._max_bytes = 0

    def close(self) -> None:
        """Keep nothing any more."""
        with self._lock:
            self._places, self._max_bytes = {}, 0


@dataclass(frozen=True)
class _KeptFiles(FilesView):
    """A scan's files, decoded once."""

    kept: _Kept
    number: int
    """Of the scan."""

    def color(self, frame_idx: int) -> UInt8[np.ndarray, "h w 3"] | None:
        """Colour image, RGB; None where the frame is depth alone."""
        return self.kept.array((self.number, "color", frame_idx), self.files.color, frame_idx)

    def depth(self, frame_idx: int) -> Float[np.ndarray, "h w"]:
        """Depth, float32 m, NaN where nothing was measured."""
        return self.kept.array((self.number, "depth", frame_idx), self.files.depth, frame_idx)
