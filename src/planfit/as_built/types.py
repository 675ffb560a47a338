"""Verdicts on the walls of a plan, and on those that it lacks: in words, and grouped by wall."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from jaxtyping import Float

from planfit.adjust.moved_walls import SAME_MOTION_M, is_one_wall
from planfit.as_built.openings import MOST_SHARE, SURE_SIGMAS, AsBuiltOpening
from planfit.errors import require_positive
from planfit.findings import direction_words
from planfit.floorplan import Floorplan
from planfit.runtime import short_repr
from planfit.units import in_units


class Verdict(Enum):
    """What became of a wall; the value is the word for it."""

    AGREES = "agrees"
    """It stands where it is drawn, within the tolerance."""
    MOVED = "moved"
    """It stands elsewhere, by more than the tolerance."""
    MISSING = "missing"
    """Cameras look through the place where it is drawn."""
    NOT_SEEN = "not seen"
    """Nothing is known of it."""
    NEW = "new"
    """It stands, and the plan does not draw it."""


_DEVIATING = (Verdict.MOVED, Verdict.MISSING, Verdict.NEW)


@dataclass(frozen=True)
class AsBuiltOptions:
    """When a wall agrees with its drawing, and how wide openings are."""

    tolerance_m: float = 0.05
    """A wall that stands off by no more agrees. What else is measured does not depend on it, so that it can
    be chosen again when results are looked at."""
    opening_widths_m: tuple[float, float] = (0.5, 3.0)
    """Narrowest and widest gap of a wall that is a door, window or passage."""

    def __post_init__(self) -> None:
        require_positive(self, "tolerance_m")


@dataclass(frozen=True)
class AsBuiltWall:
    """A face of the plan, or of a wall that it lacks, and what the scan says of it."""

    face_idx: int
    """Of the plan; -1: the plan does not draw it."""
    ends: Float[np.ndarray, "2 2"]
    """Where it is drawn, plan frame, m; of one that is not drawn, where it stands."""
    normal: Float[np.ndarray, "2"]
    """Unit, towards the side that it is seen from; of a face whose free side is unknown, either."""
    is_oriented: bool
    """Whether the free side is known: that a positive offset is into the room."""
    offset_m: float
    """How far along the normal it stands off where it is drawn; NaN where no wall was seen."""
    sigma_m: float
    """Standard deviation of that, what the poses may be off included."""
    n_patches: int
    """Wall patches that it was seen by."""
    n_frames: int
    """Frames that these are of."""
    through_share: float
    """Share of its length, as drawn, that cameras look through; 0 of one that is not drawn."""
    element_id: str = ""
    """What the plan's file calls the wall: GlobalId of IFC."""
    is_glass: bool = False
    """Whether the plan's file says that it is of glass: it may stand though cameras look through it."""

    @property
    def length_m(self) -> float:
        """As drawn."""
        return float(np.linalg.norm(self.ends[1] - self.ends[0]))

    @property
    def is_standing(self) -> bool:
        """Whether wall was seen."""
        return bool(np.isfinite(self.offset_m))

    @property
    def built_ends(self) -> Float[np.ndarray, "2 2"]:
        """Where it stands, plan frame, m; where it is drawn if it was not seen."""
        return self.ends + (self.offset_m if self.is_standing else 0.0) * self.normal

    def is_one_place(self, other: "AsBuiltWall", within_m: float) -> bool:
        """Whether this and another stand off by the same motion."""
        motion = self.built_ends[0] - self.ends[0] - (other.built_ends[0] - other.ends[0])
        return bool(np.linalg.norm(motion) <= within_m)


@dataclass(frozen=True)
class Deviation:
    """A wall that is not as planned."""

    verdict: Verdict
    walls: tuple[AsBuiltWall, ...]
    """Its faces, the longest first."""

    @property
    def element_ids(self) -> tuple[str, ...]:
        """What the plan's file calls it, without repetition."""
        return tuple(dict.fromkeys(wall.element_id for wall in self.walls if wall.element_id))


