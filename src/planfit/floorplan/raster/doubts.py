"""Whether what was read looks like a floorplan at all: facades, sections, site plans and sketches do not."""

import numpy as np
import shapely
from jaxtyping import Float

from planfit.floorplan.plans_on_sheet import MOST_STOREYS
from planfit.floorplan.plausible import (
    CLOSED,
    COMPARE,
    are_closed_rooms,
    closed_shares,
    closed_words,
    sketch_words,
)

_OPEN = 0.05
"""Of the ground within the walls, what is closed in: nothing of a chart of bars."""
_FEW_GROUPS = 3
"""More groups of walls than there are plans on most sheets, none of which has an opening, are houses of a
site plan."""


def find_doubts(
    ends: Float[np.ndarray, "n 2 2"],
    openings: Float[np.ndarray, "k 2 2"],
    walls: tuple[shapely.Polygon, ...],
    n_groups: int,
) -> tuple[str, ...]:
    """What speaks against a floorplan, a sentence each.

    Args:
        ends: faces.
        openings: doors and windows.
        walls: regions.
        n_groups: groups of walls that stand apart from each other on the sheet.
    """
    result = []
    has_openings = len(openings) > 0
    if n_groups > MOST_STOREYS or (n_groups > _FEW_GROUPS and not has_openings):
        result.append(
            f"{n_groups} groups of marks stand apart from each other, as windows of a facade or houses of a "
            f"site plan do: this is probably no floorplan; {COMPARE}"
        )
    shares = closed_shares(walls)
    closed = float(shares.sum())
    if are_closed_rooms(shares) or (closed > CLOSED and not has_openings):
        result.append(closed_words(shares))
    elif closed < _OPEN and not has_openings:
        result.append(
            "no wall has a gap for a door or window, and none closes in a room: this is probably no "
            f"floorplan; {COMPARE}"
        )
    sketch = sketch_words(ends)
    return (*result, sketch) if sketch else tuple(result)
