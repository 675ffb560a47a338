"""A floorplan as wall faces: what every plan reader gives."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from planfit.errors import FloorplanError
from planfit.geometry import segments


@dataclass(frozen=True)
class Floorplan:
    """Wall faces in the plan frame: x-y in the drawing, seen from above, metres.

    A wall with thickness has two faces, each with the normal towards the free space it looks into.
    A stroke without thickness, whose free side is unknown, is a face that is not oriented.
    """

    name: str
    """Where it was read from, for messages."""
    ends: np.ndarray
    """(n, 2, 2) m, the two ends of each face."""
    normals: np.ndarray
    """(n, 2) unit normals, towards the free side where `is_oriented`."""
    is_oriented: np.ndarray
    """(n,) bool, whether the free side is known."""
    fingerprint: str = ""
    """Changes when the file does."""

    def __post_init__(self) -> None:
        n = len(self.ends)
        if n == 0:
            raise FloorplanError(
                f"{self.name}: expected wall segments, found none; check that it is the right file"
            )
        if self.ends.shape != (n, 2, 2) or self.normals.shape != (n, 2):
            raise FloorplanError(
                f"{self.name}: expected ends (n, 2, 2) and normals (n, 2), "
                f"found {self.ends.shape} and {self.normals.shape}"
            )
        if not np.isfinite(self.ends).all():
            raise FloorplanError(f"{self.name}: expected finite coordinates, found NaN or infinity")
        along = segments.directions(self.ends)
        slant = np.abs(np.einsum("ni,ni->n", along, self.normals)).max()
        length = np.linalg.norm(self.normals, axis=1)
        if not (slant < 1e-3 and np.abs(length - 1.0).max() < 1e-3):
            raise FloorplanError(
                f"{self.name}: expected unit normals across their faces, found one of length "
                f"{length[np.argmax(np.abs(length - 1.0))]:.3g}, or slanted by {slant:.3g}"
            )

    def __len__(self) -> int:
        return len(self.ends)

    @cached_property
    def lengths(self) -> np.ndarray:
        """(n,) m."""
        return segments.lengths(self.ends)

    @cached_property
    def offsets(self) -> np.ndarray:
        """(n,) m: the line of a face is `normal @ xy == offset`."""
        return np.einsum("ni,ni->n", self.normals, self.ends[:, 0])

    @property
    def size(self) -> tuple[float, float]:
        """Extent in x and y, m."""
        width, depth = np.ptp(self.ends.reshape(-1, 2), axis=0)
        return float(width), float(depth)
