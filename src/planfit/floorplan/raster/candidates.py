"""What a picture's walls may be: one mask for each way of drawing them that the picture could show."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

import cv2
import numpy as np

from planfit.floorplan.raster.cells import fill_hatching, find_wall_cells
from planfit.floorplan.raster.line_work import (
    LineWork,
    between_lines,
    closed,
    find_line_work,
    opened,
)
from planfit.floorplan.raster.picture import DARK, Darkness, Mask
from planfit.floorplan.raster.stroke_widths import WallWidth, least_wall_width

Edge = Literal["edge", "stroke", "mask"]

INK = 0.5
"""Darkness from which a pixel is part of a black wall: half way, where the true edge runs."""
_TONE_WIDTH, _DARKER = 0.07, 0.15
"""Around a tone, darkness of the same; an outline is darker by more than this."""
_NEAR_INK = 0.12
"""Walls of a tone as near to `INK` are black in patches, and grey in others where a JPEG made them uneven:
all that is darker than half of it is then looked at, too."""
_BROAD_PX, _NEAR, _PATCHY = 4, 0.07, 0.3
"""Of what is so broad, pixels within so much of `INK`: soft edges of black walls are 0.02 to 0.1 of it."""


class WallStyle(StrEnum):
    """How walls are drawn, in words."""

    BLACK = "solid black"
    BLACK_ALONE = "solid black, nothing else drawn"
    SINGLE_LINES = "single lines"
    GREY = "solid grey"
    OUTLINED = "filled, outlined"
    HATCHED = "hatched"
    LINES = "double lines"
    CLOSED_LINES = "double lines, closed"
    GIVEN = "as given"

    @property
    def is_alone(self) -> bool:
        """Whether nothing else is drawn."""
        return self in (self.BLACK_ALONE, self.SINGLE_LINES)

    @property
    def family(self) -> "WallStyle":
        """Styles that are found in several ways are one."""
        of_several = {self.BLACK_ALONE: self.BLACK, self.CLOSED_LINES: self.LINES}
        return of_several.get(self, self)


@dataclass(frozen=True)
class Candidate:
    """A mask of what may be wall, drawn in one style."""

    style: WallStyle
    mask: Mask
    """1 where there is wall."""
    edge: Edge
    """What a face lies on: the edge of a tone, the middle of an outline's stroke, the mask's own edge."""
    level: float
    """Darkness half way between wall and paper, for edges of a tone."""
    grow_px: float
    """From the mask's edge to the face."""
    least_px: float
    """Walls are no thinner."""
    bars: Mask | None = None
    """1 inside walls so thin that their two lines touch; None where there are none."""
    unsure_px: float = 0.0
    """Thickness of strokes that may be walls or a pen's; 0 where all is sure."""
    hatched_share: float = 0.0
    """Of the inside of the mask, what oblique lines cover as evenly as hatching does."""


def find_candidates(darkness: Darkness) -> list[Candidate]:
    """Candidates as solid walls (black, and each grey tone), as hatched walls, as double lines."""
    lines = (darkness > DARK).astype(np.uint8)
    extent = find_extent(darkness)
    if extent < 30:
        return []
    line_work = find_line_work(lines, max(int(extent / 14), 6))
    line_px = line_work.line_px
    result = [*_black(darkness, extent), *_grey(darkness, line_px, extent)]
    result += _hatched(lines, line_work, extent)
    cells, grow = find_wall_cells(lines, line_px, extent), line_px / 2
    if cells.any():
        inside = closed(cells, 2)
        result.append(Candidate(WallStyle.CLOSED_LINES, inside, "stroke", DARK, grow, 1.0))
    # Where the two lines of a thin wall touch, they are one bar; its lines' middles are half a line in.
    bars = opened(lines, max(round(1.5 * line_px), round(line_px) + 2))
    bars &= 1 - opened(lines, round(2.5 * line_px) + 2)
    bars = cv2.erode(bars, np.ones((int(line_px) | 1,) * 2, np.uint8))
    for strips, thin in between_lines(line_work, bars):
        result.append(Candidate(WallStyle.LINES, strips, "stroke", DARK, grow, 1.0, thin))
    return result


def find_extent(darkness: Darkness) -> float:
    """Larger side (px) of what is drawn; 0 where there is nothing."""
    is_dark = darkness > DARK
    rows, columns = np.flatnonzero(is_dark.any(axis=1)), np.flatnonzero(is_dark.any(axis=0))
    if len(rows) == 0:
        return 0.0
    return float(max(np.ptp(rows), np.ptp(columns)) + 1)


def are_patchy(darkness: Darkness) -> bool:
    """Whether much of what is as broad as walls has nearly the darkness that parts black from paler: grey
    walls, which are black in patches where a JPEG made them uneven."""
    broad = opened((darkness > DARK).astype(np.uint8), _BROAD_PX) > 0
    is_near = np.abs(darkness - INK) < _NEAR
    return bool((broad & is_near).sum() > _PATCHY * max(int(broad.sum()), 1))


