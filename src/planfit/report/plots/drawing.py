"""Colours, axes and PNG bytes of a Matplotlib figure. No global state of matplotlib is used."""

import io
from dataclasses import dataclass
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from PIL import Image

# Okabe and Ito's palette, which colour-blind readers can tell apart.
BEFORE, AFTER = "#d55e00", "#0072b2"
AGREES, DISPLACED, UNMATCHED, NOT_SEEN = "#009e73", "#aa3377", "#e69f00", "#b8c0c9"
INK, GREY, LIGHT = "#1f2933", "#6b7785", "#d5dae0"
PATH = "#7b3fa0"
PATHS = (PATH, "#009e73", "#b8860b", "#cc3399", "#56b4e9", "#8c510a")
"""Of several scans, one after the other."""

PANEL_IN = 4.6
"""Width of a picture: half the page on a screen, the whole of it on a phone."""
FONT_PT = 8.5
DPI = 200
LEFT_IN, RIGHT_IN, BOTTOM_IN, LEGEND_IN = 0.5, 0.08, 0.42, 0.28
"""Room around axes: left of them, right of them, below them, and for a legend above them."""
_CHART_LEFT_IN, _CHART_IN = 0.55, PANEL_IN - 0.75
"""Where the axes of a chart begin, and their width."""

Entry = tuple[str, str, Literal["s", "-", "--", ":"]]
"""Of a legend: words, colour, and what stands before them, a square or a line."""


Side = Literal["before", "after"]
"""Of the refinement."""


@dataclass(frozen=True)
class Clicks:
    """What is where in a picture, so that pressing it can choose a frame or a wall."""

    kind: Literal["frames", "plan", "walls"]
    """frames: x is the number of a frame; plan, walls: x and y are in the plan frame, m, and what is
    pressed is the nearest frame, or wall."""
    box: tuple[float, float, float, float]
    """The axes as shares of the picture from its upper left: left, top, right, bottom."""
    x: tuple[float, float]
    """Values at the left and right rim of the axes."""
    y: tuple[float, float]
    """At the lower and upper rim."""
    side: Side = "after"
    """Where the frames are that are looked for."""


@dataclass(frozen=True)
class Picture:
    """A PNG and its size."""

    png: bytes
    width_px: int
    height_px: int
    clicks: Clicks | None = None
    """None where nothing can be pressed."""


def new_figure(width_in: float, height_in: float) -> Figure:
    """A white figure that belongs to no window system."""
    figure = Figure(figsize=(width_in, height_in), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def add_axes(
    figure: Figure, left_in: float, bottom_in: float, width_in: float, height_in: float
) -> Axes:
    """Axes at a position in inches, quiet frame and small labels."""
    width, height = figure.get_size_inches()
    axes = figure.add_axes(
        (left_in / width, bottom_in / height, width_in / width, height_in / height)
    )
    axes.tick_params(labelsize=FONT_PT, colors=GREY, length=2.5, width=0.6, pad=2)
    for spine in axes.spines.values():
        spine.set(color=LIGHT, linewidth=0.8)
    return axes


def label_axes(axes: Axes, x: str, y: str) -> None:
    """Small grey axis titles."""
    axes.set_xlabel(x, fontsize=FONT_PT, color=GREY, labelpad=2)
    axes.set_ylabel(y, fontsize=FONT_PT, color=GREY, labelpad=3)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def new_chart(height_in: float, left_in: float = _CHART_LEFT_IN) -> tuple[Figure, Axes]:
    """A figure as wide as a panel that holds one chart, with room for a legend above it."""
    figure = new_figure(PANEL_IN, height_in)
    return figure, add_axes(
        figure, left_in, BOTTOM_IN, _CHART_IN, height_in - BOTTOM_IN - LEGEND_IN
    )


def new_frame_charts(n_frames: int) -> tuple[Figure, Axes, Axes]:
    """A figure with two charts over the same frames, the second one, which has the numbers, below the first;
    a legend fits above each."""
    figure = new_figure(PANEL_IN, 3.6)
    height = (3.6 - BOTTOM_IN - 2 * LEGEND_IN - 0.12) / 2
    above_in = BOTTOM_IN + height + LEGEND_IN + 0.12
    upper = add_axes(figure, _CHART_LEFT_IN, above_in, _CHART_IN, height)
    lower = add_axes(figure, _CHART_LEFT_IN, BOTTOM_IN, _CHART_IN, height)
    for axes in (upper, lower):
        axes.axhline(0.0, color=LIGHT, linewidth=0.8, zorder=1)
        axes.set_xlim(0, max(n_frames - 1, 1))
    upper.tick_params(labelbottom=False)
    number_frames(lower, n_frames - 1)
    return figure, upper, lower


def number_frames(axes: Axes, last_frame: int) -> None:
    """An x axis of frames, from the first to the last."""
    axes.set_xlim(0, max(last_frame, 1))
    axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))


def add_legend(axes: Axes, entries: list[Entry]) -> None:
    """A row above the axes."""
    handles = [
        Line2D(
            [],
            [],
            color=color,
            marker="s" if kind == "s" else "",
            linestyle="none" if kind == "s" else kind,
            markersize=5,
            linewidth=1.3,
            label=words,
        )
        for words, color, kind in entries
    ]
    axes.legend(
        handles=handles,
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        borderaxespad=0.15,
        borderpad=0.2,
        ncols=len(handles),
        frameon=False,
        fontsize=FONT_PT,
        labelcolor=INK,
        handlelength=1.5,
        handletextpad=0.4,
        columnspacing=1.0,
    )


def clicks_of(kind: Literal["frames", "plan", "walls"], axes: Axes) -> Clicks:
    """Where axes that are set up lie in their picture, and what they measure; for pressing it."""
    axes.apply_aspect()
    left, bottom, right, top = (float(v) for v in axes.get_position().extents)
    return Clicks(kind, (left, 1.0 - top, right, 1.0 - bottom), axes.get_xlim(), axes.get_ylim())


def to_picture(figure: Figure, clicks: Clicks | None = None) -> Picture:
    """Render."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    image = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    buffer = io.BytesIO()
    image.save(buffer, "PNG", compress_level=6)
    return Picture(buffer.getvalue(), image.width, image.height, clicks)
