"""What a person may say of a scan and a plan, entry by entry."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.errors import OptionError
from planfit.findings import Finding

FrameRange = tuple[int, int]
"""First and last frame, as numbered in the scan from 0."""
Pixel = tuple[float, float]
"""Column u and row v of an image at the size of its `Scan.cameras`, px; integers are centres of pixels."""


@dataclass(frozen=True)
class _Entry:
    """What every correction has."""

    number: int
    """Among the entries of its kind, from 1."""
    note: str = field(default="", kw_only=True)
    """A word of one's own; it says nothing to planfit."""


@dataclass(frozen=True)
class Place(_Entry):
    """A point of the scan whose place on the plan is known."""

    plan: tuple[float, float]
    """In the coordinates at the rim of `planfit plan PLAN -o plan.png`."""
    frame: int | None = None
    """Frame that sees the point; None where it is given in the scan's own axes."""
    pixel: Pixel | None = None
    scan: tuple[float, float, float] | None = None
    """m, the scan's own axes."""
    is_of_file: bool = False
    """Whether `plan` is in the coordinates of the plan's own file."""

    kind = "place"

    @property
    def words(self) -> str:
        """What it says."""
        of = f"pixel {_xy(self.pixel)} of frame {self.frame}" if self.pixel else f"{_xy(self.scan)}"
        return f"place {self.number}: {of} is {_xy(self.plan)} of the plan"


@dataclass(frozen=True)
class AddedLoop(_Entry):
    """Two frames that see the same."""

    frames: tuple[int, int]
    """The earlier one first."""
    pixels: tuple[Pixel, Pixel] | None = None
    """One point, in the image of each; None leaves it to the images."""

    kind = "add_loop"

    @property
    def words(self) -> str:
        """What it says."""
        at = "" if self.pixels is None else f", at {_xy(self.pixels[0])} and {_xy(self.pixels[1])}"
        return (
            f"add_loop {self.number}: frames {self.frames[0]} and {self.frames[1]} see the same{at}"
        )


@dataclass(frozen=True)
class DeletedLoop(_Entry):
    """Frames that do not see the same, whatever their images say."""

    first: FrameRange
    second: FrameRange

    kind = "delete_loop"

    @property
    def words(self) -> str:
        """What it says."""
        return (
            f"delete_loop {self.number}: {_frames(self.first)} and {_frames(self.second)} do not see "
            "the same"
        )


@dataclass(frozen=True)
class ExcludedFrames(_Entry):
    """Frames that take no part; their poses are read between those of their neighbours."""

    ranges: tuple[FrameRange, ...]

    kind = "exclude_frames"

    @property
    def words(self) -> str:
        """What it says."""
        return f"exclude_frames {self.number}: {' and '.join(_frames(r) for r in self.ranges)}"


WallKind = Literal["exclude_wall", "erase_wall", "draw_wall"]


@dataclass(frozen=True)
class WallByHand:
    """A wall of the plan that is not to be used, is not there, or is missing."""

    kind: WallKind
    number: int
    ends: tuple[tuple[float, float], tuple[float, float]]
    """In the coordinates at the rim of `planfit plan PLAN -o plan.png`."""
    note: str = ""
    """A word of one's own; it says nothing to planfit."""

    @property
    def words(self) -> str:
        """What it says."""
        return f"{self.kind} {self.number}: from {_xy(self.ends[0])} to {_xy(self.ends[1])}"


Correction = Place | AddedLoop | DeletedLoop | ExcludedFrames | WallByHand


@dataclass(frozen=True)
class Contradiction:
    """A correction that another one, or the scan, contradicts."""

    correction: Correction
    reason: Finding
    """How."""
    prevents: bool = False
    """Whether nothing can be solved with it."""

    @property
    def sentence(self) -> str:
        """For a user, without a full stop."""
        return f"{self.correction.words}: {self.reason.sentence}"


_NAMES = {
    "place": ("place", "places"),
    "add_loop": ("loop added", "loops added"),
    "delete_loop": ("loop deleted", "loops deleted"),
    "exclude_frames": ("exclusion of frames", "exclusions of frames"),
    "exclude_wall": ("wall not used", "walls not used"),
    "erase_wall": ("wall erased", "walls erased"),
    "draw_wall": ("wall drawn", "walls drawn"),
}