def _black(darkness: Darkness, extent: float) -> list[Candidate]:
    ink = (darkness > INK).astype(np.uint8)
    width = least_wall_width(ink, extent)
    if width.least_px == 0 or are_patchy(darkness):
        return []
    return [_solid(WallStyle.BLACK, ink, INK, width)]


def _solid(style: WallStyle, strokes: Mask, level: float, width: WallWidth) -> Candidate:
    mask, least = opened(strokes, width.least_px), float(width.least_px)
    return Candidate(style, mask, "edge", level, 0.0, least, unsure_px=width.unsure_px)


def _grey(darkness: Darkness, line_px: float, extent: float) -> list[Candidate]:
    """One for each tone that covers enough of the picture evenly."""
    smooth = cv2.blur(darkness, (3, 3))
    flat = (
        cv2.dilate(darkness, np.ones((3, 3))) - cv2.erode(darkness, np.ones((3, 3))) < _TONE_WIDTH
    )
    counts, edges = np.histogram(smooth[flat], 50, (0.0, 1.0))
    smooth_counts, middles = np.convolve(counts, [1, 1, 1], "same"), (edges[1:] + edges[:-1]) / 2
    result = []
    for k in range(4, 46):
        before, after = smooth_counts[k - 3 : k], smooth_counts[k + 1 : k + 4]
        if smooth_counts[k] <= before.max() or smooth_counts[k] < after.max():
            continue
        if smooth_counts[k] < 6 * extent:
            continue
        # The mean: a few pixels beside a tone may move the middle of three bins off it.
        tone = float(np.average(middles[k - 1 : k + 2], weights=counts[k - 1 : k + 2]))
        if tone > 0.9:
            continue
        fill = (np.abs(darkness - tone) < _TONE_WIDTH).astype(np.uint8)
        core = opened(fill, 3)
        ring = cv2.dilate(core, np.ones((3, 3), np.uint8)) - core
        beyond = cv2.dilate(core, np.ones((5, 5), np.uint8)) - core
        n_ring = max(int(ring.sum()), 1)
        has_outline = float((darkness[beyond > 0] > tone + _DARKER).sum()) / n_ring > 0.5
        if has_outline:
            # Where the tone is as dark as a line, walls are strokes; their outlines are darker still.
            strokes = (darkness > tone + _DARKER).astype(np.uint8)
            stroke_px = min(line_px, find_line_work(strokes, max(int(extent / 14), 6)).line_px)
            mask = _inside_outlines(darkness, tone, fill, stroke_px)
            result.append(Candidate(WallStyle.OUTLINED, mask, "stroke", DARK, stroke_px / 2, 3.0))
        else:
            near = cv2.dilate(core, np.ones((3, 3), np.uint8))
            mask = ((darkness > tone / 2) & (near > 0)).astype(np.uint8)
            # Texts and lines across a wall are darker than it; the paper between walls is not.
            mask |= closed(mask, 2 * int(line_px) + 3) & (darkness > tone).astype(np.uint8)
            masks = [mask]
            if abs(tone - INK) < _NEAR_INK:
                masks.append((darkness > tone / 2).astype(np.uint8))
            for one in masks:
                width = least_wall_width(one, extent)
                if width.least_px:
                    result.append(_solid(WallStyle.GREY, one, tone / 2, width))
    return result


def _inside_outlines(darkness: Darkness, tone: float, fill: Mask, line_px: float) -> Mask:
    """Mask of a tone up to where the strokes around it begin, without what only passes through
    the tone: the rims of letters and lines.

    `fill` marks pixels of the tone.
    """
    # Half way to the paper and to the stroke: a light tone is nearer to the paper than to the stroke.
    low, high = tone / 2, tone + 0.5 * (min(1.0, tone + 0.5) - tone)
    inner = ((darkness > low) & (darkness < high)).astype(np.uint8)
    # Lines may have the tone, and their rims have it; they are no broader than lines.
    core = opened(fill, max(3, round(line_px) + 1))
    inner[cv2.dilate(core, np.ones((5, 5), np.uint8)) == 0] = 0
    return opened(closed(inner, int(line_px) + 2), 3)  # texts and lines across are filled


def _hatched(lines: Mask, line_work: LineWork, extent: float) -> list[Candidate]:
    """Walls that become solid when gaps as wide as those of the hatching are filled."""
    empty = line_work.empty_strips(lines)
    result, size = [], 3
    while size <= max(extent / 60, 5):
        least = int(max(size, 2 * line_work.line_px)) + 1
        walls = fill_hatching(lines, line_work, empty, size, least)
        result.append(
            Candidate(WallStyle.HATCHED, walls.mask, "stroke", DARK, walls.grow_px, least,
                      hatched_share=walls.share)
        )  # fmt: skip
        size = int(np.ceil(1.8 * size))
    return result
