"""Frames of a video by number, decoded as they are asked for."""

import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from jaxtyping import Int, UInt8

from planfit.errors import ScanError


@dataclass(frozen=True)
class Video:
    """A video file and the times of its frames; safe to use from several threads.

    Each thread has a decoder of its own, which goes on where it was: frames asked for in order are
    decoded once. A jump goes back to the key frame before.
    """

    path: Path
    width: int
    height: int
    pts: Int[np.ndarray, " n"]
    """Presentation times in order; frame i is the one at pts[i]."""
    key_pts: Int[np.ndarray, " k"]
    """Of key frames, in order."""
    _threads: threading.local = field(default_factory=threading.local, repr=False)

    @staticmethod
    def open(path: Path) -> "Video":
        """List the frames of a video without decoding them.

        Raises:
            ScanError: PyAV is not installed, or the file is no whole video.
        """
        av = _pyav()
        try:
            with av.open(str(path)) as container:
                stream = container.streams.video[0]
                size = (stream.codec_context.width, stream.codec_context.height)
                found = [
                    (packet.pts, packet.is_keyframe)
                    for packet in container.demux(stream)
                    if packet.pts is not None
                ]
        except (av.FFmpegError, IndexError, OSError) as error:
            raise ScanError(
                f"{path}: expected a video, found a file that cannot be read as one ({error}); "
                "the recording may have been cut off, copy it again from the phone"
            ) from error
        pts = np.array(sorted(p for p, _ in found), dtype=np.int64)
        keys = np.array(sorted(p for p, is_key in found if is_key), dtype=np.int64)
        if len(pts) == 0:
            raise ScanError(f"{path}: expected frames in the video, found none; copy it again")
        return Video(path, *size, pts, keys)

    def __len__(self) -> int:
        return len(self.pts)

    def frame(self, number: int) -> UInt8[np.ndarray, "h w 3"]:
        """Colour image, RGB, as stored.

        Raises:
            ScanError: the video cannot be decoded there.
        """
        av = _pyav()
        state = self._threads.__dict__
        try:
            wanted = self.pts[number]
            last = state.get("last_pts")
            if last is not None and last == wanted:
                return state["image"]
            # The last key frame at or before it: decoding can only begin at one.
            key = self.key_pts[max(0, np.searchsorted(self.key_pts, wanted, side="right") - 1)]
            # Going on costs less than a jump unless a key frame lies between.
            if last is None or wanted < last or key > last:
                state["frames"] = self._decode_from(av, int(key), state)
            for image, pts in state["frames"]:
                state["last_pts"], state["image"] = pts, image
                if pts >= wanted:
                    break
            if state.get("last_pts") == wanted:
                return state["image"]
        except (av.FFmpegError, OSError) as error:
            state.clear()
            raise ScanError(
                f"{self.path}: frame {number} cannot be decoded ({error}); copy the video again"
            ) from error
        state.clear()
        raise ScanError(
            f"{self.path}: expected frame {number} of {len(self)}, but the video cannot be decoded "
            "there; copy it again"
        )

    def _decode_from(
        self, av: ModuleType, pts: int, state: dict[str, Any]
    ) -> Iterator[tuple[np.ndarray, int]]:
        """Frames from the key frame at `pts` on, in the order they are shown."""
        if "container" in state:
            state["container"].close()
        container = av.open(str(self.path))
        state.clear()
        state["container"] = container
        stream = container.streams.video[0]
        container.seek(pts, stream=stream)
        return (
            (frame.to_ndarray(format="rgb24"), frame.pts)
            for frame in container.decode(stream)
            if frame.pts is not None
        )


def _pyav() -> ModuleType:
    try:
        import av
    except ImportError as error:
        raise ScanError(
            "videos: expected the library PyAV, found none; install planfit[video]"
        ) from error
    return av
