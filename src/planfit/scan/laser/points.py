"""What a reader of a cloud gives: points with times, piece by piece, and a copy with points moved."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

Move = Callable[[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]], Float[np.ndarray, "n 3"]]
"""Points (m, in the file's axes) and their times (s, as the file has them) to where they belong."""

CHUNK_POINTS = 1_000_000
"""Points in memory at a time: with coordinates, times and what sorts them, 150 MB."""


@dataclass(frozen=True)
class TimedPoints:
    """Some points of a cloud."""

    xyz: Float[np.ndarray, "n 3"]
    """m, in the file's axes, double precision: site coordinates are millions of metres."""
    times: Float[np.ndarray, " n"]
    """s, as the file has them."""
    is_valid: Bool[np.ndarray, " n"]
    """Measured surface: neither withheld, nor classified as noise, nor marked as invalid."""


@dataclass(frozen=True)
class CloudClock:
    """What a file says of its times."""

    words: str
    """For messages."""
    gps_offset_s: float | None = None
    """Seconds to add for those since the beginning of GPS time (6 January 1980); None: not told."""
    is_gps_week: bool = False
    """Whether times count from the beginning of a GPS week, of which nothing is told."""


@runtime_checkable
class CloudFile(Protocol):
    """A file of points with times."""

    @property
    def path(self) -> Path:
        """Of the file."""
        ...

    @property
    def n_points(self) -> int:
        """As the file says."""
        ...

    @property
    def clock(self) -> CloudClock:
        """What the file says of its times."""
        ...

    def sample_times(self) -> Float[np.ndarray, " n"]:
        """Some times (s) out of all parts of the file that can be read at once.

        Raises:
            ScanError: the file is damaged.
        """
        ...

    def pieces(self) -> Iterator[TimedPoints]:
        """All points, in the order of the file.

        Raises:
            ScanError: the file is damaged.
        """
        ...

    def write_moved(self, path: Path, move: Move, to_other_axes: bool = False) -> None:
        """A copy of the file, in which points are moved and all else is kept.

        `to_other_axes` leaves out what tells where on Earth the file's own axes are.

        Raises:
            ScanError: the file is damaged, or a point is moved to where the file's form cannot tell it.
        """
        ...
