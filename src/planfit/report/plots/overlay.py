"""Wall points over the plan, before and after: the whole scan, and where both differ most."""

from io import BytesIO
from textwrap import shorten

import numpy as np
from matplotlib.axes import Axes
from PIL import Image

from planfit.evaluation import NEAR_FACE_M
from planfit.floorplan import Floorplan
from planfit.pipeline.result import RefineResult
from planfit.report import formatting
from planfit.report.measures import BeforeAfter, Measures, measure, measure_storeys
from planfit.report.plots.drawing import (
    AFTER,
    BEFORE,
    BOTTOM_IN,
    FONT_PT,
    INK,
    LEFT_IN,
    LEGEND_IN,
    PANEL_IN,
    PATH,
    PATHS,
    RIGHT_IN,
    Entry,
    Picture,
    add_axes,
    add_legend,
    clicks_of,
    new_figure,
    to_picture,
)
from planfit.report.plots.top_view import (
    Crop,
    Mark,
    crop_to_scan,
    draw_faces,
    draw_mark,
    draw_paths,
    draw_points,
    draw_scale,
    set_up_view,
    view_figure,
)

_TITLE_IN = 0.3
WIDE_IN = 1.9 * PANEL_IN
"""Width of a picture that takes the whole page."""
_WIDE = 0.55
"""A scan with less height per width than this is drawn over the whole page."""


SIZE_M = 8.0
"""Side of the window of a close-up."""
_MIN_DIFFERENCE_M = 0.02
_MIN_POINTS = 50
_CELLS = 8
"""Cells a window has each way."""
_NAMED_PATHS, _NAME_LENGTH = 3, 16
"""Paths of several scans that a legend names, and how long a name may be there."""


def is_wide(crop: Crop) -> bool:
    """Whether before and after belong one above the other."""
    return crop.height_per_width < _WIDE


def draw_overlay(floorplan: Floorplan | None, both: BeforeAfter) -> bytes:
    """PNG: the scan's wall points over the plan's faces, before and after, cropped to the scan.

    Args:
        floorplan: plan frame, m.
        both: of `measure` with that plan.
    """
    return _before_and_after(floorplan, both, crop_to_scan(both))


def draw_overlays(result: RefineResult, both: BeforeAfter | None = None) -> dict[str, bytes]:
    """The overlay as `draw_overlay` draws it, by the name of its file; one a storey where each has a plan.
    `both` is what `measure` gives of the result, where that is at hand."""
    both = both or measure(result.floorplan, result)
    if result.storeys is None:
        return {"overlay.png": draw_overlay(result.floorplan, both)}
    crop = crop_to_scan(both)
    return {
        f"overlay_{each.number}.png": _before_and_after(each.floorplan, each.both, crop)
        for each in measure_storeys(result)
    }


def plot_result(result: RefineResult) -> Image.Image:
    """The overlay as a picture that notebooks show; of several storeys one above the other. What
    `RefineResult.plot` calls."""
    pages = [Image.open(BytesIO(png)) for png in draw_overlays(result).values()]
    sheet = Image.new("RGB", (max(p.width for p in pages), sum(p.height for p in pages)), "white")
    top = 0
    for page in pages:
        sheet.paste(page, (0, top))
        top += page.height
    return sheet