@dataclass(frozen=True)
class Corrections:
    """Corrections by hand of one scan on one plan."""

    name: str = ""
    """The file that they are from, for messages."""
    entries: tuple[Correction, ...] = ()

    def __iter__(self) -> Iterator[Correction]:
        return iter(self.entries)

    def __len__(self) -> int:
        return len(self.entries)

    @property
    def places(self) -> tuple[Place, ...]:
        """Points whose place on the plan is known."""
        return tuple(each for each in self.entries if isinstance(each, Place))

    @property
    def added(self) -> tuple[AddedLoop, ...]:
        """Loops that are there."""
        return tuple(each for each in self.entries if isinstance(each, AddedLoop))

    @property
    def deleted(self) -> tuple[DeletedLoop, ...]:
        """Loops that are not there."""
        return tuple(each for each in self.entries if isinstance(each, DeletedLoop))

    def walls(self, kind: WallKind) -> tuple[WallByHand, ...]:
        """Walls of which one thing is said."""
        return tuple(each for each in self.entries if each.kind == kind)  # type: ignore[misc]

    def wall_ends(self, kind: WallKind) -> Float[np.ndarray, "w 2 2"]:
        """Ends of these."""
        return np.array([wall.ends for wall in self.walls(kind)], dtype=float).reshape(-1, 2, 2)

    def is_excluded(self, n_frames: int) -> Bool[np.ndarray, " n"]:
        """Frames of a scan that take no part."""
        excluded = np.zeros(n_frames, dtype=bool)
        for each in self.entries:
            if isinstance(each, ExcludedFrames):
                for first, last in each.ranges:
                    excluded[first : last + 1] = True
        return excluded

    def are_deleted(self, pairs: Int[np.ndarray, "p 2"]) -> Bool[np.ndarray, " p"]:
        """Which pairs of frames, in either order, were said not to see the same."""
        deleted = np.zeros(len(pairs), dtype=bool)
        for each in self.deleted:
            for one, other in ((each.first, each.second), (each.second, each.first)):
                deleted |= _within(pairs[:, 0], one) & _within(pairs[:, 1], other)
        return deleted

    def without(self, contradictions: tuple[Contradiction, ...]) -> "Corrections":
        """Those that nothing contradicts."""
        left_out = {(each.correction.kind, each.correction.number) for each in contradictions}
        left = (each for each in self.entries if (each.kind, each.number) not in left_out)
        return Corrections(self.name, tuple(left))

    @property
    def sentence(self) -> str:
        """How many of what, as `3 corrections by hand: 1 place, 2 loops added`."""
        counts = Counter(each.kind for each in self.entries)
        kinds = [f"{n} {_NAMES[kind][n > 1]}" for kind, n in counts.items()]
        word = "correction" if len(self) == 1 else "corrections"
        return f"{len(self)} {word} by hand: {', '.join(kinds)}"

    @property
    def last_frame(self) -> int:
        """The highest number of a frame that is named; 0 where none is."""
        return max((frame for each in self.entries for frame in _named(each)), default=0)

    def require_frames(self, n_frames: int) -> None:
        """Raise `OptionError` where a frame is named that a scan of so many frames has not, or all are
        excluded."""
        for each in self.entries:
            for frame in _named(each):
                if frame >= n_frames:
                    raise OptionError(
                        f"{self.name}: {each.kind} {each.number}: expected frames from 0 to {n_frames - 1}, "
                        f"found {frame}; frames are numbered from 0, as in the report"
                    )
        if np.sum(~self.is_excluded(n_frames)) < 2:
            raise OptionError(
                f"{self.name}: exclude_frames: expected two frames at least that take part, found fewer of "
                f"{n_frames}; exclude less"
            )


NO_CORRECTIONS = Corrections()


def _named(correction: Correction) -> list[int]:
    if isinstance(correction, Place):
        return [] if correction.frame is None else [correction.frame]
    if isinstance(correction, AddedLoop):
        return list(correction.frames)
    if isinstance(correction, DeletedLoop):
        return [*correction.first, *correction.second]
    if isinstance(correction, ExcludedFrames):
        return [frame for run in correction.ranges for frame in run]
    return []


def _within(frames: Int[np.ndarray, " p"], run: FrameRange) -> Bool[np.ndarray, " p"]:
    return (frames >= run[0]) & (frames <= run[1])


def _frames(run: FrameRange) -> str:
    return f"frame {run[0]}" if run[0] == run[1] else f"frames {run[0]}-{run[1]}"


def _xy(values: tuple[float, ...] | None) -> str:
    return f"({', '.join(f'{v:g}' for v in values or ())})"
