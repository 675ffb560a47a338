"""Charts over frames and distances: fit to the plan, correction, predicted error, error of depth, matches."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from planfit.adjust.calibration import SHARED, Calibration
from planfit.evaluation import NEAR_FACE_M
from planfit.matching import Matches
from planfit.pipeline.verdict import Verdict
from planfit.report.measures import BeforeAfter
from planfit.report.plots.drawing import (
    AFTER,
    BEFORE,
    GREY,
    INK,
    LIGHT,
    PATH,
    UNMATCHED,
    Entry,
    Picture,
    add_legend,
    clicks_of,
    label_axes,
    new_chart,
    new_frame_charts,
    number_frames,
    to_picture,
)
from planfit.report.plots.top_view import (
    find_gaps,
)


def distance_histogram(both: BeforeAfter) -> tuple[Picture, float]:
    """Distances of wall points to the plan; and the distance (m) at which the axis ends."""
    before, after = both.before.wall_distances_m, both.after.wall_distances_m
    end = float(np.clip(np.ceil(10 * np.percentile(before, 95)) / 10, 0.3, 1.0))
    bins = np.arange(0.0, end + 1e-9, 0.02)
    figure, axes = new_chart(2.9)
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


def correction_plot(both: BeforeAfter) -> Picture:
    """Translation and rotation of each frame from before to after."""
    correction = both.correction
    translation, rotation_deg = correction[:, 3:], np.rad2deg(correction[:, :3])
    frames = np.arange(len(correction))
    figure, upper, lower = new_frame_charts(len(frames))
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
        for gap in gaps:
            axes.axvline(gap + 0.5, color=PATH, linewidth=0.7, linestyle=":", zorder=1)
        axes.plot(frames, first[1], color=AFTER, linewidth=1.3, zorder=3)
        axes.plot(frames, second[1], color=INK, linewidth=0.9, linestyle=(0, (3, 1.5)), zorder=2)
        low, high = axes.get_ylim()
        axes.set_ylim(min(low, -least), max(high, least))  # rounding must not look like drift
        label_axes(axes, "frame" if axes is lower else "", unit)
        add_legend(axes, [(first[0], AFTER, "-"), (second[0], INK, "--"), *gap_entry])
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
    figure, axes = new_chart(2.6)
    entries: list[Entry] = [("predicted", AFTER, "-"), ("95 % radius", LIGHT, "s")]
    axes.fill_between(frames, radius_95_m, color=LIGHT, alpha=0.6, linewidth=0, zorder=0)
    for first, last in _joined(verdict):
        axes.axvspan(first - 0.5, last + 0.5, color=UNMATCHED, alpha=0.2, linewidth=0, zorder=1)
    axes.plot(frames, predicted, color=AFTER, linewidth=1.3, zorder=3)
    if true_error_m is not None:
        axes.plot(frames, true_error_m, color=INK, linewidth=0.9, linestyle=":", zorder=2)
        entries.append(("true", INK, ":"))
    number_frames(axes, len(frames) - 1)
    axes.set_ylim(0.0, max(1.1 * float(axes.get_ylim()[1]), 0.1))
    label_axes(axes, "frame", "error of the position (m)")
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
    figure, axes = new_chart(2.9)
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


def matches_plot(keyframe_idx: Int[np.ndarray, " k"], by_frame: Int[np.ndarray, " k"]) -> Picture:
    """Matched points of each keyframe; those without any are marked."""
    figure, axes = new_chart(2.4, left_in=0.6)
    axes.fill_between(keyframe_idx, by_frame, step="mid", color=AFTER, alpha=0.25, linewidth=0)
    axes.plot(keyframe_idx, by_frame, color=AFTER, linewidth=1.0, drawstyle="steps-mid")
    none = keyframe_idx[by_frame == 0]
    axes.plot(none, np.zeros(len(none)), "s", color=UNMATCHED, markersize=4, clip_on=False)
    number_frames(axes, int(keyframe_idx[-1]))
    axes.set_ylim(bottom=0)
    label_axes(axes, "frame", "matched points")
    entries: list[Entry] = [("matched points", AFTER, "-")]
    if len(none):
        entries.append(("none", UNMATCHED, "s"))
    add_legend(axes, entries)
    return to_picture(figure, clicks_of("frames", axes))
