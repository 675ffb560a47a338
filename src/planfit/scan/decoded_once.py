"""Scans whose images are decoded once in a run: its stages ask for depth four times, for colour twice."""

import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass
from io import FileIO
from threading import Lock
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from planfit.scan.types import Scan, ScanFiles
from planfit.scan.views import FilesView

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
