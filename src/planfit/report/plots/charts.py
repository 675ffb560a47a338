"""Charts over frames and distances: fit to the plan, correction, predicted error, error of depth, matches."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int
from matplotlib.collections import LineCollection
from matplotlib.ticker import MaxNLocator

from planfit.adjust.association import wall_patches_in_plan
from planfit.adjust.calibration import SHARED, Calibration
from planfit.evaluation import NEAR_FACE_M
from planfit.floorplan import Floorplan
from planfit.matching import Matches
from planfit.pipeline.result import RefineResult
from planfit.pipeline.verdict import Verdict
from planfit.report.measures import BeforeAfter, Measures
from planfit.report.plots.drawing import (
    AFTER,
    AGREES,
    BEFORE,
    DISPLACED,
    FONT_PT,
    GREY,
    INK,
    LIGHT,
    NOT_SEEN,
    PANEL_IN,
    PATH,
    UNMATCHED,
    Picture,
    add_axes,
    clicks_of,
    label_axes,
    new_figure,
    to_picture,
)
from planfit.report.plots.overlay import (
    BOTTOM_IN,
    LEFT_IN,
    LEGEND_IN,
    Entry,
    add_legend,
    view_figure,
)
from planfit.report.plots.top_view import (
    Crop,
    draw_faces,
    draw_paths,
    draw_scale,
    find_gaps,
    set_up_view,
)
from planfit.report.walls import SeenFace
from planfit.scan.joined import FramesOfScan

FLOOR_RANGE_M = 0.2
_MIN_CELL_M, _MAX_CELLS = 0.1, 160


def distance_histogram(both: BeforeAfter) -> tuple[Picture, float]:
    """Distances of wall points to the plan; and the distance (m) at which the axis ends."""
    before, after = both.before.wall_distances_m, both.after.wall_distances_m
    end = float(np.clip(np.ceil(10 * np.percentile(before, 95)) / 10, 0.3, 1.0))
    bins = np.arange(0.0, end + 1e-9, 0.02)
    figure = new_figure(PANEL_IN, 2.9)
    axes = add_axes(figure, 0.55, 0.42, PANEL_IN - 0.75, 2.9 - 0.42 - LEGEND_IN)
    for distances, color in ((before, BEFORE), (after, AFTER)):
        counts = 100 * np.histogram(distances, bins)[0] / len(distances)
        axes.stairs(counts, bins, color=color, linewidth=1.5, zorder=3)
        axes.stairs(counts, bins, color=color, alpha=0.18, fill=True, zorder=2)
    axes.axvline(NEAR_FACE_M, color=GREY, linewidth=0.9, linestyle=(0, (4, 2)), zorder=1)
    axes.set_xlim(0.0, end)
    axes.set_ylim(bottom=0.0)
    label_axes(axes, "distance to the nearest drawn wall (m)", "wall points (% per 2 cm)")
    add_legend(
        axes,
        [
            ("before", BEFORE, "s"),
            ("after", AFTER, "s"),
            (f"{NEAR_FACE_M:.2f} m", GREY, "--"),
        ],
    )
    return to_picture(figure), end


def floor_map(floorplan: Floorplan | None, side: Measures, crop: Crop, width_in: float) -> Picture:
    """Median height of the floor, from above; colours end at plus and minus `FLOOR_RANGE_M`."""
    axes_width = width_in - LEFT_IN - 0.75
    axes_height = axes_width * crop.height_per_width
    figure = new_figure(width_in, BOTTOM_IN + axes_height + 0.1)
    axes = add_axes(figure, LEFT_IN, BOTTOM_IN, axes_width, axes_height)
    set_up_view(axes, crop, floorplan is not None)
    axes.set_facecolor("#e8ebee")
    columns = int(np.clip(crop.size[0] / _MIN_CELL_M, 1, _MAX_CELLS))
    rows = max(1, round(columns * crop.height_per_width))
    floor_xy = side.floor_points[:, :2]
    inside = crop.contains(floor_xy)
    at = ((floor_xy[inside] - crop.low) / crop.size * [columns, rows]).astype(int)
    at = np.minimum(at, [columns - 1, rows - 1])
    flat = at[:, 1] * columns + at[:, 0]
    cells, is_empty = np.zeros(rows * columns), np.ones(rows * columns, dtype=bool)
    used, medians = _medians(flat, side.floor_points[inside, 2])
    cells[used], is_empty[used] = medians, False
    image = axes.imshow(
        np.ma.masked_array(cells, is_empty).reshape(rows, columns),
        extent=(crop.low[0], crop.high[0], crop.low[1], crop.high[1]),
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


def correction_plot(both: BeforeAfter) -> Picture:
    """Translation and rotation of each frame from before to after."""
    correction = both.correction
    translation, rotation_deg = correction[:, 3:], np.rad2deg(correction[:, :3])
    frames = np.arange(len(correction))
    figure = new_figure(PANEL_IN, 3.6)
    height = (3.6 - 0.42 - 2 * LEGEND_IN - 0.12) / 2
    upper = add_axes(figure, 0.55, 0.42 + height + LEGEND_IN + 0.12, PANEL_IN - 0.75, height)
    lower = add_axes(figure, 0.55, 0.42, PANEL_IN - 0.75, height)
    gaps = find_gaps(both.before.trajectory)
    gap_entry: list[Entry] = [("gap in the path", PATH, ":")] if len(gaps) else []
    level_translation = np.linalg.norm(translation[:, :2], axis=1)
    tilt = np.linalg.norm(rotation_deg[:, :2], axis=1)
    translations = ("on the plan", level_translation), ("height", translation[:, 2])
    rotations = ("yaw", rotation_deg[:, 2]), ("tilt", tilt)
    for axes, (first, second), unit, least in (
        (upper, translations, "translation (m)", 0.05),
        (lower, rotations, "rotation (deg)", 0.5),
    ):
        axes.axhline(0.0, color=LIGHT, linewidth=0.8, zorder=1)
        for gap in gaps:
            axes.axvline(gap + 0.5, color=PATH, linewidth=0.7, linestyle=":", zorder=1)
        axes.plot(frames, first[1], color=AFTER, linewidth=1.3, zorder=3)
        axes.plot(frames, second[1], color=INK, linewidth=0.9, linestyle=(0, (3, 1.5)), zorder=2)
        axes.set_xlim(0, max(len(frames) - 1, 1))
        low, high = axes.get_ylim()
        axes.set_ylim(min(low, -least), max(high, least))  # rounding must not look like drift
        label_axes(axes, "frame" if axes is lower else "", unit)
        add_legend(axes, [(first[0], AFTER, "-"), (second[0], INK, "--"), *gap_entry])
    upper.tick_params(labelbottom=False)
    lower.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    clicks = clicks_of("frames", lower)
    left, _, right, bottom = clicks.box
    top = clicks_of("frames", upper).box[1]
    return to_picture(figure, replace(clicks, box=(left, top, right, bottom)))


def certainty_plot(
    verdict: Verdict,
    radius_95_m: Float[np.ndarray, " n"],
    true_error_m: Float[np.ndarray, " n"] | None,
) -> Picture:
    """Predicted error of each frame and its 95 % radius; the true error where it is known; frames with a
    reservation shaded."""
    predicted = verdict.predicted_error_m
    frames = np.arange(len(predicted))
    figure = new_figure(PANEL_IN, 2.6)
    axes = add_axes(figure, 0.55, 0.42, PANEL_IN - 0.75, 2.6 - 0.42 - LEGEND_IN)
    entries: list[Entry] = [("predicted", AFTER, "-"), ("95 % radius", LIGHT, "s")]
    axes.fill_between(frames, radius_95_m, color=LIGHT, alpha=0.6, linewidth=0, zorder=0)
    for first, last in _joined(verdict):
        axes.axvspan(first - 0.5, last + 0.5, color=UNMATCHED, alpha=0.2, linewidth=0, zorder=1)
    axes.plot(frames, predicted, color=AFTER, linewidth=1.3, zorder=3)
    if true_error_m is not None:
        axes.plot(frames, true_error_m, color=INK, linewidth=0.9, linestyle=":", zorder=2)
        entries.append(("true", INK, ":"))
    axes.set_xlim(0, max(len(frames) - 1, 1))
    axes.set_ylim(0.0, max(1.1 * float(axes.get_ylim()[1]), 0.1))
    label_axes(axes, "frame", "error of the position (m)")
    axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    if verdict.reservations:
        entries.append(("with a reservation", UNMATCHED, "s"))
    add_legend(axes, entries)
    return to_picture(figure, clicks_of("frames", axes))


def _joined(verdict: Verdict) -> list[tuple[int, int]]:
    """Runs of frames with any reservation, first and last."""
    reserved = np.zeros(len(verdict.predicted_error_m) + 2, dtype=bool)
    for reservation in verdict.reservations:
        for first, last in reservation.frames:
            reserved[first + 1 : last + 2] = True
    # A run begins where the mask, with a frame on either side of the scan, rises, and ends where it falls.
    borders = np.flatnonzero(np.diff(reserved))
    return [(int(a), int(b) - 1) for a, b in borders.reshape(-1, 2)]


def wall_map(
    floorplan: Floorplan, result: RefineResult, faces: list[SeenFace], crop: Crop, width_in: float
) -> Picture:
    """Faces of the plan by what the scan says of them; numbers as in the table of walls."""
    figure, axes = view_figure(crop, width_in, 0.08)
    set_up_view(axes, crop)
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


def _medians(
    group: Int[np.ndarray, " m"], values: Float[np.ndarray, " m"]
) -> tuple[Int[np.ndarray, " g"], Float[np.ndarray, " g"]]:
    """Groups, and the median of the values of each."""
    # Sorted by group and then by value, the median of a group is half of its size past its first.
    order = np.lexsort((values, group))
    found, start, counts = np.unique(group[order], return_index=True, return_counts=True)
    return found, values[order][start + counts // 2]


NEAR_M, FAR_M = 0.5, 8.0
"""The plot is drawn between these: nearer, few cameras measure; further, points take no part."""
_LEAST_CM = 2.0
"""Of the axis to either side, so that millimetres do not look like a fault."""
_DEPTH = ("depth_scale", "depth_offset_m", "depth_quadratic_per_m")


def depth_errors_m(
    calibration: Calibration, depths_m: Float[np.ndarray, " k"]
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Error of measured depths before, after, and one standard deviation of both.

    Before: measured less corrected. After: what is left by the calibration's own account, nothing. The
    standard deviation takes the parameters that were kept as independent; where none was, the largest of each
    alone.
    """
    before = depths_m - calibration.sensor.depths(depths_m)
    idx = [SHARED.index(name) for name in _DEPTH]
    powers = np.stack([depths_m, np.ones_like(depths_m), depths_m**2])
    spread = powers * calibration.sigmas[idx][:, None]
    is_kept = calibration.is_kept[idx]
    kept = np.sqrt(np.sum(spread[is_kept] ** 2, axis=0))
    return before, np.zeros_like(before), kept if is_kept.any() else spread.max(axis=0)


