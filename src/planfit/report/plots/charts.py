"""Charts over frames and distances: fit to the plan, correction, predicted error, error of depth, matches."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from planfit.adjust.calibration import SHARED, Calibration
from planfit.evaluation import NEAR_FACE_M
from planfit.matching import Matches
from planfit.pipeline.on_plan import frame_runs
from planfit.pipeline.verdict import Verdict
from planfit.report.measures import BeforeAfter
from planfit.report.plots import colors
from planfit.report.plots.axes import Entry, new_chart
from planfit.report.plots.drawing import DASHED, DOTTED, Drawing
from planfit.report.plots.top_view import find_gaps
from planfit.units import in_units


def distance_histogram(both: BeforeAfter) -> tuple[Drawing, float]:
    """Distances of wall points to the plan; and the distance (m) at which the axis ends."""
    before, after = both.before.wall_distances_m, both.after.wall_distances_m
    end = float(np.clip(np.ceil(10 * np.percentile(before, 95)) / 10, 0.3, 1.0))
    bins = np.arange(0.0, end + 1e-9, 0.02)
    shares = [100 * np.histogram(d, bins)[0] / len(d) for d in (before, after)]
    drawing, (axes,) = new_chart(209, (0.0, end), (0.0, 1.05 * float(np.max(shares))))
    axes.upright(np.array([NEAR_FACE_M]), colors.GREY, 0.9, DASHED)
    for share, color in zip(shares, (colors.BEFORE, colors.AFTER), strict=True):
        # Down to nothing at both ends.
        outline = np.repeat(bins, 2), np.concatenate([[0.0], np.repeat(share, 2), [0.0]])
        axes.band(outline[0], np.zeros(len(outline[0])), outline[1], color, 0.18)
        axes.series(*outline, color, 1.5)
    axes.rim("distance to the nearest drawn wall (m)", "wall points (% per 2 cm)", is_boxed=False)
    near: Entry = (in_units(NEAR_FACE_M), colors.GREY, "--")
    axes.legend([("before", colors.BEFORE, "s"), ("after", colors.AFTER, "s"), near])
    return drawing, end


def correction_plot(both: BeforeAfter) -> Drawing:
    """Translation and rotation of each frame from before to after."""
    translation, rotation_deg = both.correction[:, 3:], np.rad2deg(both.correction[:, :3])
    frames = np.arange(len(translation))
    gaps = find_gaps(both.before.trajectory)
    gap_entry: list[Entry] = [("gap in the path", colors.PATH, ":")] if len(gaps) else []
    level_m = np.linalg.norm(translation[:, :2], axis=1)
    tilt_deg = np.linalg.norm(rotation_deg[:, :2], axis=1)
    # Rounding must not look like drift.
    y_upper = _around(level_m, translation[:, 2], least=0.05)
    y_lower = _around(rotation_deg[:, 2], tilt_deg, least=0.5)
    drawing, (upper, lower) = new_chart(260, (0.0, max(len(frames) - 1.0, 1.0)), y_upper, y_lower)
    for axes, x_name, y_name, (first, name), (second, other) in (
        (upper, "", "translation (m)", (level_m, "on the plan"), (translation[:, 2], "height")),
        (lower, "frame", "rotation (deg)", (rotation_deg[:, 2], "yaw"), (tilt_deg, "tilt")),
    ):
        axes.lines([np.column_stack([axes.x, (0.0, 0.0)])], colors.LIGHT, 0.8)
        axes.upright(gaps + 0.5, colors.PATH, 0.7, DOTTED)
        axes.series(frames, second, colors.INK, 0.9, DASHED)
        axes.series(frames, first, colors.AFTER, 1.3)
        axes.rim(x_name, y_name, False, (axes is lower, True), least_step=1)
        axes.legend([(name, colors.AFTER, "-"), (other, colors.INK, "--"), *gap_entry])
    clicks = lower.clicks("frames")
    left, _, right, bottom = clicks.box
    top = upper.clicks("frames").box[1]
    drawing.clicks = replace(clicks, box=(left, top, right, bottom))
    return drawing


def _around(*lines: Float[np.ndarray, " n"], least: float) -> tuple[float, float]:
    """Range of an axis that holds lines and 0, and at least this much to either side."""
    low, high = min(v.min() for v in lines), max(v.max() for v in lines)
    room = 0.05 * (high - low)
    return min(float(low - room), -least), max(float(high + room), least)


def certainty_plot(
    verdict: Verdict,
    radius_95_m: Float[np.ndarray, " n"],
    true_error_m: Float[np.ndarray, " n"] | None,
) -> Drawing:
    """Predicted error of each frame and its 95 % radius; the true error where it is known; frames with a
    reservation shaded."""
    predicted = verdict.predicted_error_m
    frames = np.arange(len(predicted))
    known = (
        [radius_95_m, predicted] if true_error_m is None else [radius_95_m, predicted, true_error_m]
    )
    most_m = max(float(v[np.isfinite(v)].max(initial=0.0)) for v in known)
    drawing, (axes,) = new_chart(
        187, (0.0, max(len(frames) - 1.0, 1.0)), (0.0, max(1.15 * most_m, 0.1))
    )
    entries: list[Entry] = [("predicted", colors.AFTER, "-"), ("95 % radius", colors.NOT_SEEN, "s")]
    axes.band(frames, np.zeros(len(frames)), radius_95_m, colors.NOT_SEEN, 0.45)
    is_reserved = np.zeros(len(frames), dtype=bool)
    for first, last in [ends for each in verdict.reservations for ends in each.frames]:
        is_reserved[first : last + 1] = True
    axes.spans(
        [(first - 0.5, last + 0.5) for first, last in frame_runs(is_reserved)], colors.UNMATCHED
    )
    if true_error_m is not None:
        axes.series(frames, true_error_m, colors.INK, 0.9, DOTTED)
        entries.append(("true", colors.INK, ":"))
    axes.series(frames, predicted, colors.AFTER, 1.3)
    axes.rim("frame", "error of the position (m)", is_boxed=False, least_step=1)
    if verdict.reservations:
        entries.append(("with a reservation", colors.UNMATCHED, "s"))
    axes.legend(entries)
    drawing.clicks = axes.clicks("frames")
    return drawing


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


def depth_error_plot(calibration: Calibration, farthest_m: float) -> Drawing:
    """Error (cm) over distance (m), from `NEAR_M` to the farthest point seen."""
    depths_m = np.linspace(NEAR_M, farthest_m, 100)
    before, after, sigma = (100 * e for e in depth_errors_m(calibration, depths_m))
    y = _around(before, after - sigma, after + sigma, least=_LEAST_CM)
    drawing, (axes,) = new_chart(209, (NEAR_M, farthest_m), y)
    axes.band(depths_m, after - sigma, after + sigma, colors.AFTER, 0.18)
    axes.series(depths_m, after, colors.AFTER, 1.5)
    axes.series(depths_m, before, colors.BEFORE, 1.5)
    axes.rim("distance (m)", "measured less true depth (cm)", is_boxed=False)
    axes.legend([("before", colors.BEFORE, "-"), ("after", colors.AFTER, "-")])
    return drawing


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


def matches_plot(keyframe_idx: Int[np.ndarray, " k"], by_frame: Int[np.ndarray, " k"]) -> Drawing:
    """Matched points of each keyframe; those without any are marked."""
    last = float(max(keyframe_idx[-1], 1))
    drawing, (axes,) = new_chart(173, (0.0, last), (0.0, 1.05 * max(float(by_frame.max()), 1.0)))
    # A step halfway from each keyframe to the next.
    middles = (keyframe_idx[1:] + keyframe_idx[:-1]) / 2
    borders = np.concatenate([keyframe_idx[:1], np.repeat(middles, 2), keyframe_idx[-1:]])
    steps = np.repeat(by_frame, 2)
    axes.band(borders, np.zeros(len(steps)), steps, colors.AFTER, 0.25)
    axes.series(borders, steps, colors.AFTER, 1.0)
    axes.rim("frame", "matched points", is_boxed=False, least_step=1)
    none = keyframe_idx[by_frame == 0]
    axes.squares(np.column_stack([none, np.zeros(len(none))]), colors.UNMATCHED, 4.0)
    entries: list[Entry] = [("matched points", colors.AFTER, "-")]
    if len(none):
        entries.append(("none", colors.UNMATCHED, "s"))
    axes.legend(entries)
    drawing.clicks = axes.clicks("frames")
    return drawing
