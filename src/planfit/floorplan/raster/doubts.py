"""Whether what was read looks like a floorplan: facades, sections, site plans and sketches do not."""

import cv2
import numpy as np
import shapely
from jaxtyping import Float, UInt8

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
_SIDE_PX = 400
_DARK = 0.55
"""Of the brightness of the sheet: walls filled in grey are as dark, but slim."""
_SOLID, _LEAST_SHARE = 0.03, 0.02
"""Thicker than this share of the picture everywhere, and of more than this share of its area; real walls are
0.01 thick."""
_ALONG_RIM = 0.1
"""Share of a side of the picture that is dark where a desk lies along it."""


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


def dark_sides(image_bgr: UInt8[np.ndarray, "h w 3"]) -> int:
    """How many sides of a picture are dark, by regions much thicker than any wall."""
    h, w = image_bgr.shape[:2]
    shrink = max(1.0, max(h, w) / _SIDE_PX)
    size = (max(round(w / shrink), 1), max(round(h / shrink), 1))
    small = cv2.cvtColor(
        cv2.resize(image_bgr, size, interpolation=cv2.INTER_AREA), cv2.COLOR_BGR2GRAY
    )
    sheet = float(np.median(small))
    if sheet < 100:  # a drawing in white on dark
        return 0
    reach = (
        int(_SOLID * max(small.shape)) // 2 * 2 + 1
    )  # odd: an even one would shift what it opens
    dark = (small < _DARK * sheet).astype(np.uint8)
    # Bright around: a wall that the rim cuts is no thicker than what of it is in the picture.
    solid = cv2.morphologyEx(
        cv2.copyMakeBorder(dark, reach, reach, reach, reach, cv2.BORDER_CONSTANT),
        cv2.MORPH_OPEN,
        np.ones((reach, reach), np.uint8),
    )[reach:-reach, reach:-reach]
    if float(solid.mean()) < _LEAST_SHARE:
        return 0
    sides = (solid[0], solid[-1], solid[:, 0], solid[:, -1])
    return sum(float(side.mean()) > _ALONG_RIM for side in sides)


def surroundings_words(image_bgr: UInt8[np.ndarray, "h w 3"]) -> str:
    """A doubt where a picture shows a dark desk around its sheet, else empty."""
    n_sides = dark_sides(image_bgr)
    if n_sides < 2:
        return ""
    return (
        f"the picture is dark along {n_sides} of its sides, as the desk around a photographed sheet is, "
        "whose edge may be read as wall: crop the picture to the sheet"
    )
