"""Line work in a mask: opening and closing, lines along rows and columns, and the strips between them."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Int, UInt8

from planfit.floorplan.columns import ELONGATED

_HATCHED_SHARE = 0.06
"""Hatching covers at least this share of a strip; what crosses an empty strip covers less."""
LINE_PX = 12
"""Line work along an axis is at least this long; letters and hatching are not."""


def opened(mask: UInt8[np.ndarray, "h w"], size: int) -> UInt8[np.ndarray, "h w"]:
    """Without what is thinner than `size` px."""
    kernel = np.ones((size, size), np.uint8)
    # OpenCV's own opening moves by a pixel where the size is even.
    back = (size - 1 - size // 2, size - 1 - size // 2)
    return cv2.dilate(cv2.erode(mask, kernel), kernel, anchor=back)


def closed(mask: UInt8[np.ndarray, "h w"], size: int) -> UInt8[np.ndarray, "h w"]:
    """With gaps thinner than `size` px filled."""
    reach = size + 1  # the border of the picture is no wall
    padded = cv2.copyMakeBorder(mask, reach, reach, reach, reach, cv2.BORDER_CONSTANT, value=0)
    kernel = np.ones((size, size), np.uint8)
    back = (size - 1 - size // 2, size - 1 - size // 2)
    padded = cv2.erode(cv2.dilate(padded, kernel), kernel, anchor=back)
    return np.ascontiguousarray(padded[reach:-reach, reach:-reach])


@dataclass(frozen=True)
class LineWork:
    """Lines along rows and along columns, and the gaps between them."""

    along: tuple[UInt8[np.ndarray, "h w"], UInt8[np.ndarray, "h w"]]
    """Lines along rows, lines along columns: (h, w) uint8, 1 on a line."""
    strips: tuple[Int[np.ndarray, "h w"], Int[np.ndarray, "h w"]]
    """Strips between lines along rows, along columns: (h, w) int16, width of the strip at each of its pixels,
    else 0."""
    line_px: float
    """Usual width of a line."""

    def empty_strips(self, lines: UInt8[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w"]:
        """(h, w) uint8, 1 in strips that nothing is drawn in, as hatching would be.

        `lines`: everything dark.
        """
        result = np.zeros_like(lines)
        for strip in self.strips:
            count, labels = cv2.connectedComponents((strip > 0).astype(np.uint8), connectivity=4)
            labels = np.asarray(labels, dtype=int)
            n_all = np.bincount(labels.ravel(), minlength=count)
            n_dark = np.bincount(labels[lines > 0], minlength=count)
            is_empty = n_dark < _HATCHED_SHARE * n_all
            is_empty[0] = False
            result |= is_empty.astype(np.uint8)[labels]
        return result


def find_line_work(lines: UInt8[np.ndarray, "h w"], widest: int) -> LineWork:
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


def _along_rows(lines: UInt8[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w"]:
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


def _gap_across(lines: UInt8[np.ndarray, "h w"]) -> Int[np.ndarray, "h w"]:
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
