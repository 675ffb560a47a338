"""Frames of a video by number, decoded as they are asked for."""

import re
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
from jaxtyping import Int, UInt8

from planfit.errors import ScanError
from planfit.scan.images.files import ImageFiles, whole_image_size
from planfit.scan.recording import Frame, Size

_CONTAINERS = "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm"
"""By FFmpeg's names. It tells files by what they hold, and among others knows lists of files to open."""
OPENING: dict[str, Any] = {
    "options": {"ignore_editlist": "1", "format_whitelist": _CONTAINERS},
    "metadata_errors": "replace",
}
"""Phones write edit lists: Stray Scanner counts the first frame as -1, before the session's start, which the
list then hides. Players show one frame less than was recorded, and every frame that is shown is then taken
for the one before it. What a video says of itself is not read, and may be in any letters."""


@dataclass(frozen=True)
class Video:
    """A video file and the times of its frames; safe to use from several threads.

    Each thread has a decoder of its own, which goes on where it was: frames asked for in order are
    decoded once. A jump goes back to the key frame before.
    """

    path: Path
    """What messages call it."""
    width: int
    height: int
    pts: Int[np.ndarray, " n"]
    """Presentation times in order; frame i is the one at pts[i]."""
    key_pts: Int[np.ndarray, " k"]
    """Of key frames, in order."""
    key_dts: Int[np.ndarray, " k"]
    """When these are decoded, which is what a file is searched by: where frames are shown in another order
    than they are stored, before they are shown."""
    file: Path
    """Where it lies on this disk: another place than `path` where that is inside an archive."""
    _threads: threading.local = field(default_factory=threading.local, repr=False)

    @staticmethod
    def open(path: Path, file: Path | None = None) -> "Video":
        """List the frames of a video without decoding them, those that an edit list hides too.

        `path`: the file; `file`: where its content lies, for a `path` inside an archive, which messages then
        name.

        Raises:
            ScanError: PyAV is not installed, or the file is no whole video.
        """
        av = _pyav()
        try:
            with av.open(str(file or path), **OPENING) as container:
                stream = container.streams.video[0]
                size = (stream.codec_context.width, stream.codec_context.height)
                found = [
                    (
                        packet.pts,
                        packet.pts if packet.dts is None else packet.dts,
                        packet.is_keyframe,
                    )
                    for packet in container.demux(stream)
                    if packet.pts is not None
                ]
        except (av.FFmpegError, IndexError, OSError) as error:
            raise ScanError(
                f"{path}: expected a video, found a file that cannot be read as one ({error}); "
                "the recording may have been cut off, copy it again from the phone"
            ) from error
        pts = np.array(sorted(p for p, _, _ in found), dtype=np.int64)
        keys = sorted((p, d) for p, d, is_key in found if is_key)
        key_pts, key_dts = np.array(keys, dtype=np.int64).reshape(-1, 2).T
        if len(pts) == 0:
            raise ScanError(f"{path}: expected frames in the video, found none; copy it again")
        return Video(path, *size, pts, key_pts, key_dts, file or path)

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
                return _image(state["frame"])
            # The last key frame at or before it: decoding can only begin at one.
            key = max(0, np.searchsorted(self.key_pts, wanted, side="right") - 1)
            # Going on costs less than a jump unless a key frame lies between.
            if last is None or wanted < last or self.key_pts[key] > last:
                state["frames"] = self._decode_from(av, int(self.key_dts[key]), state)
            for frame, pts in state["frames"]:
                state["last_pts"], state["frame"] = pts, frame
                if pts >= wanted:
                    break
            if state.get("last_pts") == wanted:
                return _image(state["frame"])
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
        self, av: ModuleType, dts: int, state: dict[str, Any]
    ) -> Iterator[tuple[Any, int]]:
        """Frames, as FFmpeg has them, from the key frame at `dts` on, in the order they are shown."""
        if "container" in state:
            state["container"].close()
        container = av.open(str(self.file), **OPENING)
        state.clear()
        state["container"] = container
        stream = container.streams.video[0]
        container.seek(dts, stream=stream)
        return ((frame, frame.pts) for frame in container.decode(stream) if frame.pts is not None)


def _image(frame: Any) -> UInt8[np.ndarray, "h w 3"]:
    """RGB; only of frames that are asked for, as of most those between keyframes are passed over."""
    return frame.to_ndarray(format="rgb24")


def can_decode() -> bool:
    """Whether PyAV is installed."""
    return find_spec("av") is not None


def stored_size(file: Path) -> Size:
    """Size of a video's frames as stored, without PyAV; none of its frames is looked at.

    Raises:
        ScanError: the file is no whole video.
    """
    capture = cv2.VideoCapture(str(file))
    capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
    sides = (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
    width, height = (int(capture.get(side)) for side in sides)
    capture.release()
    if min(width, height) <= 0:
        raise ScanError(
            f"{file}: expected a video, found a file that cannot be read as one; the recording may have been "
            "cut off, copy it again from the phone"
        )
    return width, height


def _pyav() -> ModuleType:
    try:
        import av
    except ImportError as error:
        raise ScanError(
            "videos: expected the library PyAV, found none; pip install 'planfit[video]'"
        ) from error
    return av


@dataclass(frozen=True, kw_only=True)
class VideoImages(ImageFiles):
    """Colour out of a video, by the number at the end of a frame's id; depth and confidence out of files."""

    video: Video

    def sizes(self, frame: Frame) -> tuple[Size, Size]:
        """Of the video, and of the depth from its header."""
        size = (self.video.width, self.video.height)
        return size, (whole_image_size(self.source, frame.depth) if frame.depth else size)

    def color(self, frame: Frame) -> UInt8[np.ndarray, "h w 3"]:
        """Colour image, RGB."""
        return self.video.frame(int(re.findall(r"\d+", frame.frame_id)[-1]))
