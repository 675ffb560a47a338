"""Maps of the scan: heights of the floor, walls of the plan by agreement, loop closures."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from matplotlib.collections import LineCollection

from planfit.adjust.association import wall_patches_in_plan
from planfit.floorplan import Floorplan
from planfit.pipeline.result import RefineResult
from planfit.report.measures import Measures
from planfit.report.plots.drawing import (
    AFTER,
    AGREES,
    BOTTOM_IN,
    DISPLACED,
    FONT_PT,
    GREY,
    LEFT_IN,
    LEGEND_IN,
    LIGHT,
    NOT_SEEN,
    UNMATCHED,
    Entry,
    Picture,
    add_axes,
    add_legend,
    clicks_of,
    to_picture,
)
from planfit.report.plots.top_view import (
    Crop,
    draw_faces,
    draw_paths,
    draw_scale,
    view_figure,
)
from planfit.report.walls import SeenFace
from planfit.scan.joined import FramesOfScan

FLOOR_RANGE_M = 0.2
"""Heights (m) at which the colours of the floor end."""
_MIN_CELL_M, _MAX_CELLS = 0.1, 160
_BAR_IN = 0.75
"""Room for the key to these colours."""


def floor_map(floorplan: Floorplan | None, side: Measures, crop: Crop, width_in: float) -> Picture:
    """Median height of the floor, from above; colours end at plus and minus `FLOOR_RANGE_M`."""
    figure, axes = view_figure(crop, width_in, 0.1, floorplan is not None, _BAR_IN)
    axes.set_facecolor("#e8ebee")
    columns = int(np.clip(crop.size[0] / _MIN_CELL_M, 1, _MAX_CELLS))
    rows = max(1, round(columns * crop.height_per_width))
    floor_xy = side.floor_points[:, :2]
    inside = crop.contains(floor_xy)
    cells, is_empty = np.zeros(rows * columns), np.ones(rows * columns, dtype=bool)
    used, medians = _medians(
        crop.cells_of(floor_xy[inside], columns, rows), side.floor_points[inside, 2]
    )
    cells[used], is_empty[used] = medians, False
    image = axes.imshow(
        np.ma.masked_array(cells, is_empty).reshape(rows, columns),
        extent=crop.extent,
        origin="lower",
        interpolation="nearest",
        cmap="RdBu_r",
        vmin=-FLOOR_RANGE_M,
        vmax=FLOOR_RANGE_M,
        zorder=2,
    )
    if floorplan is not None:
        draw_faces(axes, crop, floorplan.ends, GREY, 0.5)
    draw_scale(axes, crop)
    axes_width = width_in - LEFT_IN - _BAR_IN
    axes_height = axes_width * crop.height_per_width
    bar_height = min(axes_height, 2.6)
    bar_axes = add_axes(
        figure,
        LEFT_IN + axes_width + 0.12,
        BOTTOM_IN + (axes_height - bar_height) / 2,
        0.1,
        bar_height,
    )
    bar = figure.colorbar(image, cax=bar_axes, extend="both")
    bar.outline.set_visible(False)  # type: ignore[operator]
    bar.set_ticks([-0.2, -0.1, 0.0, 0.1, 0.2], labels=["−0.2", "−0.1", "0", "+0.1", "+0.2"])
    bar.set_label("floor height (m)", fontsize=FONT_PT, color=GREY, labelpad=1)
    return to_picture(figure, clicks_of("plan", axes))


def wall_map(
    floorplan: Floorplan, result: RefineResult, faces: list[SeenFace], crop: Crop, width_in: float
) -> Picture:
    """Faces of the plan by what the scan says of them; numbers as in the table of walls."""
    figure, axes = view_figure(crop, width_in, 0.08)
    _, ends = wall_patches_in_plan(result.structure.walls, result.plan_from_cams)
    draw_faces(axes, crop, floorplan.ends, NOT_SEEN, 0.7, 2)
    draw_faces(axes, crop, ends[result.adjustment.association.face_idx < 0], UNMATCHED, 1.2, 3)
    for is_displaced, color, width_pt in ((False, AGREES, 1.8), (True, DISPLACED, 2.2)):
        chosen = [face.face_idx for face in faces if face.is_displaced == is_displaced]
        draw_faces(axes, crop, floorplan.ends[chosen], color, width_pt, 4)
    for face in faces:
        if face.is_displaced and crop.contains(np.array([face.middle_xy]))[0]:
            axes.annotate(
                str(face.number),
                face.middle_xy,
                xytext=(4, 4),
                textcoords="offset points",
                fontsize=FONT_PT - 0.5,
                fontweight="bold",
                color=DISPLACED,
                bbox={"boxstyle": "round,pad=0.12", "fc": "white", "ec": "none", "alpha": 0.85},
                zorder=6,
            )
    draw_scale(axes, crop)
    return to_picture(figure, clicks_of("walls", axes))


def loop_closure_map(
    plan_ends: Float[np.ndarray, "f 2 2"],
    trajectory: Float[np.ndarray, "n 3"],
    loop_closures: Int[np.ndarray, "c 2"],
    crop: Crop,
    width_in: float,
    scans: Sequence[FramesOfScan] = (),
) -> Picture:
    """A line for each loop closure, between the camera centres (m) of its two frames."""
    figure, axes = view_figure(crop, width_in, LEGEND_IN, len(plan_ends) > 0)
    draw_faces(axes, crop, plan_ends, LIGHT)
    draw_paths(axes, trajectory[:, :2], scans, 0.7)
    lines = LineCollection(
        list(trajectory[loop_closures][:, :, :2]), colors=AFTER, linewidths=0.8, alpha=0.6, zorder=4
    )
    axes.add_collection(lines, autolim=False)
    draw_scale(axes, crop)
    entries: list[Entry] = [("loop closure, verified", AFTER, "-")]
    add_legend(axes, entries)
    return to_picture(figure, clicks_of("plan", axes))


def _medians(
    group: Int[np.ndarray, " m"], values: Float[np.ndarray, " m"]
) -> tuple[Int[np.ndarray, " g"], Float[np.ndarray, " g"]]:
    """Groups, and the median of the values of each."""
    # Sorted by group and then by value, the median of a group is half of its size past its first.
    order = np.lexsort((values, group))
    found, start, counts = np.unique(group[order], return_index=True, return_counts=True)
    return found, values[order][start + counts // 2]
