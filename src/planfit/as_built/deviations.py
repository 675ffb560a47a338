"""Faces whose verdicts say one thing of one wall, together: both sides of a wall, and its pieces in line."""

from dataclasses import dataclass

import numpy as np

from planfit.adjust.moved_walls import SAME_MOTION_M, is_one_wall
from planfit.as_built.types import AsBuilt, AsBuiltWall, Verdict
from planfit.floorplan import Floorplan

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
