"""Coordinates at the rim of a picture, to read points off it."""

import cv2
import numpy as np
from jaxtyping import Float, UInt8

RIGHT_PX, BOTTOM_PX = 74, 40
_TICK_PX = 6
_STEP_PX = 110
"""Least distance of numbers."""
_INK = (40, 40, 40)


def with_rim(
    canvas: UInt8[np.ndarray, "h w 3"], uv_from_xy: Float[np.ndarray, "3 3"], words: str
) -> UInt8[np.ndarray, "a b 3"]:
    """A picture with numbers below and to its right; what it shows stays at its pixels.

    Args:
        canvas: BGR.
        uv_from_xy: from homogeneous coordinates to pixels of the canvas; its axes are those of the picture,
            either may be turned over.
        words: whose coordinates they are.
    """
    height, width = canvas.shape[:2]
    rim = cv2.copyMakeBorder(
        canvas, 0, BOTTOM_PX, 0, RIGHT_PX, cv2.BORDER_CONSTANT, value=(255,) * 3
    )
    cv2.rectangle(rim, (0, 0), (width, height), (200, 200, 200), 1)
    for at_px, number in _ticks(uv_from_xy[0, 0], uv_from_xy[0, 2], width):
        cv2.line(rim, (at_px, height), (at_px, height + _TICK_PX), _INK, 1)
        _write(rim, number, (at_px - 4 * len(number), height + 20))
    for at_px, number in _ticks(uv_from_xy[1, 1], uv_from_xy[1, 2], height):
        cv2.line(rim, (width, at_px), (width + _TICK_PX, at_px), _INK, 1)
        _write(rim, number, (width + 10, at_px + 5))
    _write(rim, words, (8, height + 35))
    return rim


def _ticks(px_per_unit: float, zero_px: float, length_px: int) -> list[tuple[int, str]]:
    """Pixels and numbers along one side, at multiples of 1, 2 or 5 of a power of ten."""
    if not np.isfinite([px_per_unit, zero_px]).all() or px_per_unit == 0:
        return []
    wanted = _STEP_PX / abs(px_per_unit)
    power = 10.0 ** np.floor(np.log10(wanted))
    step = power * next(k for k in (1, 2, 5, 10) if k * power >= wanted)
    ends = np.sort((np.array([0.0, length_px - 1.0]) - zero_px) / px_per_unit)
    numbers = step * np.arange(np.ceil(ends[0] / step), np.floor(ends[1] / step) + 1)
    # More than six digits would touch each other; a plan so far from its origin is moved to it when read.
    return [(round(zero_px + px_per_unit * n), f"{n + 0.0:.6g}") for n in numbers]


def _write(canvas: np.ndarray, text: str, at: tuple[int, int]) -> None:
    cv2.putText(canvas, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.45, _INK, 1, cv2.LINE_AA)
