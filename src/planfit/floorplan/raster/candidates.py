"""What a picture's walls may be: one mask for each way of drawing them that the picture could show."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from planfit.floorplan.raster.cells import fill_hatching, find_wall_cells
from planfit.floorplan.raster.line_work import LineWork, closed, find_line_work, opened
from planfit.floorplan.raster.strips import between_lines

Edge = Literal["edge", "stroke", "mask"]

INK = 0.5
"""Darkness from which a pixel is part of a black wall: half way, where the true edge runs."""
LINE = 0.3
"""Darkness from which a pixel is part of a line; a thin line covers half of each of two pixels."""
_TONE_WIDTH, _DARKER = 0.07, 0.15
"""Around a tone, darkness of the same; an outline is darker by more than this."""
_NEAR_INK = 0.12
"""Walls of a tone as near to `INK` are black in patches, and grey in others where a JPEG made them uneven:
all that is darker than half of it is then looked at, too."""
_FINE_PX = [3, 5, 7]
_COARSE_SHARE = 1 / 100
"""Least thicknesses that are tried where those of the widths are all larger than this share of the drawing: a
house of 820 px whose partitions of 9 px were its most usual line had 14, one of 840 px with partitions of
8 px had 10."""
_VALLEY = 0.5
"""Widths part two kinds of strokes where the drawing has at most this share of the length it has at the usual
width of either: 0.3 between arcs of 2 px and partitions of 5 px, with leaves of doors of 4 px."""


class WallStyle(StrEnum):
    """How walls are drawn, in words."""

    BLACK = "solid black"
    BLACK_ALONE = "solid black, nothing else drawn"
    GREY = "solid grey"
    OUTLINED = "filled, outlined"
    HATCHED = "hatched"
    LINES = "double lines"
    CLOSED_LINES = "double lines, closed"
    GIVEN = "as given"

    @property
    def family(self) -> "WallStyle":
        """Styles that are found in several ways are one."""
        of_several = {self.BLACK_ALONE: self.BLACK, self.CLOSED_LINES: self.LINES}
        return of_several.get(self, self)


@dataclass(frozen=True)
class Candidate:
    """A mask of what may be wall, drawn in one style."""

    style: WallStyle
    mask: UInt8[np.ndarray, "h w"]
    """1 where there is wall."""
    edge: Edge
    """What a face lies on: the edge of a tone, the middle of an outline's stroke, the mask's own edge."""
    level: float
    """Darkness half way between wall and paper, for edges of a tone."""
    grow_px: float
    """From the mask's edge to the face."""
    least_px: float
    """Walls are no thinner."""
    bars: UInt8[np.ndarray, "h w"] | None = None
    """1 inside walls so thin that their two lines touch; None where there are none."""
    hatched_share: float = 0.0
    """Of the inside of the mask, what oblique lines cover as evenly as hatching does."""


def find_candidates(darkness: Float[np.ndarray, "h w"]) -> list[Candidate]:
    """Candidates as solid walls (black, and each grey tone), as hatched walls, as double lines."""
    lines = (darkness > LINE).astype(np.uint8)
    extent = _extent(lines)
    if extent < 30:
        return []
    line_work = find_line_work(lines, max(int(extent / 14), 6))
    line_px = line_work.line_px
    result = [*_black(darkness, line_px, extent), *_grey(darkness, line_px, extent)]
    result += _hatched(lines, line_work, extent)
    cells = find_wall_cells(lines, line_px, extent)
    if cells.any():
        grow = line_px / 2
        result.append(
            Candidate(WallStyle.CLOSED_LINES, closed(cells, 2), "stroke", LINE, grow, 1.0)
        )
    # Where the two lines of a thin wall touch, they are one bar; its lines' middles are half a line in.
    bars = opened(lines, max(round(1.5 * line_px), round(line_px) + 2))
    bars &= 1 - opened(lines, round(2.5 * line_px) + 2)
    bars = cv2.erode(bars, np.ones((int(line_px) | 1,) * 2, np.uint8))
    for inside in between_lines(line_work, bars):
        grow = line_px / 2
        result.append(
            Candidate(WallStyle.LINES, inside.strips, "stroke", LINE, grow, 1.0, inside.bars)
        )
    return result


def find_extent(darkness: Float[np.ndarray, "h w"]) -> float:
    """Larger side (px) of what is drawn; 0 where there is nothing."""
    return _extent((darkness > LINE).astype(np.uint8))


def _extent(lines: UInt8[np.ndarray, "h w"]) -> float:
    rows, columns = np.flatnonzero(lines.any(axis=1)), np.flatnonzero(lines.any(axis=0))
    if len(rows) == 0:
        return 0.0
    return float(max(np.ptp(rows), np.ptp(columns)) + 1)