@dataclass(frozen=True)
class AsBuilt:
    """All walls of a plan, and those that it lacks."""

    walls: tuple[AsBuiltWall, ...]
    """Faces of the plan in its order, then those that are new, the longest first."""
    options: AsBuiltOptions
    """By which they were judged."""
    plan_name: str = ""
    """Where the plan was read from."""
    file_from_plan: Float[np.ndarray, "3 3"] | None = None
    """From homogeneous plan x-y to the coordinates of the plan's own file, where that is a drawing."""
    elevation_m: float = 0.0
    """Height of the plan's floor in its own file, m."""
    openings: tuple[AsBuiltOpening, ...] = ()
    """Doors, windows and passages of the plan, then those that it lacks."""

    __repr__ = short_repr

    @property
    def file_units_per_metre(self) -> float:
        """Of the coordinates that drawings are written in."""
        if self.file_from_plan is None:
            return 1.0
        return float(np.sqrt(abs(np.linalg.det(self.file_from_plan[:2, :2]))))

    def in_file(self, xy: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, "k 2"]:
        """Points (m, plan frame) in the coordinates of the plan's own file; as they are where it has none."""
        if self.file_from_plan is None:
            return xy
        return xy @ self.file_from_plan[:2, :2].T + self.file_from_plan[:2, 2]

    def verdict(self, wall: AsBuiltWall, tolerance_m: float | None = None) -> Verdict:
        """What became of a wall; by another tolerance than that of the options, where one is given."""
        tolerance = self.options.tolerance_m if tolerance_m is None else tolerance_m
        if wall.face_idx < 0:
            return Verdict.NEW
        if wall.is_standing:
            return Verdict.MOVED if abs(wall.offset_m) > tolerance else Verdict.AGREES
        is_missing = wall.through_share >= MOST_SHARE and not wall.is_glass
        return Verdict.MISSING if is_missing else Verdict.NOT_SEEN

    def is_sure(self, wall: AsBuiltWall, tolerance_m: float | None = None) -> bool:
        """Whether a wall that stands surely agrees, or was surely moved; of others, true."""
        tolerance = self.options.tolerance_m if tolerance_m is None else tolerance_m
        if wall.face_idx < 0 or not wall.is_standing:
            return True
        return abs(abs(wall.offset_m) - tolerance) > SURE_SIGMAS * wall.sigma_m

    def verdicts(self, tolerance_m: float | None = None) -> tuple[Verdict, ...]:
        """Of all walls."""
        return tuple(self.verdict(wall, tolerance_m) for wall in self.walls)


def counted(verdicts: Sequence[Verdict]) -> dict[Verdict, int]:
    """How many walls have each verdict, in the order of `Verdict`."""
    return {verdict: sum(one is verdict for one in verdicts) for verdict in Verdict}


def in_words(wall: AsBuiltWall, verdict: Verdict) -> str:
    """One verdict: "moved by 0.123 m (± 0.012 m) into the room, towards +x"."""
    if verdict is Verdict.MOVED:
        sides = f"{'into the room' if wall.offset_m > 0 else 'into the wall'}, "
        return (
            f"moved by {in_units(abs(wall.offset_m), '.3f')} (± {in_units(wall.sigma_m, '.3f')}) "
            f"{sides if wall.is_oriented else ''}{direction_words(wall.normal, wall.offset_m)}"
        )
    if verdict is Verdict.AGREES:
        return (
            f"agrees: off by {in_units(wall.offset_m, '+.3f')} (± {in_units(wall.sigma_m, '.3f')})"
        )
    if verdict is Verdict.MISSING:
        return f"missing: cameras look through {wall.through_share:.0%} of its length"
    if verdict is Verdict.NEW:
        return f"new: {in_units(wall.length_m)} that the plan does not draw"
    if wall.is_glass and wall.through_share > 0:
        return (
            f"not seen: glass, which cameras look through ({wall.through_share:.0%} of its length)"
        )
    return "not seen"


def title(wall: AsBuiltWall, verdict: Verdict) -> str:
    """What happened to a wall, and where: for lists of issues."""
    what = {
        Verdict.MOVED: f"Wall stands {100 * abs(np.nan_to_num(wall.offset_m)):.0f} cm off its drawing",
        Verdict.MISSING: "Wall is missing",
        Verdict.NEW: "Wall that the plan does not draw",
        Verdict.AGREES: "Wall agrees with its drawing",
        Verdict.NOT_SEEN: "Wall was not seen",
    }[verdict]
    (x1, y1), (x2, y2) = wall.ends
    return f"{what}: ({x1:.1f}, {y1:.1f})-({x2:.1f}, {y2:.1f})"


def deviations(as_built: AsBuilt, tolerance_m: float | None = None) -> tuple[Deviation, ...]:
    """Walls that are not as planned, the longest first."""
    found = []
    for verdict in _DEVIATING:
        of_kind = [w for w in as_built.walls if as_built.verdict(w, tolerance_m) is verdict]
        found += [Deviation(verdict, group) for group in _groups(of_kind)]
    return tuple(sorted(found, key=lambda one: -one.walls[0].length_m))


def _groups(walls: list[AsBuiltWall]) -> list[tuple[AsBuiltWall, ...]]:
    """Walls that are one, the longest of each first."""
    if not walls:
        return []
    plan = Floorplan(
        "as built",
        np.stack([wall.ends for wall in walls]),
        np.stack([wall.normal for wall in walls]),
        np.array([wall.is_oriented for wall in walls]),
    )
    groups: list[list[int]] = []
    for i, wall in enumerate(walls):
        own = [
            group
            for group in groups
            if any(
                is_one_wall(i, j, plan) and wall.is_one_place(walls[j], SAME_MOTION_M)
                for j in group
            )
        ]
        groups = [group for group in groups if not any(group is one for one in own)]
        groups.append([i, *(j for group in own for j in group)])
    return [
        tuple(sorted((walls[i] for i in group), key=lambda wall: -wall.length_m))
        for group in groups
    ]
