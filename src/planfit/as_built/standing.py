"""Which pieces of upright surface are wall, where no wall is drawn: not the backs and sides of cupboards.

What is seen higher than cupboards are is wall. What is not may be wall that cameras looked down at: if it is
longer than the side of a cupboard, or, where a wall is drawn as far behind as cupboards are deep, than its
front, and no line of sight passes over it, as some do over most cupboards and none over a wall.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.as_built.lines_of_sight import HEIGHTS_M, LinesOfSight, through_shares
from planfit.floorplan import Floorplan
from planfit.geometry import segments
from planfit.priors import CUPBOARD_HEIGHT_M, STOREY_HEIGHT_M

TOP_QUANTILE = 0.99
"""Of the heights of points, that is the top of a piece: single points fly."""
MAX_OVER_SHARE = 0.1
"""Share of the length of a wall that a line of sight may pass all the same, as poses err. On even seeds of
benchmarks/as_built.py none passes any wall, and 0.14 or more of the cupboards that are seen over at all."""
DEPTH_M = (0.3, 0.8)
"""Of cupboards, from their front to the wall behind."""
MIN_TOP_M = CUPBOARD_HEIGHT_M.value
"""Height over the floor, m, that wall where none is drawn is seen up to, if it is no longer than cupboards
are."""
MAX_CUPBOARD_M = (0.9, 1.6)
"""Length, m, of what may be the side of a cupboard; of what may be its front, a wall being drawn behind."""
CEILING_M = STOREY_HEIGHT_M.high
"""Lines of sight count up to here."""


@dataclass(frozen=True)
class Piece:
    """Upright surface where no wall is drawn."""

    ends: Float[np.ndarray, "2 2"]
    """Plan frame, m."""
    normal: Float[np.ndarray, "2"]
    """Unit, towards the side that it was seen from."""
    patch_idx: Int[np.ndarray, " p"]
    top_m: float
    """Over the floor."""
    has_wall_behind: bool
    """Whether a wall is drawn as far behind it as cupboards are deep."""
    storey: int | None = None
    """Where the plan has storeys."""


def top_of(above_floor_m: Float[np.ndarray, " m"]) -> float:
    """Height of the top of a piece, of its points' heights over the floor; 0 where none is known."""
    known = above_floor_m[np.isfinite(above_floor_m)]
    return float(np.quantile(known, TOP_QUANTILE)) if len(known) else 0.0


def are_walls(pieces: Sequence[Piece], sight: LinesOfSight) -> Bool[np.ndarray, " s"]:
    """Whether each piece is wall."""
    if not pieces:
        return np.zeros(0, dtype=bool)
    storeys = None
    if pieces[0].storey is not None:
        storeys = np.array([piece.storey for piece in pieces])
    ends = np.stack([piece.ends for piece in pieces])
    drawn = Floorplan(
        "pieces of wall",
        ends,
        np.stack([piece.normal for piece in pieces]),
        np.ones(len(pieces), dtype=bool),
        storeys=storeys,
    )
    is_over = through_shares(sight, drawn, (HEIGHTS_M[0], CEILING_M), 1) > MAX_OVER_SHARE
    is_high = np.array([piece.top_m >= MIN_TOP_M for piece in pieces])
    side_m, front_m = MAX_CUPBOARD_M
    most_m = np.where([piece.has_wall_behind for piece in pieces], front_m, side_m)
    return is_high | (~is_over & (segments.lengths(ends) > most_m))