def _before_and_after(floorplan: Floorplan | None, both: BeforeAfter, crop: Crop) -> bytes:
    columns, rows = (1, 2) if is_wide(crop) else (2, 1)
    width = WIDE_IN if is_wide(crop) else 1.3 * PANEL_IN
    axes_width = width - LEFT_IN - RIGHT_IN
    axes_height = axes_width * crop.height_per_width
    height = BOTTOM_IN + axes_height + LEGEND_IN + _TITLE_IN
    figure = new_figure(width * columns, height * rows)
    for k, side in enumerate((both.before, both.after)):
        left, bottom = width * (k % columns), height * (rows - 1 - k // columns)
        axes = add_axes(figure, left + LEFT_IN, bottom + BOTTOM_IN, axes_width, axes_height)
        set_up_view(axes, crop, both.is_aligned)
        draw_side(axes, floorplan, both, side, crop)
        axes.text(
            0.0,
            1.0 + (LEGEND_IN + 0.06) / axes_height,
            f"{'after' if k else 'before'}: {fit_in_words(both, side)}",
            transform=axes.transAxes,
            fontsize=FONT_PT,
            fontweight="bold",
            color=AFTER if k else BEFORE,
            va="bottom",
        )
    return to_picture(figure).png


def fit_in_words(both: BeforeAfter, side: Measures) -> str:
    """The numbers that matter of one side."""
    if not both.has_plan:
        return "what was seen at camera height"
    if not both.is_aligned:
        return "not aligned with the plan"
    if side.walls is None:
        return "no wall was seen"
    return (
        f"{formatting.share(side.walls.near_share)} of wall points within {NEAR_FACE_M:.2f}"
        f"{formatting.SPACE}m of the plan, NSD {formatting.length(side.walls.nsd_m)}"
    )


def side_picture(
    floorplan: Floorplan | None,
    both: BeforeAfter,
    side: Measures,
    crop: Crop,
    marks: tuple[Mark, ...] = (),
    width_in: float = PANEL_IN,
) -> Picture:
    """One side alone, for a page that puts its own words beside it."""
    figure, axes = view_figure(crop, width_in, LEGEND_IN, both.is_aligned)
    draw_side(axes, floorplan, both, side, crop)
    for mark in marks:
        draw_mark(axes, mark)
    return to_picture(figure, clicks_of("plan", axes))


def draw_side(
    axes: Axes, floorplan: Floorplan | None, both: BeforeAfter, side: Measures, crop: Crop
) -> None:
    """Wall points, plan, path, scale and legend of one side, on axes of the crop's shape."""
    is_after = side is both.after
    color = AFTER if is_after else BEFORE
    draw_points(axes, crop, side.wall_xy, color)
    entries: list[Entry] = []
    if len(side.wall_xy):
        points = "wall points" if both.has_plan else "scan"
        entries.append((f"{points} {'after' if is_after else 'before'}", color, "s"))
    if floorplan is not None and both.is_aligned:
        draw_faces(axes, crop, floorplan.ends)
        entries.append(("plan", INK, "-"))
    draw_paths(axes, side.trajectory[:, :2], both.scans)
    if both.scans:
        # The table of the scans has all of them, in the same colours.
        for own, color in zip(both.scans[:_NAMED_PATHS], PATHS, strict=False):
            entries.append((shorten(own.name, _NAME_LENGTH, placeholder="…"), color, "-"))
    else:
        entries.append(("camera path (ring: start)", PATH, "-"))
    draw_scale(axes, crop)
    add_legend(axes, entries)


def choose_close_ups(both: BeforeAfter, crop: Crop, max_count: int = 3) -> tuple[Mark, ...]:
    """Square windows that do not overlap, the greatest change of distance to the plan first.

    None where the scan is so small that its overview shows everything.
    """
    if not both.has_walls or crop.size.max() < 2 * SIZE_M:
        return ()
    # Far strays would outweigh whole walls.
    before, after = (np.minimum(s.wall_distances_m, 1.0) for s in (both.before, both.after))
    inside = crop.contains(both.after.wall_xy)
    xy, difference = both.after.wall_xy[inside], np.abs(before - after)[inside]
    cell_m = SIZE_M / _CELLS
    shape = np.maximum(np.ceil(crop.size / cell_m).astype(int), _CELLS)
    at = np.minimum(((xy - crop.low) / cell_m).astype(int), shape - 1)
    flat, n_cells = at[:, 1] * shape[0] + at[:, 0], int(shape.prod())
    sums = np.bincount(flat, difference, n_cells).reshape(shape[1], shape[0])
    counts = np.bincount(flat, minlength=n_cells).reshape(shape[1], shape[0])
    # Points near the middle of a window weigh more, so that what matters is centred.
    centred = np.outer(*[np.hanning(_CELLS + 2)[1:-1]] * 2)
    score, sums, counts = (
        _in_windows(sums, centred),
        _in_windows(sums, np.ones_like(centred)),
        _in_windows(counts, np.ones_like(centred)),
    )
    score[(counts < _MIN_POINTS) | (sums < _MIN_DIFFERENCE_M * counts)] = -1.0
    marks: list[Mark] = []
    for letter in "ABCDEFGH"[:max_count]:
        row, column = np.unravel_index(int(np.argmax(score)), score.shape)
        if score[row, column] <= 0:
            break
        low = crop.low + cell_m * np.array([column, row])
        marks.append(Mark(letter, Crop(low, low + SIZE_M)))
        score[
            max(row - _CELLS + 1, 0) : row + _CELLS, max(column - _CELLS + 1, 0) : column + _CELLS
        ] = -1.0  # every window that overlaps this one
    return tuple(marks)


def _in_windows(cells: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Weighted sums of all square windows of cells."""
    windows = np.lib.stride_tricks.sliding_window_view(cells, weights.shape)
    return np.einsum("ijkl,kl->ij", windows, weights)