def _length_by_width(mask: UInt8[np.ndarray, "h w"], largest: int) -> Float[np.ndarray, " widths"]:
    """Length (largest + 1,) of what is 0, 1, 2 ... px thick in a mask."""
    areas = [float(mask.sum())]
    for size in range(2, largest + 2):
        areas.append(float(opened(mask, size).sum()))
        if areas[-1] == 0:
            break
    areas += [0.0] * (largest + 1 - len(areas))
    lost = -np.diff(areas)
    return np.concatenate([[0.0], lost / np.arange(1, len(lost) + 1)])


def _largest_width(extent: float) -> int:
    """Thickest wall (px) in a drawing of some size."""
    return int(min(max(extent / 12, 8), 60))


def _least_widths(mask: UInt8[np.ndarray, "h w"], line_px: float, extent: float) -> list[int]:
    """Widths that may part lines from walls: just above the usual line, and past each gap between two kinds
    of strokes. Where lines are few, the usual one is a partition, and no multiple of it parts the two."""
    length = _length_by_width(mask, _largest_width(extent))
    return sorted({round(1.3 * line_px) + 1, *_valleys(length)})


def _valleys(length: Float[np.ndarray, " widths"]) -> list[int]:
    """Least width above each gap between two kinds of strokes: past the emptiest one."""
    below = np.maximum.accumulate(length)
    above = np.maximum.accumulate(length[::-1])[::-1]
    is_empty = (length <= _VALLEY * np.minimum(below, above)) & (above > 0) & (below > 0)
    label = np.cumsum(np.diff(is_empty, prepend=False))
    gaps = [np.flatnonzero(is_empty & (label == k)) for k in np.unique(label[is_empty])]
    return [int(gap[np.argmin(length[gap])]) + 1 for gap in gaps]


def _black(darkness: Float[np.ndarray, "h w"], line_px: float, extent: float) -> list[Candidate]:
    ink = (darkness > INK).astype(np.uint8)
    widths = _least_widths(ink, line_px, extent)
    if min(widths) > _COARSE_SHARE * extent:
        # Where lines are pale, the usual width is that of partitions, and all of them would be left out.
        widths += _FINE_PX
    return [
        Candidate(WallStyle.BLACK, opened(ink, size), "edge", INK, 0.0, size)
        for size in sorted(set(widths))
    ]


def _grey(darkness: Float[np.ndarray, "h w"], line_px: float, extent: float) -> list[Candidate]:
    """One for each tone that covers enough of the picture evenly."""
    smooth = cv2.blur(darkness, (3, 3))
    flat = cv2.dilate(darkness, np.ones((3, 3))) - cv2.erode(darkness, np.ones((3, 3))) < 0.08
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
            result.append(Candidate(WallStyle.OUTLINED, mask, "stroke", LINE, stroke_px / 2, 3.0))
        else:
            near = cv2.dilate(core, np.ones((3, 3), np.uint8))
            mask = ((darkness > tone / 2) & (near > 0)).astype(np.uint8)
            # Texts and lines across a wall are darker than it; the paper between walls is not.
            mask |= closed(mask, 2 * int(line_px) + 3) & (darkness > tone).astype(np.uint8)
            masks = [mask]
            if abs(tone - INK) < _NEAR_INK:
                masks.append((darkness > tone / 2).astype(np.uint8))
            for one in masks:
                for size in _least_widths(one, line_px, extent)[:3]:
                    result.append(
                        Candidate(WallStyle.GREY, opened(one, size), "edge", tone / 2, 0.0, size)
                    )
    return result


def _inside_outlines(
    darkness: Float[np.ndarray, "h w"], tone: float, fill: UInt8[np.ndarray, "h w"], line_px: float
) -> UInt8[np.ndarray, "h w"]:
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


def _hatched(
    lines: UInt8[np.ndarray, "h w"], line_work: LineWork, extent: float
) -> list[Candidate]:
    """Walls that become solid when gaps as wide as those of the hatching are filled."""
    empty = line_work.empty_strips(lines)
    result, size = [], 3
    while size <= max(extent / 60, 5):
        least = int(max(size, 2 * line_work.line_px)) + 1
        walls = fill_hatching(lines, line_work, empty, size, least)
        result.append(
            Candidate(WallStyle.HATCHED, walls.mask, "stroke", LINE, walls.grow_px, least,
                      hatched_share=walls.share)
        )  # fmt: skip
        size = int(np.ceil(1.8 * size))
    return result