def depth_error_plot(calibration: Calibration, farthest_m: float) -> Picture:
    """Error (cm) over distance (m), from `NEAR_M` to the farthest point seen."""
    depths_m = np.linspace(NEAR_M, farthest_m, 100)
    before, after, sigma = (100 * e for e in depth_errors_m(calibration, depths_m))
    figure = new_figure(PANEL_IN, 2.9)
    axes = add_axes(figure, 0.55, 0.42, PANEL_IN - 0.75, 2.9 - 0.42 - LEGEND_IN)
    axes.axhline(0.0, color=LIGHT, linewidth=0.8, zorder=1)
    axes.fill_between(depths_m, after - sigma, after + sigma, color=AFTER, alpha=0.18, linewidth=0)
    axes.plot(depths_m, before, color=BEFORE, linewidth=1.5, zorder=3)
    axes.plot(depths_m, after, color=AFTER, linewidth=1.5, zorder=2)
    axes.set_xlim(NEAR_M, farthest_m)
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, -_LEAST_CM), max(high, _LEAST_CM))
    label_axes(axes, "distance (m)", "measured less true depth (cm)")
    add_legend(axes, [("before", BEFORE, "-"), ("after", AFTER, "-")])
    return to_picture(figure)


_HEIGHT_IN = 2.4


