"""A floorplan as wall faces: what every plan reader gives, and what callers make of segments of their own."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from numpy.typing import ArrayLike

from planfit.errors import FloorplanError
from planfit.floorplan.faces import Ends, first_of_each, orient_faces, usual_gap
from planfit.geometry import segments
from planfit.runtime import short_html, short_repr

SHORTEST_SHARE, LARGEST = 1e-10, 1e5
"""Of the size of a plan, and at most of this one (of what is too large for a building, that is said): what is
shorter is a point up to rounding, with no direction of its own."""


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
    file_from_plan: Float[np.ndarray, "3 3"] | None = None
    """From homogeneous plan x-y to the file's own coordinates (pixels for a picture, integer =
    pixel centre), to draw faces over the drawing; None where the file has no such coordinates."""
    drawn_lines: Float[np.ndarray, "k 2 2"] | None = None
    """In the file's own coordinates: line work that was looked at for walls, the longest segments where
    there are very many, to be shown behind the faces; None for pictures and bare segments."""
    dropped_lines: Float[np.ndarray, "d 2 2"] | None = None
    """In the file's own coordinates: outlines of what was left out, to be shown; None where nothing
    was or it has no place."""
    is_mirrored: bool = False
    """Whether left and right of the file are swapped in the plan frame, as the user asked."""
    opening_kinds: tuple[str, ...] = ()
    """What the openings are, counted: "5 doors", "11 windows"; empty where the file does not tell."""
    opening_lines: Float[np.ndarray, "o 2 2"] | None = None
    """In the file's own coordinates: openings along the faces that they interrupt; None where the file does
    not tell what they are."""
    opening_names: tuple[str, ...] = ()
    """What each of those is: "door", "window", "opening"."""
    opening_ids: tuple[str, ...] = ()
    """What the file calls the door or window that each is of: GlobalId of IFC; empty where it names none."""
    map_words: str = ""
    """Where on a map the plan lies, in words; empty where the file does not tell."""
    map_from_file: Float[np.ndarray, "3 3"] | None = None
    """From the file's own coordinates to those of the map, in its unit; None where the file does not tell."""
    map_height_m: float = 0.0
    """Height on the map of what is at height 0 in the file."""
    element_lines: Float[np.ndarray, "e 2 2"] | None = None
    """In the file's own coordinates: outlines of the elements of a model that were read as walls; None where
    the file has none."""
    element_ids: tuple[str, ...] = ()
    """What the file calls the element that each of those is of: GlobalId of IFC."""
    element_is_glass: Bool[np.ndarray, " e"] | None = None
    """Whether each of those is of glass, which depth cameras look through; None: the file does not tell."""
    elevation_m: float = 0.0
    """Height of the floor of the storey that was read in the file's own axes."""
    is_picture: bool = False
    """Whether the file's own coordinates are pixels of a picture: points of the plan are then given in these
    (u right, v down), else in the plan frame."""

    __repr__ = short_repr
    _repr_html_ = short_html

    @property
    def rim_from_plan(self) -> Float[np.ndarray, "3 3"]:
        """From homogeneous plan x-y to the coordinates that a user gives and reads, at the rim of the picture
        of `planfit plan`: pixels of a picture, else the plan frame itself."""
        if self.is_picture and self.file_from_plan is not None:
            return self.file_from_plan
        return np.eye(3)


