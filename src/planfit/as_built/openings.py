"""Doors, windows and passages as built: what is known of each, and what became of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from jaxtyping import Float

from planfit.priors import DOOR_LEAF_THICKNESS_M
from planfit.units import in_units


class OpeningVerdict(Enum):
    """What became of an opening; the value is the word for it."""

    OPEN = "open"
    """Cameras look through it."""
    CLOSED = "closed"
    """Wall, or a door that is shut, is seen in it."""
    NOT_SEEN = "not seen"
    """Nothing is known of it."""
    NEW = "new"
    """Cameras look through wall that the plan draws without one."""


class ClosedBy(Enum):
    """What closes an opening, as far as the scan tells; the value is the word for it."""

    DOOR = "shut door"
    """What is seen stands back from the wall."""
    WALL = "walled up"
    """What is seen is flush with both faces of a wall thicker than doors are: a leaf is not."""
    UNKNOWN = "shut door or walled up"
    """The scan does not tell."""


SURE_SIGMAS = 2.0
"""Standard deviations that a value is clear of a limit by where it is sure which side of that it lies on."""
MIN_OPEN_M = 0.3
"""Width of an opening, m, that cameras look through where it is open, or half its width where that is less: a
door may stand half open, and a window begins above a sill."""
MOST_SHARE = 0.5
"""Share of the width of a closed opening that shows wall or a door, of the length of a missing wall that is
looked through (a door of 1 m in a wall of 2.5 m is 0.4), of the rim of a room that faces look into it
from."""
LEAF_BACK_M = 0.03
"""What closes an opening is a door where it surely stands back from a face of its wall by more than this, m,
and wall where it surely does from neither, and the wall is thicker than a leaf by more than this."""
LEAF_M = DOOR_LEAF_THICKNESS_M.high
"""Maximum thickness of the leaf of a door, m."""


@dataclass(frozen=True)
class AsBuiltOpening:
    """An opening of the plan, or of a wall that is drawn without one, and what the scan says of it."""

    is_drawn: bool
    """Whether the plan draws it."""
    ends: Float[np.ndarray, "2 2"]
    """Where it is drawn, along the middle of its wall, plan frame, m; of one that is not, where it is."""
    normal: Float[np.ndarray, "2"]
    """Unit, across the wall."""
    thickness_m: float
    """Of the wall; 0 where it is drawn as one line."""
    open_share: float
    """Share of its width that cameras look through."""
    closed_share: float
    """Share of its width that shows wall or a door, and that they do not look through."""
    n_through_frames: int
    """Frames that look through it."""
    n_surface_frames: int
    """Frames that see wall or a door in it."""
    edges_m: tuple[float, float] = (np.nan, np.nan)
    """Where its two sides stand, m along the wall from `ends[0]`; NaN where a side was not seen."""
    edge_sigmas_m: tuple[float, float] = (np.nan, np.nan)
    """Standard deviations of these, what the poses may be off included."""
    kind: str = ""
    """What the plan's file says that it is: "door", "window"; empty where it does not tell."""
    element_id: str = ""
    """What the plan's file calls it: GlobalId of IFC of the door or window, else of the wall."""
    set_back_m: tuple[float, float] = (np.nan, np.nan)
    """How far what is seen in it stands behind the face of the wall beside it, from the side that `normal`
    points to and from the other, m; NaN from where it was not seen."""
    set_back_sigmas_m: tuple[float, float] = (np.nan, np.nan)
    """Standard deviations of these."""

    @property
    def drawn_width_m(self) -> float:
        """As drawn; of one that the plan lacks, as seen."""
        return float(np.linalg.norm(self.ends[1] - self.ends[0]))

    @property
    def width_m(self) -> float:
        """As built; NaN where a side was not seen."""
        return self.edges_m[1] - self.edges_m[0]

    @property
    def width_sigma_m(self) -> float:
        """Standard deviation of the width."""
        return float(np.hypot(*self.edge_sigmas_m))

    @property
    def shift_m(self) -> float:
        """How far its middle is from where it is drawn, along the wall from `ends[0]` to `ends[1]`; NaN where
        a side was not seen."""
        return (self.edges_m[0] + self.edges_m[1] - self.drawn_width_m) / 2

    @property
    def built_ends(self) -> Float[np.ndarray, "2 2"]:
        """Where it is; as drawn where a side was not seen."""
        if not np.isfinite(self.width_m):
            return self.ends
        along = (self.ends[1] - self.ends[0]) / self.drawn_width_m
        return self.ends[0] + np.array(self.edges_m)[:, None] * along

    @property
    def verdict(self) -> OpeningVerdict:
        """What became of it."""
        if not self.is_drawn:
            return OpeningVerdict.NEW
        enough = min(MIN_OPEN_M / self.drawn_width_m, 0.5)
        if self.open_share >= enough:
            return OpeningVerdict.OPEN
        if self.closed_share >= MOST_SHARE:
            return OpeningVerdict.CLOSED
        return OpeningVerdict.NOT_SEEN

    @property
    def closed_by(self) -> ClosedBy:
        """What closes it, where it is closed."""
        back_m = np.array(self.set_back_m)
        reach_m = SURE_SIGMAS * np.array(self.set_back_sigmas_m)
        if np.any(back_m - reach_m > LEAF_BACK_M):
            return ClosedBy.DOOR
        # A leaf may be flush with one face of a wall, or with both of a thin one.
        is_thick = self.thickness_m > LEAF_M + LEAF_BACK_M
        if is_thick and np.all(np.abs(back_m) + reach_m < LEAF_BACK_M):
            return ClosedBy.WALL
        return ClosedBy.UNKNOWN

    @property
    def word_of_closing(self) -> str | None:
        """What closes it, in a word for files; None where it is not closed."""
        is_closed = self.verdict is OpeningVerdict.CLOSED
        return self.closed_by.value if is_closed else None

    @property
    def differs(self) -> bool:
        """Whether it is not as planned. Windows are closed, and are planned so."""
        verdict = self.verdict
        return verdict is OpeningVerdict.NEW or (
            verdict is OpeningVerdict.CLOSED and self.kind != "window"
        )


