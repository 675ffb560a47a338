"""What a walk needs to know of the building it goes through."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from planfit.synth.rect import Rect


@runtime_checkable
class Region(Protocol):
    """A room, seen from above, building frame."""

    @property
    def area(self) -> float:
        """Of the floor, m2."""
        ...

    def contains(self, xy: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
        """Which of the points lie inside."""
        ...


@runtime_checkable
class Space(Protocol):
    """One storey of a building, in its own frame: z up, floor at z = 0, m."""

    @property
    def rooms(self) -> Sequence[Region]:
        """Rooms that a walk shall call at."""
        ...

    @property
    def bounds(self) -> Rect:
        """Around all rooms."""
        ...

    @property
    def plan_from_building(self) -> Float[np.ndarray, "4 4"]:
        """From the building's frame to the plan's."""
        ...

    def clearance(self, xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        """Distances, m, to all that one cannot walk through; 0 within it and outside the building."""
        ...

    def inwards(self, xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Directions away from the walls, of length 1 or less."""
        ...
