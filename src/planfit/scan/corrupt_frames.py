"""Frames that cannot be decoded: left blank, counted and named, as long as they are few."""

from dataclasses import dataclass, field
from threading import Lock

from planfit.errors import ScanError

MAX_DAMAGED_SHARE = 0.01
"""A file system or a transfer spoils single frames; where more than one in a hundred are spoiled, something
is wrong with the scan as a whole."""


@dataclass(frozen=True)
class CorruptFrames:
    """What could not be decoded so far; frames are decoded only when they are asked for."""

    n_frames: int
    reasons: dict[int, str] = field(default_factory=dict)
    """By frame. It grows while the scan is read."""
    _lock: Lock = field(default_factory=Lock, repr=False)

    def add(self, frame_idx: int, error: ScanError) -> None:
        """Note a frame.

        Raises:
            ScanError: `error` itself, where more than one frame in a hundred is damaged.
        """
        with self._lock:
            self.reasons.setdefault(frame_idx, str(error))
            if len(self.reasons) > MAX_DAMAGED_SHARE * self.n_frames:
                raise error
