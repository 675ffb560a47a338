"""A floorplan as wall faces: what every plan reader gives."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from planfit.errors import FloorplanError
from planfit.geometry import segments


@dataclass(frozen=True)
class PlanSource:
    """Where a plan came from, and what was made of it: for `planfit plan` and for reports."""

    kind: str = ""
    """Kind of file, in words: "raster picture", "DXF drawing"."""
    unit: str = "m"
    """Unit of the file's coordinates; "unknown" where nothing tells."""
    unit_from: str = ""
    """What told the unit: "the file's header", "--unit", "the dimension text '8.20 m'"."""
    storey: str = ""
    """Storey that was read, of `storeys`."""
    storeys: tuple[str, ...] = ()
    layers: tuple[str, ...] = ()
    """Layers that were read as walls."""
    dropped: tuple[str, ...] = ()
    """What was left out and why, a sentence each."""
    warnings: tuple[str, ...] = ()
    """What a user should look at before trusting the plan."""
    file_from_plan: np.ndarray | None = None
    """(3, 3) from homogeneous plan x-y to the file's own coordinates (pixels for a picture, integer =
    pixel centre), to draw faces over the drawing; None where the file has no such coordinates."""
    drawn_lines: np.ndarray | None = None
    """(k, 2, 2) in the file's own coordinates: line work that was looked at for walls, the longest pieces
    where there are very many, to be shown behind the faces; None for pictures and bare segments."""
    dropped_lines: np.ndarray | None = None
    """(k, 2, 2) in the file's own coordinates: outlines of what was left out, to be shown; None where nothing
    was or it has no place."""
    is_mirrored: bool = False
    """Whether left and right of the file are swapped in the plan frame, as the user asked."""


@dataclass(frozen=True)
class Floorplan:
    """Wall faces in the plan frame: x-y in the drawing, seen from above.

    Lengths are metres where `is_metric`, else units of the drawing whose size is left to the alignment.

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
    thickness: np.ndarray | None = None
    """(n,) of the wall behind each face, NaN where it is not known; None where no face has any."""
    openings: np.ndarray | None = None
    """(k, 2, 2) ends of doors and windows along the faces they interrupt; None where they are not known."""
    is_metric: bool = True
    """Whether lengths are metres."""
    source: PlanSource = field(default_factory=PlanSource)
    """Where it came from."""

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
        if self.thickness is not None and self.thickness.shape != (n,):
            raise FloorplanError(
                f"{self.name}: expected a thickness for each of {n} faces, "
                f"found {self.thickness.shape}"
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
        """(n,) of each face."""
        return segments.lengths(self.ends)

    @cached_property
    def offsets(self) -> np.ndarray:
        """(n,): the line of a face is `normal @ xy == offset`."""
        return np.einsum("ni,ni->n", self.normals, self.ends[:, 0])

    def scaled(self, metres_per_unit: float) -> "Floorplan":
        """The same plan in metres, one unit of this one being `metres_per_unit` long."""
        source = self.source
        if source.file_from_plan is not None:
            unscale = np.diag([1 / metres_per_unit, 1 / metres_per_unit, 1.0])
            source = replace(source, file_from_plan=source.file_from_plan @ unscale)
        return replace(
            self,
            ends=self.ends * metres_per_unit,
            thickness=None if self.thickness is None else self.thickness * metres_per_unit,
            openings=None if self.openings is None else self.openings * metres_per_unit,
            is_metric=True,
            source=source,
        )

    def mirrored(self) -> "Floorplan":
        """The same plan with left and right swapped: x becomes -x."""
        source = self.source
        if source.file_from_plan is not None:
            swapped = source.file_from_plan @ np.diag([-1.0, 1.0, 1.0])
            source = replace(source, file_from_plan=swapped)
        return replace(
            self,
            ends=self.ends * (-1.0, 1.0),
            normals=self.normals * (-1.0, 1.0),
            openings=None if self.openings is None else self.openings * (-1.0, 1.0),
            source=replace(source, is_mirrored=not source.is_mirrored),
        )

    def with_warning(self, warning: str) -> "Floorplan":
        """The same plan with one more thing to look at."""
        source = replace(self.source, warnings=(*self.source.warnings, warning))
        return replace(self, source=source)

    @property
    def size(self) -> tuple[float, float]:
        """Extent in x and y."""
        width, depth = np.ptp(self.ends.reshape(-1, 2), axis=0)
        return float(width), float(depth)