def loop_closures_of(
    matches: Matches, min_frames: int, keyframe_idx: Int[np.ndarray, " k"]
) -> Int[np.ndarray, "c 2"]:
    """Verified pairs of frames that are more than `min_frames` keyframes apart."""
    apart = np.diff(np.searchsorted(keyframe_idx, matches.pairs), axis=1)[:, 0]
    return matches.pairs[apart > min_frames]


def matches_by_frame(matches: Matches, n_frames: int) -> Int[np.ndarray, " n"]:
    """Matched points that each frame takes part in."""
    counts = np.diff(matches.start)
    by_frame = np.zeros(n_frames)
    for side in (0, 1):
        by_frame += np.bincount(matches.pairs[:, side], counts, n_frames)
    return by_frame.astype(int)


def loop_closure_map(
    plan_ends: Float[np.ndarray, "f 2 2"],
    trajectory: Float[np.ndarray, "n 3"],
    loop_closures: Int[np.ndarray, "c 2"],
    crop: Crop,
    width_in: float,
    scans: Sequence[FramesOfScan] = (),
) -> Picture:
    """A line for each loop closure, between the camera centres (m) of its two frames."""
    figure, axes = view_figure(crop, width_in, LEGEND_IN)
    set_up_view(axes, crop, len(plan_ends) > 0)
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


def matches_plot(keyframe_idx: Int[np.ndarray, " k"], by_frame: Int[np.ndarray, " k"]) -> Picture:
    """Matched points of each keyframe; those without any are marked."""
    figure = new_figure(PANEL_IN, _HEIGHT_IN)
    axes = add_axes(figure, 0.6, 0.42, PANEL_IN - 0.75, _HEIGHT_IN - 0.42 - LEGEND_IN)
    axes.fill_between(keyframe_idx, by_frame, step="mid", color=AFTER, alpha=0.25, linewidth=0)
    axes.plot(keyframe_idx, by_frame, color=AFTER, linewidth=1.0, drawstyle="steps-mid")
    none = keyframe_idx[by_frame == 0]
    axes.plot(none, np.zeros(len(none)), "s", color=UNMATCHED, markersize=4, clip_on=False)
    axes.set_xlim(0, max(int(keyframe_idx[-1]), 1))
    axes.set_ylim(bottom=0)
    axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    label_axes(axes, "frame", "matched points")
    entries: list[Entry] = [("matched points", AFTER, "-")]
    if len(none):
        entries.append(("none", UNMATCHED, "s"))
    add_legend(axes, entries)
    return to_picture(figure, clicks_of("frames", axes))
