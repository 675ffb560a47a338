"""Whether a picture shows more than its sheet: the dark desk that a sheet was photographed on."""

import cv2
import numpy as np
from jaxtyping import UInt8

_SIDE_PX = 400
_DARK = 0.55
"""Of the brightness of the sheet: walls filled in grey are as dark, but slim."""
_SOLID, _LEAST_SHARE = 0.03, 0.02
"""Thicker than this share of the picture everywhere, and of more than this share of its area; real walls are
0.01 thick."""
_ALONG_RIM = 0.1
"""Share of a side of the picture that is dark where a desk lies along it."""


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
