"""Upright rectangles, seen from above."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float


@dataclass(frozen=True)
class Rect:
    """An upright rectangle in the building frame, m."""

    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def size(self) -> Float[np.ndarray, "2"]:
        """Width and height, m."""
        return np.array([self.x1 - self.x0, self.y1 - self.y0])

    @property
    def area(self) -> float:
        """Area, m2."""
        return float(np.prod(self.size))

    @property
    def centre(self) -> Float[np.ndarray, "2"]:
        """Of the rectangle, m."""
        return np.array([self.x0 + self.x1, self.y0 + self.y1]) / 2

    def grown(self, margin: float) -> "Rect":
        """The same, `margin` m larger on every side."""
        return Rect(self.x0 - margin, self.y0 - margin, self.x1 + margin, self.y1 + margin)

    def contains(self, xy: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
        """Which of the points lie inside."""
        x, y = xy[:, 0], xy[:, 1]
        return (x > self.x0) & (x < self.x1) & (y > self.y0) & (y < self.y1)

    def overlaps(self, other: "Rect") -> bool:
        """Whether the two share area."""
        return (
            self.x0 < other.x1 and other.x0 < self.x1 and self.y0 < other.y1 and other.y0 < self.y1
        )
