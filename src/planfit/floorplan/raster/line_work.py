"""Line work in a mask: opening and closing, lines along rows and columns, and the long, narrow, empty strips
between parallel ones, which walls drawn as two lines are."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Int, UInt8

from planfit.floorplan.elements import ELONGATED
from planfit.floorplan.raster.picture import Mask

_HATCHED_SHARE = 0.06
"""Hatching covers at least this share of a strip; what crosses an empty strip covers less."""
LINE_PX = 12
"""Line work along an axis is at least this long; letters and hatching are not."""


def opened(mask: Mask, size: int) -> Mask:
    """Without what is thinner than `size` px."""
    kernel = np.ones((size, size), np.uint8)
    # OpenCV's own opening moves by a pixel where the size is even.
    back = (size - 1 - size // 2, size - 1 - size // 2)
    return cv2.dilate(cv2.erode(mask, kernel), kernel, anchor=back)


def closed(mask: Mask, size: int) -> Mask:
    """With gaps thinner than `size` px filled."""
    reach = size + 1  # the border of the picture is no wall
    padded = cv2.copyMakeBorder(mask, reach, reach, reach, reach, cv2.BORDER_CONSTANT, value=0)
    kernel = np.ones((size, size), np.uint8)
    back = (size - 1 - size // 2, size - 1 - size // 2)
    padded = cv2.erode(cv2.dilate(padded, kernel), kernel, anchor=back)
    return np.ascontiguousarray(padded[reach:-reach, reach:-reach])


def of_labels(labels: Int[np.ndarray, "h w"], is_kept: Bool[np.ndarray, " count"]) -> Mask:
    """1 on the connected parts of a picture that are kept, by their labels; 0 is what is no part."""
    kept = is_kept.astype(np.uint8)
    kept[0] = 0
    return kept[np.asarray(labels, dtype=int)]


@dataclass(frozen=True)
class LineWork:
    """Lines along rows and along columns, and the gaps between them."""

    along: tuple[Mask, Mask]
    """Lines along rows, lines along columns: (h, w) uint8, 1 on a line."""
    strips: tuple[Int[np.ndarray, "h w"], Int[np.ndarray, "h w"]]
    """Strips between lines along rows, along columns: (h, w) int16, width of the strip at each of its pixels,
    else 0."""
    line_px: float
    """Usual width of a line."""

    def empty_strips(self, lines: Mask) -> Mask:
        """(h, w) uint8, 1 in strips that nothing is drawn in, as hatching would be.

        `lines`: everything dark.
        """
        result = np.zeros_like(lines)
        for strip in self.strips:
            count, labels = cv2.connectedComponents((strip > 0).astype(np.uint8), connectivity=4)
            labels = np.asarray(labels, dtype=int)
            n_all = np.bincount(labels.ravel(), minlength=count)
            n_dark = np.bincount(labels[lines > 0], minlength=count)
            result |= of_labels(labels, n_dark < _HATCHED_SHARE * n_all)
        return result


def find_line_work(lines: Mask, widest: int) -> LineWork:
    """Lines in a mask of everything dark, and strips between them up to `widest` px wide."""
    turned = np.ascontiguousarray(lines.T)
    along_rows, along_columns = _along_rows(lines), _along_rows(turned)
    with ThreadPoolExecutor(2) as pool:  # NumPy and OpenCV let go of the interpreter
        strips = list(
            pool.map(lambda along: _strips(_gap_across(along), widest), (along_rows, along_columns))
        )
    line_px = _usual_width(along_rows, along_columns)
    return LineWork(
        (along_rows, np.ascontiguousarray(along_columns.T)),
        (strips[0], np.ascontiguousarray(strips[1].T)),
        line_px,
    )


def _along_rows(lines: Mask) -> Mask:
    """What of a mask belongs to lines along rows, up to a slant of some degrees."""
    thick = cv2.dilate(lines, np.ones((3, 1), np.uint8))
    long = cv2.morphologyEx(thick, cv2.MORPH_OPEN, np.ones((1, LINE_PX), np.uint8))
    return long & lines


def _usual_width(*along: UInt8[np.ndarray, "_ _"]) -> float:
    """Width (px) that the greatest length of lines along rows has."""
    length = np.zeros(14)
    for mask in along:
        area = [float(mask.sum())]
        for size in range(2, 14):
            area.append(float(cv2.erode(mask, np.ones((size, 1), np.uint8)).sum()))
        # Eroding a run of k pixels by s leaves k - s + 1: second differences count the runs.
        runs = np.diff(np.array([*area, 0.0]), 2)
        length[1 : 1 + len(runs)] += np.maximum(runs, 0.0)
    return float(max(np.argmax(length), 1))


def _gap_across(lines: Mask) -> Int[np.ndarray, "h w"]:
    """At each empty pixel, the count of empty pixels between the line above and the line below; 0 on lines
    and where there is no line on one side. int16."""
    h = len(lines)
    rows = np.arange(h, dtype=np.int16)[:, None]
    above = np.maximum.accumulate(np.where(lines > 0, rows, np.int16(-1)), axis=0)
    below = np.minimum.accumulate(np.where(lines > 0, rows, np.int16(h))[::-1], axis=0)[::-1]
    gap = below - above - 1
    gap[(above < 0) | (below >= h) | (lines > 0)] = 0
    return gap


def _strips(gap: Int[np.ndarray, "h w"], widest: int) -> Int[np.ndarray, "h w"]:
    """Width at pixels whose gap stays the same, within a quarter and 1 px, over a long way along rows."""
    found = np.zeros(gap.shape, np.uint8)
    low = 1
    while low <= widest:
        high = min(max(int(1.3 * low), low + 1), widest)
        inside = cv2.inRange(gap, low, high)  # type: ignore[call-overload]
        length = max(int(ELONGATED * high), LINE_PX)
        # Texts and lines that touch a wall break its strip for a pixel or two.
        bridged = cv2.morphologyEx(inside, cv2.MORPH_CLOSE, np.ones((1, 3), np.uint8))
        long = cv2.morphologyEx(bridged, cv2.MORPH_OPEN, np.ones((1, length), np.uint8))
        found |= np.bitwise_and(long, inside)
        low = max(int(1.15 * low), low + 1)
    return np.where(found > 0, gap, np.int16(0))


def between_lines(line_work: LineWork, bars: Mask) -> list[tuple[Mask, Mask]]:
    """The inside of walls drawn as two lines, for each likely range of thickness; empty where there is none.

    `line_work`: lines and the strips between them; `bars`: 1 inside bars as thick as two lines.

    Returns pairs of masks: 1 between the two lines; 1 inside walls so thin that their two lines touch.
    """
    rows, columns = line_work.strips
    # Tiles are between lines along rows and along columns; the corners of walls are in neither strip.
    grid = (rows > 0) & (columns > 0)
    rows, columns = (
        np.where(grid, 0, rows).astype(np.int16),
        np.where(grid, 0, columns).astype(np.int16),
    )
    tiles = np.asarray(cv2.dilate(grid.astype(np.uint8), np.ones((3, 3), np.uint8)), np.uint8)
    thickest = int(2 * line_work.line_px) + 2
    sides = [
        _Strips.between(rows, line_work.along[0], thickest),
        _Strips.between(
            np.ascontiguousarray(columns.T), np.ascontiguousarray(line_work.along[1].T), thickest
        ),
    ]
    alone = np.concatenate([side.width[(side.above == 0) & (side.below == 0)] for side in sides])
    if len(alone) == 0:
        return []
    # Each pixel of a strip stands for one part in its width of a pixel of length.
    length = np.bincount(alone) / np.maximum(np.arange(int(alone.max()) + 1), 1)
    share = np.cumsum(length) / length.sum()
    all_bars = _Bars.find(bars, line_work.line_px)
    result = []
    ranges = set()
    for quantile in (0.45, 0.65, 0.8, 0.9, 0.97):
        limit = int(np.searchsorted(share, quantile)) + 1
        usual = int(np.searchsorted(share, share[min(limit, len(share) - 1)] / 2))
        # Far above the usual width are rooms; the widest walls may yet be rare.
        ranges.add((min(limit, 4 * usual + 4), usual))
    for limit, usual in sorted(ranges):
        least = max(0.2 * usual, 1.0)
        along_rows = sides[0].walls(least, limit, usual)
        along_columns = np.ascontiguousarray(sides[1].walls(least, limit, usual).T)
        seeds = along_rows | along_columns
        narrow = closed(line_work.along[0] | line_work.along[1], limit + 2)
        narrow &= 1 - (line_work.along[0] | line_work.along[1] | tiles)
        junctions = _junctions(along_rows, along_columns, limit)
        mask = np.bitwise_or(_grown(seeds, narrow, limit, usual), junctions)
        if mask.any():
            result.append((mask, all_bars.free(narrow)))
    return result


@dataclass(frozen=True)
class _Strips:
    """Pixels of strips along rows, and the strips that share a line with them."""

    shape: tuple[int, int]
    row: Int[np.ndarray, " n"]
    column: Int[np.ndarray, " n"]
    width: Int[np.ndarray, " n"]
    above: Int[np.ndarray, " n"]
    """Width of the strip beyond the line above; 0 where there is none."""
    below: Int[np.ndarray, " n"]

    @classmethod
    def between(cls, strip: Int[np.ndarray, "h w"], lines: Mask, thickest: int) -> "_Strips":
        row, column = np.nonzero(strip)
        beside = []
        for flip in (False, True):
            ink, width = (lines[::-1], strip[::-1]) if flip else (lines, strip)
            at = len(lines) - 1 - row if flip else row
            # The greatest row so far that is dark, or free: running maxima of the rows' own numbers find
            # for every pixel the line above it, and what is free beyond that line.
            index = np.arange(len(lines), dtype=np.int16)[:, None]
            ink_above = np.maximum.accumulate(np.where(ink > 0, index, np.int16(0)), axis=0)
            free_above = np.maximum.accumulate(np.where(ink == 0, index, np.int16(0)), axis=0)
            line = ink_above[at, column]
            beyond = free_above[line, column]
            beside.append(np.where(line - beyond <= thickest, width[beyond, column], 0))
        return cls(strip.shape, row, column, strip[row, column], beside[0], beside[1])

    def walls(self, least: float, limit: float, usual: float) -> Mask:
        """(h, w) uint8: strips of a range of widths, without those stacked like stairs and windows."""
        n_alike = np.zeros(len(self.width), dtype=int)
        for other in (self.above, self.below):
            in_range = (other >= least) & (other <= limit)
            n_alike += in_range & (other > 0.6 * self.width) & (other < 1.7 * self.width)
        kept = (self.width >= least) & (self.width <= limit)
        kept &= (n_alike == 0) | ((n_alike == 1) & (self.width > 0.75 * usual))
        mask = np.zeros(self.shape, np.uint8)
        mask[self.row[kept], self.column[kept]] = 1
        bridged = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((1, 5), np.uint8))
        return cv2.morphologyEx(bridged, cv2.MORPH_OPEN, np.ones((1, LINE_PX), np.uint8))


def _junctions(along_rows: Mask, along_columns: Mask, limit: int) -> Mask:
    """Where walls meet: strips lengthened by a wall's thickness cross there, and nowhere else."""
    reach = 2 * int(1.5 * limit + 4) + 1
    rows = cv2.dilate(along_rows, np.ones((1, reach), np.uint8))
    columns = cv2.dilate(along_columns, np.ones((reach, 1), np.uint8))
    return np.asarray(rows & columns)  # type: ignore[operator]


