"""Wall points over the plan, before and after: the whole scan, and where both differ most."""

from textwrap import shorten

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from planfit.evaluation import NEAR_FACE_M
from planfit.floorplan import Floorplan
from planfit.pipeline.result import RefineResult
from planfit.priors import WALL_AS_BUILT_SIGMA_M
from planfit.report import formatting
from planfit.report.measures import BeforeAfter, Measures, measure, measure_storeys
from planfit.report.plots import colors
from planfit.report.plots.axes import LEGEND_PT, TITLE_PT, Axes, Entry
from planfit.report.plots.drawing import PANEL_PT, Drawing, Words, to_image, to_png
from planfit.report.plots.top_view import (
    Crop,
    Mark,
    crop_to_scan,
    draw_mark,
    draw_paths,
    draw_points,
    finish_view,
    new_view,
)

WIDE_PT = 1.9 * PANEL_PT
"""Width of a picture that takes the whole page."""
_WIDE = 0.55
"""A scan with less height per width than this is drawn over the whole page."""


SIZE_M = 8.0
"""Side of the window of a close-up."""
_MIN_DIFFERENCE_M = WALL_AS_BUILT_SIGMA_M.value
_MIN_POINTS = 50
_CELLS = round(SIZE_M)
"""Cells a window has each way, of a metre."""
_NAMED_PATHS, _NAME_LENGTH = 3, 16
"""Paths of several scans that a legend names, and how long a name may be there."""


def is_wide(crop: Crop) -> bool:
    """Whether before and after belong one above the other."""
    return crop.height_per_width < _WIDE


def draw_overlay(floorplan: Floorplan | None, both: BeforeAfter) -> bytes:
    """PNG: the scan's wall points over the plan's faces, before and after, cropped to the scan."""
    return to_png(_before_and_after(floorplan, both, crop_to_scan(both)))


def draw_overlays(result: RefineResult, both: BeforeAfter | None = None) -> dict[str, bytes]:
    """The overlay as `draw_overlay` draws it, by the name of its file; one a storey where each has a plan.
    `both` is what `measure` gives of the result, where that is at hand."""
    return {name: to_png(image) for name, image in _overlays(result, both).items()}


def plot_result(result: RefineResult) -> Image.Image:
    """The overlay as a picture that notebooks show; of several storeys one above the other. What
    `RefineResult.plot` calls."""
    pages = list(_overlays(result, None).values())
    return Image.fromarray(np.concatenate(pages)[:, :, ::-1])


def _overlays(
    result: RefineResult, both: BeforeAfter | None
) -> dict[str, UInt8[np.ndarray, "h w 3"]]:
    both = both or measure(result.floorplan, result)
    crop = crop_to_scan(both)
    if result.storeys is None:
        return {"overlay.png": _before_and_after(result.floorplan, both, crop)}
    return {
        f"overlay_{each.number}.png": _before_and_after(each.floorplan, each.both, crop)
        for each in measure_storeys(result)
    }


def _before_and_after(
    floorplan: Floorplan | None, both: BeforeAfter, crop: Crop
) -> UInt8[np.ndarray, "h w 3"]:
    """BGR: both sides, each under a line of its numbers."""
    width, images = WIDE_PT if is_wide(crop) else 1.3 * PANEL_PT, []
    for side, name, color in (
        (both.before, "before", colors.BEFORE),
        (both.after, "after", colors.AFTER),
    ):
        drawing, axes = new_view(crop, width, TITLE_PT + LEGEND_PT)
        draw_side(axes, floorplan, both, side)
        words = f"{name}: {fit_in_words(both, side)}"
        drawing.items.append(Words(words, (axes.box.left, 14), color, is_bold=True))
        images.append(to_image(drawing))
    return np.concatenate(images, axis=0 if is_wide(crop) else 1)


def fit_in_words(both: BeforeAfter, side: Measures) -> str:
    """The numbers that matter of one side."""
    if not both.has_plan:
        return "what was seen at camera height"
    if not both.is_aligned:
        return "not aligned with the plan"
    if side.walls is None:
        return "no wall was seen"
    return (
        f"{formatting.share(side.walls.near_share)} of wall points within "
        f"{formatting.length(NEAR_FACE_M, '.2f')} of the plan, NSD {formatting.length(side.walls.nsd_m)}"
    )


def side_picture(
    floorplan: Floorplan | None,
    both: BeforeAfter,
    side: Measures,
    crop: Crop,
    marks: tuple[Mark, ...] = (),
    width_pt: float = PANEL_PT,
) -> Drawing:
    """One side alone, for a page that puts its own words beside it."""
    drawing, axes = new_view(crop, width_pt, LEGEND_PT)
    draw_side(axes, floorplan, both, side)
    for mark in marks:
        draw_mark(axes, mark)
    drawing.clicks = axes.clicks("plan")
    return drawing


def draw_side(axes: Axes, floorplan: Floorplan | None, both: BeforeAfter, side: Measures) -> None:
    """Wall points, plan, path, scale and legend of one side."""
    is_after = side is both.after
    color = colors.AFTER if is_after else colors.BEFORE
    entries: list[Entry] = []
    if len(side.wall_xy):
        points = "wall points" if both.has_plan else "scan"
        entries.append((f"{points} {'after' if is_after else 'before'}", color, "s"))
    if floorplan is not None and both.is_aligned:
        axes.lines(floorplan.ends, colors.INK, 0.7)
        entries.append(("plan", colors.INK, "-"))
    draw_points(axes, side.wall_xy, color)
    draw_paths(axes, side.trajectory[:, :2], both.scans)
    if both.scans:
        # The table of the scans has all of them, in the same colours.
        for own, color in zip(both.scans[:_NAMED_PATHS], colors.PATHS, strict=False):
            entries.append((shorten(own.name, _NAME_LENGTH, placeholder="…"), color, "-"))
    else:
        entries.append(("camera path (ring: start)", colors.PATH, "-"))
    finish_view(axes, both.is_aligned, entries)


def choose_close_ups(both: BeforeAfter, crop: Crop) -> tuple[Mark, ...]:
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
    for letter in "ABC":
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
