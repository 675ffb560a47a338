"""What became of the ink of a picture: how much of it is wall now, and what was left out."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from planfit.floorplan.raster.candidates import LINE
from planfit.floorplan.raster.interpretation import Interpretation
from planfit.floorplan.raster.line_work import opened

_SOFT_PX = 2
"""Soft edges of strokes reach so far beyond the walls."""
_LONG = 0.03
"""Strokes left out are shown where they reach over this share of the drawing: letters are not."""
_MOST_SHOWN = 3_000
_SUBPIXEL = 16


@dataclass(frozen=True)
class InkAccount:
    """Where the ink went."""

    share: float
    """Of the ink, what lies on walls."""
    left_px: float
    """Length of the strokes that were left out."""
    left_lines: Float[np.ndarray, "k 2 2"]
    """Outlines of the longer ones among them, px."""


def account_for(interpretation: Interpretation, small: Float[np.ndarray, "h w"]) -> InkAccount:
    """Where the ink of a picture went.

    Args:
        interpretation: in pixels of `small`.
        small: darkness that walls were looked for in.
    """
    ink = (small > LINE).astype(np.uint8)
    left = ink & (1 - _near_walls(interpretation, ink.shape))
    share = 1.0 - float(left.sum()) / max(float(ink.sum()), 1.0)
    contours, _ = cv2.findContours(left, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    least = _LONG * max(ink.shape)
    rings = [ring[:, 0] for ring in contours if np.ptp(ring[:, 0], axis=0).max() > least]
    edges = [np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings]
    lines = np.concatenate([np.zeros((0, 2, 2)), *edges]).astype(float)
    longest = np.argsort(-np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1))[:_MOST_SHOWN]
    return InkAccount(share, _stroke_length(left), lines[longest])


def ink_share(interpretation: Interpretation, ink: UInt8[np.ndarray, "h w"]) -> float:
    """Share of the ink (1 on everything dark) that lies on walls."""
    return float((ink & _near_walls(interpretation, ink.shape)).sum()) / max(float(ink.sum()), 1.0)


def _near_walls(interpretation: Interpretation, shape: tuple[int, ...]) -> UInt8[np.ndarray, "h w"]:
    """1 inside the walls, and on the strokes that outline them."""
    reach = 2 * (_SOFT_PX + int(np.ceil(max(interpretation.candidate.grow_px, 0.0)))) + 1
    return np.asarray(cv2.dilate(_filled(interpretation, shape), np.ones((reach, reach), np.uint8)))


def _filled(interpretation: Interpretation, shape: tuple[int, ...]) -> UInt8[np.ndarray, "h w"]:
    """1 inside the walls."""
    mask = np.zeros(shape, np.uint8)
    for wall in interpretation.walls:
        rings = [
            np.round(np.asarray(ring.coords) * _SUBPIXEL).astype(np.int32)
            for ring in (wall.exterior, *wall.interiors)
        ]
        cv2.fillPoly(mask, rings, (1,), shift=4)
    return mask


def _stroke_length(strokes: UInt8[np.ndarray, "h w"]) -> float:
    """Length of strokes of any width up to a dozen pixels, px: area over width, for each width."""
    areas, total, size = float(strokes.sum()), 0.0, 1
    while areas > 0 and size < 12:
        next_areas = float(opened(strokes, size + 1).sum())
        total += (areas - next_areas) / size
        areas, size = next_areas, size + 1
    return total + areas / size