def _grown(seeds: Mask, narrow: Mask, limit: int, usual: int) -> Mask:
    """Strips with the corners and the short strips that hang on to them; slits are left out."""
    near = np.asarray(cv2.dilate(seeds, np.ones((2 * limit + 1, 2 * limit + 1), np.uint8)))
    touching = cv2.dilate(seeds, np.ones((3, 3), np.uint8))
    free = narrow & near & (1 - seeds)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(free, connectivity=4)
    is_added = np.zeros(count, dtype=bool)
    is_added[np.unique(labels[touching > 0])] = True
    side = stats[:, 2:4]
    is_added &= (side.max(axis=1) <= 1.5 * limit + 4) & (stats[:, 4] >= 0.3 * usual**2)
    return seeds | of_labels(labels, is_added)


@dataclass(frozen=True)
class _Bars:
    """Bars, and the pixels around them."""

    labels: Int[np.ndarray, "h w"]
    """Number of the bar, 0 outside."""
    near: Int[np.ndarray, " n"]
    """Flat indices of pixels on and beside bars."""
    bar: Int[np.ndarray, " n"]
    """Number of the bar at each."""
    n_beside: Int[np.ndarray, " count"]
    """Pixels beside each."""

    @classmethod
    def find(cls, bars: Mask, line_px: float) -> "_Bars":
        count, labels = cv2.connectedComponents(bars, connectivity=8)
        reach = 2 * int(line_px + 2) + 1
        around = cv2.dilate(labels.astype(np.float32), np.ones((reach, reach))).astype(np.int32)
        near = np.flatnonzero(around)
        bar = around.ravel()[near]
        n_bar = np.bincount(labels.ravel()[near], minlength=count)
        return cls(labels, near, bar, np.bincount(bar, minlength=count) - n_bar)

    def free(self, narrow: Mask) -> Mask:
        """(h, w) uint8: bars with free space at their sides; those in a narrow gap are lines of windows."""
        n_narrow = np.bincount(self.bar, narrow.ravel()[self.near], minlength=len(self.n_beside))
        return of_labels(self.labels, n_narrow < 0.4 * self.n_beside)