@dataclass(frozen=True)
class Floorplan:
    """Wall faces in the plan frame: x-y in the drawing, seen from above.

    Lengths are metres where `is_metric`, else units of the drawing whose size is left to the alignment.

    A wall with thickness has two faces, each with the normal towards the free space it looks into.
    A stroke without thickness, whose free side is unknown, is a face that is not oriented.
    """

    name: str
    """Where it was read from, for messages."""
    ends: Ends
    """The two ends of each face, m; never one place."""
    normals: Float[np.ndarray, "n 2"]
    """Unit normals, towards the free side where `is_oriented`."""
    is_oriented: Bool[np.ndarray, " n"]
    """Whether the free side is known."""
    fingerprint: str = ""
    """Changes when the file does."""
    thickness: Float[np.ndarray, " n"] | None = None
    """Of the wall behind each face, NaN where it is not known; None where no face has any."""
    openings: Float[np.ndarray, "k 2 2"] | None = None
    """Ends of doors and windows along the faces they interrupt; None where they are not known."""
    is_metric: bool = True
    """Whether lengths are metres."""
    source: PlanSource = field(default_factory=PlanSource)
    """Where it came from."""
    storeys: Int[np.ndarray, " n"] | None = None
    """Storey of each face, where plans of several storeys were joined; None: one plan for all frames."""
    is_unused: Bool[np.ndarray, " n"] | None = None
    """Faces that a user knows to mislead: they are drawn, and hold nothing. None: all are used."""
    before_line: Float[np.ndarray, " n"] | None = None
    """How far before the line of its wall each face was put, where walls are drawn by their centre lines; 0
    of faces as drawn. None: all are as drawn."""
    drawn: Ends | None = None
    """Ends of the face of the file that each was made of, where lines were given both faces: two of one line
    have the same. None: all are as drawn."""

    __repr__ = short_repr
    _repr_html_ = short_html

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
        shortest = float(segments.lengths(self.ends).min())
        size = min(float(np.ptp(self.ends.reshape(-1, 2), axis=0).max()), LARGEST)
        if not shortest > SHORTEST_SHARE * size:
            raise FloorplanError(
                f"{self.name}: expected faces with a length, found one of {shortest:.3g}; leave points out"
            )
        along = segments.directions(self.ends)
        slant = np.abs(np.einsum("ni,ni->n", along, self.normals)).max()
        length = np.linalg.norm(self.normals, axis=1)
        if not max(slant, np.abs(length - 1.0).max()) < 1e-3:
            raise FloorplanError(
                f"{self.name}: expected unit normals across their faces, found one of length "
                f"{length[np.argmax(np.abs(length - 1.0))]:.3g}, or slanted by {slant:.3g}"
            )

    def used(self) -> "Floorplan":
        """The faces that are used, as a plan of its own; the very same one where all are.

        Raises:
            FloorplanError: none is.
        """
        if self.is_unused is None:
            return self
        kept = ~self.is_unused
        if not kept.any():
            raise FloorplanError(
                f"{self.name}: expected a wall that is used, found all {len(self)} excluded; exclude less"
            )
        return self.take(kept, is_unused=None)

    def take(self, faces: Shaped[np.ndarray, " k"], **changed: Any) -> "Floorplan":
        """The faces of a mask or an index, as a plan of its own.

        Args:
            faces: one at least.
            changed: other fields, by name.
        """
        told = {name: getattr(self, name) for name in _OF_FACES}
        rows = {name: rows[faces] for name, rows in told.items() if rows is not None}
        return replace(self, **{**rows, **changed})

    @classmethod
    def from_segments(
        cls,
        ends: ArrayLike,
        normals: ArrayLike | None = None,
        *,
        name: str = "segments",
        is_metric: bool = True,
        fingerprint: str | None = None,
    ) -> "Floorplan":
        """A plan of wall segments in memory; points (segments without length) and repeated ones are left out.

        Without normals, the free side of each segment is found from its neighbours: a wall is drawn as two
        parallel lines with the wall between them. Where the segments are not metric, the thickness of walls
        is taken from the gaps between parallel segments: most lines of a plan of thick walls have the other
        face of their wall next to them.

        Args:
            ends: (n, 2, 2) the two ends of each segment, x-y seen from above, m where `is_metric`.
            normals: (n, 2) of any length, across the segments and towards the free side; rows of NaN where
                that side is not known.
            name: for messages.
            is_metric: whether lengths are metres; otherwise the alignment finds the scale.
            fingerprint: changes when the segments do; None makes one of them.

        Raises:
            FloorplanError: arrays of other shapes, coordinates that are not finite, normals along their
                segments, or no segment with a length.
        """
        ends, normals = _checked_segments(name, ends, normals)
        if fingerprint is None:
            fingerprint = _fingerprint(ends, normals)
        extent = float(np.ptp(ends.reshape(-1, 2), axis=0).max()) if len(ends) else 0.0
        kept = np.flatnonzero(segments.lengths(ends) > (1e-6 if is_metric else 1e-6 * extent))
        if len(kept) == 0:
            raise FloorplanError(
                f"{name}: expected wall segments, found none; is it the right file?"
            )
        kept = kept[first_of_each(ends[kept])]
        ends = ends[kept]
        if normals is not None:
            across, is_oriented = _given_sides(name, ends, normals[kept])
        elif is_metric:
            across, is_oriented = orient_faces(ends)
        else:
            # A thirtieth: lines further apart are single, and their neighbours across a room.
            gap = usual_gap(ends, extent / 30)
            across, is_oriented = segments.left_normals(ends), np.zeros(len(ends), dtype=bool)
            if np.isfinite(gap):
                across, is_oriented = orient_faces(ends, 2.5 * gap, 0.1 * gap)
        return cls(name, ends, across, is_oriented, fingerprint, is_metric=is_metric)

    def __len__(self) -> int:
        return len(self.ends)

    @cached_property
    def lengths(self) -> Float[np.ndarray, " n"]:
        """Of each face."""
        return segments.lengths(self.ends)

    @property
    def ends_free_left(self) -> Ends:
        """The ends so that the free side is on the left of the way from the first to the second."""
        is_turned = np.einsum("ni,ni->n", segments.left_normals(self.ends), self.normals) < 0
        return np.where(is_turned[:, None, None], self.ends[:, ::-1], self.ends)

    @cached_property
    def offsets(self) -> Float[np.ndarray, " n"]:
        """The line of a face is `normal @ xy == offset`."""
        return np.einsum("ni,ni->n", self.normals, self.ends[:, 0])

    def scaled(self, metres_per_unit: float) -> "Floorplan":
        """The same plan in metres, one unit of this one being `metres_per_unit` long."""
        thickness, before = self.thickness, self.before_line
        return self.mapped(
            lambda xy: xy * metres_per_unit,
            np.diag([1 / metres_per_unit, 1 / metres_per_unit, 1.0]),
            thickness=None if thickness is None else thickness * metres_per_unit,
            before_line=None if before is None else before * metres_per_unit,
            is_metric=True,
        )

    def mirrored(self) -> "Floorplan":
        """The same plan with left and right swapped: x becomes -x."""
        swapped = self.mapped(
            lambda xy: xy * (-1.0, 1.0),
            np.diag([-1.0, 1.0, 1.0]),
            normals=self.normals * (-1.0, 1.0),
        )
        is_mirrored = not self.source.is_mirrored
        return replace(swapped, source=replace(swapped.source, is_mirrored=is_mirrored))

    def placed(self, target_from_plan: Float[np.ndarray, "4 4"]) -> "Floorplan":
        """The same plan in other axes: turned about z and translated (m)."""
        target_from_own = np.eye(3)
        target_from_own[:2] = target_from_plan[:2, [0, 1, 3]]
        return self.mapped(
            lambda xy: segments.moved(xy, target_from_own),
            np.linalg.inv(target_from_own),
            normals=self.normals @ target_from_own[:2, :2].T,
        )

    def mapped(
        self,
        mapped: Callable[[Float[np.ndarray, "*n 2"]], Float[np.ndarray, "*n 2"]],
        plan_from_mapped: Float[np.ndarray, "3 3"],
        **changed: Any,
    ) -> "Floorplan":
        """The same plan in other axes or another unit.

        Args:
            mapped: points of this plan in those.
            plan_from_mapped: the way back, of homogeneous x-y.
            changed: what else is another there, as normals and lengths are, by name.
        """
        source = self.source
        if source.file_from_plan is not None:
            source = replace(source, file_from_plan=source.file_from_plan @ plan_from_mapped)
        told = {name: getattr(self, name) for name in ("ends", "openings", "drawn")}
        points = {name: mapped(xy) for name, xy in told.items() if xy is not None}
        return replace(self, source=source, **points, **changed)

    def of_storey(self, storey: int) -> "Floorplan":
        """The faces of one storey of joined plans, as a plan of its own."""
        assert self.storeys is not None
        return self.take(self.storeys == storey, openings=None, storeys=None)

    def with_warning(self, warning: str) -> "Floorplan":
        """The same plan with one more thing to look at."""
        source = replace(self.source, warnings=(*self.source.warnings, warning))
        return replace(self, source=source)

    @property
    def drawn_ends(self) -> Ends:
        """Of each face, the face of the file that it was made of, by which users of the file know it."""
        return self.ends if self.drawn is None else self.drawn

    @property
    def size(self) -> tuple[float, float]:
        """Extent in x and y."""
        width, depth = np.ptp(self.ends.reshape(-1, 2), axis=0)
        return float(width), float(depth)


