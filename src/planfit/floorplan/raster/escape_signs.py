"""Signs, ways and panels of escape plans (ISO 23601): in safety colours over a plan drawn in greys."""

import cv2
import numpy as np
from jaxtyping import Bool, UInt8

SIGN_WORDS = (
    "safety colours were left out, as of signs, ways and panels of an escape plan: walls under them may "
    "be missing"
)
COLOURFUL = 80
"""Of 255, what the brightest channel is above the darkest in safety colours (ISO 3864-4), also where they are
printed pale; greys and walls tinted a little have less."""
LEAST_GREEN, LEAST_RED = 0.1, 0.02
"""Of what is not paper: signs and ways in green, signs of extinguishers in red. Escape plans have both."""
PAPER = 0.4
"""Of a picture, what is white at least: a photograph is not."""
_EDGE_PX = 5
"""Between a colour and what is beside it, pixels are of both, more in JPEG."""


def without_signs(
    image_bgr: UInt8[np.ndarray, "h w 3"],
) -> tuple[UInt8[np.ndarray, "h w 3"], bool]:
    """The picture with what is in safety colours as white paper, where it has those of an escape plan; and
    whether it has."""
    colour = _colourful(image_bgr)
    strongest = image_bgr.argmax(axis=2)
    green, red = (float((colour & (strongest == channel)).mean()) for channel in (1, 2))
    paper = float((image_bgr.min(axis=2) > 255 - COLOURFUL // 2).mean())
    ink = 1.0 - paper
    if green < LEAST_GREEN * ink or red < LEAST_RED * ink or paper < PAPER:
        return image_bgr, False
    kernel = np.ones((_EDGE_PX, _EDGE_PX), np.uint8)
    cleared = image_bgr.copy()
    cleared[cv2.dilate(colour.astype(np.uint8), kernel) > 0] = 255
    return cleared, True


def _colourful(image_bgr: UInt8[np.ndarray, "h w 3"]) -> Bool[np.ndarray, "h w"]:
    return image_bgr.max(axis=2) - image_bgr.min(axis=2) > COLOURFUL
