"""What became of the ink of a picture: how much of it is wall now, and what was left out."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
import shapely
from jaxtyping import Float

from planfit.floorplan.plausible import COMPARE
from planfit.floorplan.raster.interpretation import Interpretation
from planfit.floorplan.raster.line_work import opened
from planfit.floorplan.raster.picture import DARK, Mask
from planfit.floorplan.types import Floorplan
from planfit.floorplan.vector.line_work import longest, outlines
from planfit.geometry import segments

_SOFT_PX = 2
"""Soft edges of strokes reach so far beyond the walls."""
_LONG = 0.03
"""Strokes left out are shown where they reach over this share of the drawing: letters are not."""
_DOUBTFUL_SHARE = 0.35
"""Of the ink, what walls are at least: drawings full of furniture and words have 0.43 and more."""

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

    @property
    def is_little_read(self) -> bool:
        """Whether a floorplan has more."""
        return self.share < _DOUBTFUL_SHARE


def account_for(interpretation: Interpretation, small: Float[np.ndarray, "h w"]) -> InkAccount:
    """Where the ink of a picture went.

    `interpretation`: in pixels of `small`; `small`: darkness that walls were looked for in.
    """
    ink = (small > DARK).astype(np.uint8)
    left = ink & (1 - _near_walls(interpretation, ink.shape))
    share = 1.0 - float(left.sum()) / max(float(ink.sum()), 1.0)
    contours, _ = cv2.findContours(left, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    least = _LONG * max(ink.shape)
    rings = [ring[:, 0] for ring in contours if np.ptp(ring[:, 0], axis=0).max() > least]
    edges = [np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings]
    lines = np.concatenate([np.zeros((0, 2, 2)), *edges]).astype(float)
    return InkAccount(share, stroke_length(left), longest(lines))


def dropped_words(interpretation: Interpretation, shrink: float) -> tuple[str, ...]:
    """What looked like wall but has not its form, in words; `shrink` pixels of the file to one."""
    if not interpretation.dropped:
        return ()
    # The outline goes up one side of a stroke and down the other.
    length = sum(region.length for region in interpretation.dropped) / 2 * shrink
    kind = (
        "specks"
        if interpretation.candidate.style.is_alone
        else "marks of the tone and thickness of walls, but not of their form (letters, arrows, furniture, "
        "frames)"
    )
    return (f"{len(interpretation.dropped)} {kind}, {length:.0f} px long in all",)


def left_out(
    interpretation: Interpretation, ink: InkAccount | None, shrink: float
) -> Float[np.ndarray, "k 2 2"]:
    """Edges of what was dropped, and of longer strokes that were no candidates, px of the upright picture."""
    lines = np.zeros((0, 2, 2)) if ink is None else ink.left_lines
    edges = (np.concatenate([lines, outlines(interpretation.dropped)]) + 0.5) * shrink - 0.5
    return edges[segments.lengths(edges) > 0]


def with_account(
    plan: Floorplan, ink: InkAccount, interpretation: Interpretation, shrink: float
) -> Floorplan:
    """The plan with what became of the picture's ink, and a warning where little of it became wall."""
    source = plan.source
    read = f"{100 * ink.share:.0f} % of the ink is read as wall"
    left_px = round(ink.left_px * shrink)
    words = f"{read}; strokes of {left_px} px in all are not" if left_px else "no ink: all is wall"
    if left_px and not interpretation.candidate.style.is_alone:
        words += " (thinner or paler than walls, or of other form: furniture, words, dimensions)"
    warnings = source.warnings
    if ink.is_little_read:
        warnings += (
            f"only {read}: the picture may be no floorplan, or drawn in a way that planfit does not know; "
            f"{COMPARE}, or give a picture of its walls with --wall-mask",
        )
    source = replace(source, dropped=(words, *source.dropped), warnings=warnings)
    return replace(plan, source=source)


def ink_share(interpretation: Interpretation, ink: Mask) -> float:
    """Share of the ink (1 on everything dark) that lies on walls."""
    return float((ink & _near_walls(interpretation, ink.shape)).sum()) / max(float(ink.sum()), 1.0)


def _near_walls(interpretation: Interpretation, shape: tuple[int, ...]) -> Mask:
    """1 inside the walls, and on the strokes that outline them."""
    near = np.zeros(shape, np.uint8)
    for part in interpretation.parts:
        reach = 2 * (_SOFT_PX + int(np.ceil(max(part.candidate.grow_px, 0.0)))) + 1
        grown = cv2.dilate(_filled(part, shape), np.ones((reach, reach), np.uint8))
        near = np.maximum(near, grown)
    return near


def _filled(interpretation: Interpretation, shape: tuple[int, ...]) -> Mask:
    """1 inside the walls of one style."""
    mask = np.zeros(shape, np.uint8)
    for wall in interpretation.walls:
        rings = map(shapely.get_coordinates, shapely.get_rings(wall))
        rings = [np.round(ring * _SUBPIXEL).astype(np.int32) for ring in rings]
        cv2.fillPoly(mask, rings, (1,), shift=4)
    return mask


def stroke_length(strokes: Mask) -> float:
    """Length of strokes of any width up to a dozen pixels, px: area over width, for each width."""
    areas, total, size = float(strokes.sum()), 0.0, 1
    while areas > 0 and size < 12:
        next_areas = float(opened(strokes, size + 1).sum())
        total += (areas - next_areas) / size
        areas, size = next_areas, size + 1
    return total + areas / size
