"""A stairwell beside the first room: two flights with a half-landing between, the same on every storey."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from planfit.priors import SLAB_THICKNESS_M, STAIR_WIDTH_M
from planfit.synth.quads import METAL, WHITE, Box, Color, Material, Rect

LANDING_M = 1.6
"""Depth of the landing that the door to the storey is on."""
HALF_LANDING_M = 1.2
FLIGHT_M = STAIR_WIDTH_M.value
GAP_M = 0.1
"""Width of a flight, and between the two."""
N_TREADS, TREAD_M = 8, 0.27
"""Of each flight; the last step up is onto a landing."""
_SLAB_M = SLAB_THICKNESS_M.low


@dataclass(frozen=True)
class Stairs:
    """Where the stairs are, building frame, m. The first flight goes up on the left of the landing."""

    well: Rect
    """The whole stairwell."""
    rise_m: float
    """From storey to storey."""

    @property
    def landing(self) -> Rect:
        """At the height of each storey."""
        return replace(self.well, y1=self.well.y0 + LANDING_M)

    @property
    def steps(self) -> Rect:
        """What is not the landing."""
        return replace(self.well, y0=self.well.y0 + LANDING_M)

    @property
    def foot(self) -> Float[np.ndarray, "2"]:
        """Where one stands to go up."""
        return np.array([self.well.x0 + FLIGHT_M / 2, self.well.y0 + LANDING_M / 2])

    @property
    def head(self) -> Float[np.ndarray, "2"]:
        """Where one arrives from below."""
        return np.array([self.well.x1 - FLIGHT_M / 2, self.well.y0 + LANDING_M / 2])

    @property
    def way_up(self) -> Float[np.ndarray, "8 3"]:
        """Corners of the way from the foot to the head on the storey above, the floor below being 0."""
        near = self.steps.y0
        far = near + N_TREADS * TREAD_M
        turn = far + HALF_LANDING_M / 2
        (x0, y0), (x1, y1) = self.foot, self.head
        half, full = self.rise_m / 2, self.rise_m
        return np.array([(x0, y0, 0), (x0, near, 0), (x0, far, half), (x0, turn, half), (x1, turn, half),
                         (x1, far, half), (x1, near, full), (x1, y1, full)])  # fmt: skip

    def boxes(self) -> list[Box]:
        """Steps and half-landing from a storey to the next, the floor below being 0."""
        riser = self.rise_m / 2 / (N_TREADS + 1)
        near, far = self.steps.y0, self.steps.y0 + N_TREADS * TREAD_M
        boxes = []
        for k in range(N_TREADS):
            top, color = (k + 1) * riser, _COLORS[k % 2]
            y = near + k * TREAD_M
            low = max(0.0, top - riser - _SLAB_M)
            boxes.append(Box((self.well.x0, y, low), (self.well.x0 + FLIGHT_M, y + TREAD_M, top),
                             Material.TILES, color))  # fmt: skip
            y, top = far - (k + 1) * TREAD_M, top + self.rise_m / 2
            boxes.append(Box((self.well.x1 - FLIGHT_M, y, top - riser - _SLAB_M),
                             (self.well.x1, y + TREAD_M, top), Material.TILES, color))  # fmt: skip
        half = self.rise_m / 2
        boxes.append(Box((self.well.x0, far, half - _SLAB_M), (self.well.x1, self.well.y1, half),
                         Material.TILES, METAL))  # fmt: skip
        return boxes


_COLORS: tuple[Color, Color] = (METAL, WHITE)


def make_stairs(x1: float, y0: float, rise_m: float) -> Stairs:
    """Stairs whose well ends at x1 and begins at y0, m, building frame."""
    width = 2 * FLIGHT_M + GAP_M
    depth = LANDING_M + N_TREADS * TREAD_M + HALF_LANDING_M
    return Stairs(Rect(x1 - width, y0, x1, y0 + depth), rise_m)