_OF_FACES = (
    "ends", "normals", "is_oriented", "thickness", "storeys", "is_unused", "before_line", "drawn",
)  # fmt: skip
"""Fields of a plan that have a row for each face, where they are known."""


def _checked_segments(
    name: str, ends: ArrayLike, normals: ArrayLike | None
) -> tuple[Ends, Float[np.ndarray, "n 2"] | None]:
    """Arrays of numbers of the right shapes."""
    try:
        ends = np.array(ends, dtype=float)
        normals = None if normals is None else np.array(normals, dtype=float)
    except (ValueError, TypeError) as error:
        raise FloorplanError(
            f"{name}: expected segments (n, 2, 2) and normals (n, 2) of numbers, found {error}"
        ) from error
    if ends.size == 0:
        ends = ends.reshape(-1, 2, 2)
    if ends.ndim != 3 or ends.shape[1:] != (2, 2):
        raise FloorplanError(
            f"{name}: expected segments (n, 2, 2): n times two ends of x and y, found {ends.shape}"
        )
    if not np.isfinite(ends).all():
        raise FloorplanError(f"{name}: expected finite coordinates, found NaN or infinity")
    if normals is not None and normals.shape != (len(ends), 2):
        raise FloorplanError(
            f"{name}: expected a normal of x and y for each of {len(ends)} segments, "
            f"found {normals.shape}"
        )
    return ends, normals


