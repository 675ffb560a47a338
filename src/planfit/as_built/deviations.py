"""Verdicts in words, and faces whose verdicts say one thing of one wall, together: both sides of a wall,
and its pieces in line."""

from dataclasses import dataclass

import numpy as np

from planfit.adjust.moved_walls import SAME_MOTION_M, is_one_wall
from planfit.as_built.types import AsBuilt, AsBuiltWall, Verdict
from planfit.findings import direction_words
from planfit.floorplan import Floorplan


def in_words(wall: AsBuiltWall, verdict: Verdict) -> str:
    """One verdict: "moved by 0.123 m (± 0.012 m) into the room, towards +x"."""
    if verdict is Verdict.MOVED:
        sides = f"{'into the room' if wall.offset_m > 0 else 'into the wall'}, "
        return (
            f"moved by {abs(wall.offset_m):.3f} m (± {wall.sigma_m:.3f} m) "
            f"{sides if wall.is_oriented else ''}{direction_words(wall.normal, wall.offset_m)}"
        )
    if verdict is Verdict.AGREES:
        return f"agrees: off by {wall.offset_m:+.3f} m (± {wall.sigma_m:.3f} m)"
    if verdict is Verdict.MISSING:
        return f"missing: cameras look through {wall.through_share:.0%} of its length"
    if verdict is Verdict.NEW:
        return f"new: {wall.length_m:.2f} m that the plan does not draw"
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


DEVIATING = (Verdict.MOVED, Verdict.MISSING, Verdict.NEW)


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


def deviations(as_built: AsBuilt, tolerance_m: float | None = None) -> tuple[Deviation, ...]:
    """Walls that are not as planned, the longest first.

    Args:
        as_built: verdicts on faces.
        tolerance_m: another than that of the options.
    """
    found = []
    for verdict in DEVIATING:
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
