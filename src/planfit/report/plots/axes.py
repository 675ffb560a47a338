"""Axes in a drawing: numbers at their rims, a legend above them, and lines and areas in what they measure."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.pipeline.on_plan import frame_runs
from planfit.report.formatting import MINUS
from planfit.report.plots import colors
from planfit.report.plots.drawing import (
    DASHED,
    DOTTED,
    FONT_PT,
    PANEL_PT,
    Box,
    Cells,
    Clicks,
    Drawing,
    Shape,
    Words,
    rgb_of,
    visible_lines,
    width_of,
)

RIGHT_PT, BOTTOM_PT, LEGEND_PT = 10.0, 30.0, 20.0
"""Room around axes: right of them, below them, and for a legend above them."""
TITLE_PT = 22.0
"""Room for a title above the legend."""
_TICK_PT, _BETWEEN_PT = 2.5, 8
_LEVELS = 14
"""Of a density: with none, they fit four bits."""
_COLUMN_PT = 0.5
"""Of a line over many x, the first, last, lowest and highest point within this are drawn."""
_CIRCLE = np.exp(2j * np.pi * np.arange(24) / 24).view(float).reshape(-1, 2)
_SQUARE = 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])

Numbers = Float[np.ndarray, " n"] | Int[np.ndarray, " n"]
Entry = tuple[str, str, Literal["s", "-", "--", ":"]]
"""Of a legend: words, colour, and what stands before them, a square or a line."""
_DASHES = {"-": (), "--": DASHED, ":": DOTTED}


def round_number(at_most: float) -> float:
    """The largest 1, 2 or 5 times a power of ten that is, up to rounding, not above a number."""
    power = 10.0 ** np.floor(np.log10(at_most))
    return float(power * max(k for k in (0.5, 1, 2, 5) if k * power <= at_most * (1 + 1e-9)))


def tick_values(
    low: float, high: float, sign: int = 1, least_step: float = 0.0, n_steps: int = 3
) -> list[tuple[float, str]]:
    """Round numbers in a range, at least `n_steps` but for a larger `least_step`, and how these, or their
    negatives where `sign` is -1, are written."""
    low, high = min(low, high), max(low, high)
    step = max(round_number((high - low) / n_steps), least_step)
    slack = 1e-9  # a rim that is a round number up to rounding has it
    numbers = step * np.arange(np.ceil(low / step - slack), np.floor(high / step + slack) + 1)
    digits = max(0, -int(np.floor(np.log10(step))))
    return [(n, f"{sign * n + 0.0:.{digits}f}".replace("-", MINUS)) for n in numbers.tolist()]


def left_pt(*ranges: tuple[float, float]) -> float:
    """Room left of axes for their name and the numbers of these ranges."""
    widths = [width_of(words) for low_high in ranges for _, words in tick_values(*low_high)]
    return 2 * FONT_PT + 2 * _TICK_PT + max(widths)


def entry_pt(words: str) -> float:
    """Width of an entry of a legend."""
    return 16 + width_of(words) + FONT_PT


@dataclass(frozen=True)
class Axes:
    """A part of a drawing that measures something."""

    drawing: Drawing
    box: Box
    x: tuple[float, float]
    """Values at the left and right rim."""
    y: tuple[float, float]
    """At the lower and upper rim."""

    def at(self, xy: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
        """Where in the drawing values are, pt."""
        box, (x0, x1), (y0, y1) = self.box, self.x, self.y
        share = (np.asarray(xy, dtype=float) - [x0, y1]) / [x1 - x0, y0 - y1]
        return share * box.size + [box.left, box.top]

    def lines(
        self,
        lines: Sequence[Float[np.ndarray, "_ 2"]] | Float[np.ndarray, "f k 2"],
        color: str,
        width_pt: float,
        dash_pt: tuple[float, ...] = (),
        opacity: float = 1.0,
    ) -> None:
        """Draw what of lines is within the axes."""
        moved = self.at(lines) if isinstance(lines, np.ndarray) else [self.at(one) for one in lines]
        self.drawing.items.append(
            Shape(visible_lines(moved, self.box), color, width_pt, dash_pt, opacity=opacity)
        )

    def series(
        self, x: Numbers, y: Numbers, color: str, width_pt: float, dash_pt: tuple[float, ...] = ()
    ) -> None:
        """Draw a line over rising x; it is broken where y is not finite."""
        runs = [slice(first, last + 1) for first, last in frame_runs(np.isfinite(y))]
        self.lines([self._thinned(x[run], y[run]) for run in runs], color, width_pt, dash_pt)

    def upright(
        self, x: Numbers, color: str, width_pt: float, dash_pt: tuple[float, ...] = ()
    ) -> None:
        """Draw lines from the lower to the upper rim."""
        rims = [np.column_stack([x, np.full(len(x), y)]) for y in self.y]
        self.lines(np.stack(rims, axis=1), color, width_pt, dash_pt)

    def band(self, x: Numbers, low: Numbers, high: Numbers, color: str, opacity: float) -> None:
        """Fill between two lines over rising x, where both are finite."""
        box, rings = self.box, []
        for first, last in frame_runs(np.isfinite(low + high)):
            run = slice(first, last + 1)
            upper, lower = (self._thinned(x[run], y[run]) for y in (high, low))
            ring = self.at(np.concatenate([upper, lower[::-1]]))
            rings.append(np.clip(ring, [box.left, box.top], [box.right, box.bottom]))
        self.drawing.items.append(Shape(rings, fill=color, opacity=opacity))

    def spans(self, ranges: Sequence[tuple[float, float]], color: str) -> None:
        """Shade ranges of x."""
        low, high = (np.full(2, v) for v in self.y)
        for ends in ranges:
            self.band(np.array(ends), low, high, color, 0.2)

    def squares(
        self, xy: Float[np.ndarray, "m 2"], color: str, size_pt: float, opacity: float = 1.0
    ) -> None:
        """Mark points."""
        at = np.unique(np.round(2 * self.at(xy)) / 2, axis=0)  # what covers another is drawn once
        squares = list(at[:, None] + size_pt * _SQUARE)
        self.drawing.items.append(Shape(squares, fill=color, opacity=opacity))

    def ring(self, xy: Float[np.ndarray, "2"], color: str) -> None:
        """Mark where something begins."""
        ring = self.at(xy) + 2.2 * _CIRCLE
        self.drawing.items.append(Shape([ring], color, 1.2, fill=colors.PAPER))

    def density(self, xy: Float[np.ndarray, "m 2"], color: str, cell_pt: float) -> None:
        """Draw points as square cells by how many are in each: every point counts, and none hides another."""
        columns, rows = (max(1, round(v / cell_pt)) for v in self.box.size)
        _, cells = self.cells_of(xy, (rows, columns))
        if len(cells) == 0:
            return
        counts = np.bincount(cells, minlength=rows * columns).reshape(rows, columns)
        full = max(float(np.percentile(counts[counts > 0], 90)), 1.0)
        level = np.where(counts, 1 + np.round((_LEVELS - 1) * np.minimum(counts / full, 1)), 0)
        palette = np.zeros((_LEVELS + 1, 4), np.uint8)
        palette[:, :3] = rgb_of(color)
        palette[1:, 3] = 255 * np.linspace(0.35, 1.0, _LEVELS)
        self.drawing.items.append(Cells(level.astype(np.uint8), palette, self.box))

    def cells_of(
        self, xy: Float[np.ndarray, "m 2"], shape: tuple[int, int]
    ) -> tuple[Bool[np.ndarray, " m"], Int[np.ndarray, " k"]]:
        """Which points are within the axes, and the cell of each of these in a grid of rows and columns, row
        by row from the top."""
        box, (rows, columns) = self.box, shape
        share = (self.at(xy) - [box.left, box.top]) / box.size
        inside = np.all((share >= 0) & (share <= 1), axis=1)
        cell = np.minimum((share[inside] * [columns, rows]).astype(int), [columns - 1, rows - 1])
        return inside, cell[:, 1] * columns + cell[:, 0]

    def rim(
        self,
        x_name: str,
        y_name: str,
        is_boxed: bool = True,
        has_numbers: tuple[bool, bool] = (True, True),
        signs: tuple[int, int] = (1, 1),
        least_step: float = 0.0,
        n_steps: int = 3,
    ) -> None:
        """Draw a frame, all around or on two sides, names, and numbers, negated where a sign is -1; there
        are at least `n_steps` of them but for a larger `least_step` along x."""
        box, items = self.box, self.drawing.items
        corners = [(box.left, box.top), (box.left, box.bottom), (box.right, box.bottom)]
        frame = np.array([*corners, (box.right, box.top), corners[0]][: 5 if is_boxed else 3])
        items.append(Shape([frame], colors.LIGHT, 0.8))
        ticks = []
        for value, words in tick_values(*self.x, signs[0], least_step, n_steps):
            x = float(self.at(np.array([value, 0.0]))[0])
            ticks.append(np.array([[x, box.bottom], [x, box.bottom + _TICK_PT]]))
            if has_numbers[0]:
                items.append(Words(words, (x, box.bottom + 12), colors.GREY, "middle"))
        for value, words in tick_values(*self.y, signs[1], n_steps=n_steps):
            y = float(self.at(np.array([0.0, value]))[1])
            ticks.append(np.array([[box.left - _TICK_PT, y], [box.left, y]]))
            if has_numbers[1]:
                items.append(Words(words, (box.left - 2 * _TICK_PT, y + 3), colors.GREY, "end"))
        items.append(Shape(ticks, colors.GREY, 0.6))
        middle = (box.left + box.right) / 2, (box.top + box.bottom) / 2
        if x_name:
            items.append(Words(x_name, (middle[0], box.bottom + 24), colors.GREY, "middle"))
        if y_name:
            at = box.left - left_pt(self.y) + FONT_PT, middle[1]
            items.append(Words(y_name, at, colors.GREY, "middle", is_upright=True))

    def legend(self, entries: Sequence[Entry]) -> None:
        """A row above the axes."""
        left, y = self.box.left + 2, self.box.top - 7
        for words, color, kind in entries:
            if kind == "s":
                mark = Shape([np.array([left + 6, y - 3]) + 5 * _SQUARE], fill=color)
            else:
                line = np.array([[left, y - 3], [left + 12, y - 3]])
                mark = Shape([line], color, 1.3, _DASHES[kind])
            self.drawing.items += [mark, Words(words, (left + 16, y), colors.INK, is_fitted=True)]
            left += entry_pt(words)

    def clicks(self, kind: Literal["frames", "plan"]) -> Clicks:
        """Where the axes lie in their picture, and what they measure; for pressing it."""
        box, width, height = self.box, self.drawing.width_pt, self.drawing.height_pt
        shares = box.left / width, box.top / height, box.right / width, box.bottom / height
        return Clicks(kind, shares, self.x, self.y)

    def _thinned(self, x: Numbers, y: Numbers) -> Float[np.ndarray, "k 2"]:
        """Points of a line over rising x that can be told apart."""
        columns = self.box.size[0] / (self.x[1] - self.x[0]) / _COLUMN_PT
        column = (columns * (x - self.x[0])).astype(int)
        first = np.unique(column, return_index=True)[1]
        last = np.append(first[1:], len(x)) - 1
        by_height = np.lexsort((y, column))
        kept = np.unique(np.concatenate([first, last, by_height[first], by_height[last]]))
        return np.column_stack([x[kept], y[kept]])


def new_chart(
    height_pt: float, x: tuple[float, float], *y: tuple[float, float]
) -> tuple[Drawing, list[Axes]]:
    """A drawing as wide as a panel with charts of these ranges of y over the same x, one below the other, and
    room for a legend above each."""
    drawing = Drawing(PANEL_PT, height_pt)
    each = (height_pt - BOTTOM_PT + _BETWEEN_PT) / len(y)
    axes = []
    for k, low_high in enumerate(y):
        top, bottom = k * each + LEGEND_PT, (k + 1) * each - _BETWEEN_PT
        axes.append(Axes(drawing, Box(left_pt(*y), top, PANEL_PT - RIGHT_PT, bottom), x, low_high))
    return drawing, axes