def counted_openings(openings: Sequence[AsBuiltOpening]) -> dict[OpeningVerdict, int]:
    """How many openings have each verdict, in the order of `OpeningVerdict`."""
    verdicts = [opening.verdict for opening in openings]
    return {one: verdicts.count(one) for one in OpeningVerdict}


def opening_words(opening: AsBuiltOpening) -> str:
    """One verdict: "open: 0.912 m wide (± 0.021 m), drawn 0.900 m, shifted by +0.013 m"."""
    verdict = opening.verdict
    if verdict is OpeningVerdict.CLOSED:
        return _closed_words(opening)
    if verdict is OpeningVerdict.NOT_SEEN:
        return "not seen"
    width = "its sides were not both seen"
    if np.isfinite(opening.width_m):
        width = f"{in_units(opening.width_m)} wide (± {in_units(opening.width_sigma_m)})"
    if verdict is OpeningVerdict.NEW:
        return (
            f"new: cameras look through wall that is drawn without an opening, {width} "
            f"({opening.n_through_frames} frames)"
        )
    drawn = f"drawn {in_units(opening.drawn_width_m)}"
    if np.isfinite(opening.width_m):
        drawn += f", middle shifted by {in_units(opening.shift_m, '+.2f')}"
    return f"open: {width}, {drawn}"


def _closed_words(opening: AsBuiltOpening) -> str:
    seen = f"seen in {opening.closed_share:.0%} of its width, {opening.n_surface_frames} frames"
    if opening.kind == "window":
        return f"closed: a pane, a shutter or wall is {seen}"
    by = opening.closed_by
    if by is ClosedBy.DOOR:
        k = int(np.nanargmax(opening.set_back_m))
        return (
            f"closed by a shut door: what is {seen}, stands {in_units(opening.set_back_m[k])} "
            f"(± {in_units(opening.set_back_sigmas_m[k])}) back from the wall"
        )
    if by is ClosedBy.WALL:
        return f"walled up: what is {seen}, is flush with the wall on both sides"
    sides = int(np.sum(np.isfinite(opening.set_back_m)))
    flush = ("how far back from the wall it stands was not seen", "the other side was not seen")
    why = flush[sides] if sides < 2 else "it is neither surely flush with the wall nor set back"
    return f"closed, by a shut door or walled up, which the scan does not tell: {seen}; {why}"


def opening_title(opening: AsBuiltOpening) -> str:
    """What happened to an opening, and where: for lists of issues."""
    what = {
        OpeningVerdict.OPEN: "Opening is open",
        OpeningVerdict.CLOSED: "Opening is closed",
        OpeningVerdict.NOT_SEEN: "Opening was not seen",
        OpeningVerdict.NEW: "Opening that the plan does not draw",
    }[opening.verdict]
    if opening.verdict is OpeningVerdict.CLOSED and opening.kind != "window":
        what = f"Opening is closed ({opening.closed_by.value})"
    if opening.kind and opening.is_drawn:
        what = what.replace("Opening", opening.kind.capitalize())
    x, y = opening.ends.mean(axis=0)
    return f"{what}: ({x:.1f}, {y:.1f})"
