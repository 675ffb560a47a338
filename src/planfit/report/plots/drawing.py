"""Colours, axes and PNG bytes of a Matplotlib figure. No global state of matplotlib is used."""

import io
from dataclasses import dataclass
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
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