def _given_sides(
    name: str, ends: Ends, given: Float[np.ndarray, "n 2"]
) -> tuple[Float[np.ndarray, "n 2"], Bool[np.ndarray, " n"]]:
    """Unit normals on the side of the given ones, and which were given (are not NaN)."""
    left = segments.left_normals(ends)
    is_given = np.asarray(~np.isnan(given).any(axis=1))
    given = np.where(is_given[:, None], given, left)
    length = np.linalg.norm(given, axis=1)
    if not (np.isfinite(length).all() and (length > 0).all()):
        raise FloorplanError(f"{name}: expected normals with a length, found 0 or infinity")
    cosine = np.einsum("ni,ni->n", given, left) / length
    slanted = np.flatnonzero(np.abs(cosine) < np.cos(np.deg2rad(1.0)))
    if len(slanted):
        slant = np.rad2deg(np.arccos(np.abs(cosine[slanted[0]])))
        raise FloorplanError(
            f"{name}: expected normals at right angles to their segments, found {len(slanted)} that are "
            f"not, the first (of segment {ends[slanted[0]].tolist()}) slanted by {slant:.3g} deg"
        )
    return left * np.sign(cosine)[:, None], is_given


def _fingerprint(ends: Ends, normals: Float[np.ndarray, "n 2"] | None) -> str:
    content = ends.tobytes() + (b"" if normals is None else normals.tobytes())
    return hashlib.sha256(content).hexdigest()[:16]
