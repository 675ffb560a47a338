"""Sections that are pictures, with the words to judge them: fit, floor, walls, matches, sensor; and photos
beside findings, of the frames that they name, and of frames that see the walls that they name."""

import base64
from collections.abc import Iterable, Iterator, Mapping, Sequence
from html import escape

import numpy as np

from planfit.adjust.association import wall_patches_in_plan
from planfit.as_built import AsBuilt, in_words, rooms_as_built
from planfit.evaluation import NEAR_FACE_M
from planfit.findings import Finding, sentences_of
from planfit.findings.finding import FEW_NAMED
from planfit.floorplan import Floorplan
from planfit.pipeline.result import RefineResult
from planfit.pipeline.sensor import SensorParameter, sensor_findings
from planfit.priors import PATCH_TURN_MOST_DEG, WALL_MOVED_MOST_M
from planfit.report import formatting
from planfit.report.html import tables
from planfit.report.html.as_built_section import as_built_section
from planfit.report.html.tables import captioned, plural, side_by_side, sides, table, width_pt
from planfit.report.measures import BeforeAfter, Measures
from planfit.report.plots import charts, maps
from planfit.report.plots.drawing import PANEL_PT
from planfit.report.plots.top_view import Crop

_DIGITS = {"": 4, "m": 3, "1/m": 4, "px": 1}


def fit_and_correction(both: BeforeAfter) -> str:
    """How far wall points are from the plan, and how each frame was moved."""
    parts = []
    if both.has_walls:
        picture, end = charts.distance_histogram(both)
        beyond = [_share_beyond(side, end) for _, side in sides(both)]
        parts.append(
            captioned(
                picture,
                "<strong>Distance of wall points to the plan.</strong> The more of them on the "
                f"left, the better the fit. Dashed: the {formatting.length(NEAR_FACE_M, '.2f')} "
                f"of the key metrics. Beyond {formatting.length(end, '.1f')} lie "
                f"{formatting.share(beyond[0])} of the points before and "
                f"{formatting.share(beyond[1])} after.",
                "Histogram of distances of wall points to the plan, before and after",
            )
        )
    most_m = float(np.linalg.norm(both.correction[:, 3:], axis=1).max(initial=0.0))
    most_rad = float(np.linalg.norm(both.correction[:, :3], axis=1).max(initial=0.0))
    parts.append(
        captioned(
            charts.correction_plot(both),
            "<strong>Correction of each frame,</strong> from the recorded to the refined pose: at "
            f"most {formatting.length(most_m)} and {np.rad2deg(most_rad):.1f}{formatting.SPACE}deg. Slow "
            "waves are drift that was taken out. A jump is to be expected at a gap in the path; elsewhere it "
            "deserves a look at that frame.",
            "Translation and rotation of each frame",
        )
    )
    return f'<h2>Fit and correction</h2><div class="pair">{"".join(parts)}</div>'


def floor(floorplan: Floorplan | None, both: BeforeAfter, crop: Crop) -> str:
    """Heights of the floor, before and after."""
    if not both.has_floor:
        return "<h2>Floor</h2><p>No floor was seen in this scan.</p>"
    shown_plan = floorplan if both.is_aligned else None
    pictures = [
        captioned(
            maps.floor_map(shown_plan, side, crop, width_pt(crop)),
            f"<strong>{name}:</strong> half of the floor points lie within "
            f"{formatting.length(side.floor and side.floor.height_median_m)} of their median height; RMS "
            f"{formatting.length(side.floor and side.floor.height_rms_m)} about their mean",
            f"Floor heights {name}",
            name,
        )
        for name, side in sides(both)
    ]
    limit = formatting.length(maps.RANGE_M, ".1f")
    return (
        "<h2>Floor</h2><p>Height of the scanned floor: red is above the floor plane, blue below, "
        f"colours end at ±{limit}. A flat floor is white all over. Slopes, and steps where the "
        "path comes back to a place, show that cameras drifted in height or tilt. What lies on the "
        "floor and was taken for floor stays red, however good the poses are.</p>"
        f"{side_by_side(pictures, crop)}"
    )


def walls(
    floorplan: Floorplan | None, result: RefineResult, crop: Crop, as_built: AsBuilt | None
) -> str:
    """How each wall of the plan was built, and pictures of some; nothing without a plan."""
    if floorplan is None:
        return ""
    head = "<h2>Walls of the plan</h2>"
    if as_built is None:
        return (
            f"{head}<p>The scan has no place on the plan, so that no wall of it can be judged.</p>"
        )
    n_patches = len(result.structure.walls)
    n_lost = n_patches - result.adjustment.association.n_associated
    html = [
        f"{head}<p>{n_lost} of {n_patches} wall patches of the scan found no wall on the plan: furniture, "
        "what the plan does not draw, or walls that were moved.</p>",
        as_built_section(as_built, crop, rooms_as_built(floorplan, as_built)),
    ]
    shown = maps.walls_to_show(result, as_built)
    if shown:
        limit = formatting.length(maps.RANGE_M, ".1f")
        html.append(
            "<h3>Walls from the front</h3><p>Walls that stand elsewhere than drawn, the furthest first; "
            "where none does, the longest that was seen. Red is before the wall as drawn, towards who "
            f"looks at it, blue behind it; colours end at ±{limit}.</p>"
            f'<div class="pair">{"".join(map(_front, shown))}</div>'
        )
    return "\n".join(html)


def frame_matches(
    floorplan: Floorplan | None, both: BeforeAfter, result: RefineResult, crop: Crop
) -> str:
    """Loop closures, and matched points of each keyframe."""
    keyframe_idx, matches = result.solved_frame_idx, result.matches
    n_frames = len(keyframe_idx)
    loop_closures = charts.loop_closures_of(matches, tables.LOOP_MIN_FRAMES, keyframe_idx)
    by_frame = charts.matches_by_frame(matches, len(both.after.trajectory))[keyframe_idx]
    plan_ends = np.zeros((0, 2, 2))
    if floorplan is not None and both.is_aligned:
        plan_ends = floorplan.ends
    others = "floor and walls hold" if both.has_plan else "and floor hold"
    n_none = int(np.sum(by_frame == 0))
    none = (
        f" {n_none} of {n_frames} keyframes {plural(n_none, 'has', 'have')} none: only the recorded motion, "
        f"{others} them."
        if n_none
        else ""
    )
    pictures = [
        captioned(
            maps.loop_closure_map(
                plan_ends, both.after.trajectory, loop_closures, crop, PANEL_PT, both.scans
            ),
            f"<strong>Loop closures:</strong> {formatting.count(len(loop_closures))} pairs of frames, more "
            f"than {tables.LOOP_MIN_FRAMES} keyframes apart, that see the same part of the building. Where "
            "the path comes back and there is no line, "
            f"{'the plan alone holds' if both.has_plan else 'nothing holds'} the visits together.",
            "Verified loop closures from above",
        ),
        captioned(
            charts.matches_plot(keyframe_idx, by_frame),
            f"<strong>Matched points of each keyframe.</strong>{none}",
            "Matched points of each keyframe",
        ),
    ]
    return f'<h2>Matches</h2><div class="pair">{"".join(pictures)}</div>'


def _front(shown: maps.ScannedWall) -> str:
    return captioned(
        maps.wall_front(shown),
        f"<strong>No.{formatting.SPACE}{shown.number}:</strong> "
        f"{escape(in_words(shown.wall, shown.verdict))}",
        f"Wall {shown.number} from the front, by distance from where it is drawn",
    )


def _share_beyond(side: Measures, end_m: float) -> float:
    """Share of wall points further than a distance from the plan."""
    return 0.0 if side.walls is None else float(np.mean(side.walls.nearest_m > end_m))


def sensor_section(result: RefineResult) -> str:
    """Parameters with standard deviations, and the error of depth over distance, before and after.

    Nothing where nothing was looked for.
    """
    rows = result.sensor_parameters
    if all(row.sigma is None for row in rows):
        return ""
    farthest_m = farthest_point_m(result)
    picture = captioned(
        charts.depth_error_plot(result.calibration, farthest_m),
        "<strong>Error of the depth over distance,</strong> as found: before, and after the correction. "
        f"Shaded: one standard deviation. Points were seen up to {formatting.length(farthest_m, '.1f')}.",
        "Error of measured depth over distance, before and after",
    )
    names = ("parameter", "found", "sigma", "")
    cells = [(escape(row.name), _number(row, row.found), _sigma(row), _state(row)) for row in rows]
    return (
        f"<h2>The sensor</h2><p>{escape(_sensor_words(rows))}</p>"
        f'<div class="pair"><div>{table(names, cells, "wnnw")}</div>{picture}</div>'
    )


def farthest_point_m(result: RefineResult) -> float:
    """Depth below which all but a thousandth of the points of the solve lie, within the plot's limits."""
    structure, matches = result.structure, result.matches
    depths = np.concatenate(
        [
            points[:, 2]
            for points in (
                structure.floor.points_cam,
                structure.walls.points_cam,
                structure.ceiling.points_cam,
                matches.points_a,
                matches.points_b,
            )
        ]
    )
    known = depths[np.isfinite(depths)]
    far = float(np.percentile(known, 99.9)) if len(known) else charts.FAR_M
    return float(np.clip(far, 2 * charts.NEAR_M, charts.FAR_M))


def _sensor_words(rows: Sequence[SensorParameter]) -> str:
    said = "; ".join(sentences_of(sensor_findings(rows)))
    if said:
        return f"{said[0].upper()}{said[1:]}."
    return (
        "Depth and camera are as the scan's files say, as far as matches, floor, recorded motion and walls "
        "can tell: nothing was corrected."
    )


def _number(row: SensorParameter, value: float) -> str:
    rounded = round(value, _DIGITS[row.unit]) + 0.0  # + 0.0: no "-0.0"
    text = f"{rounded:.{_DIGITS[row.unit]}f}".replace("-", formatting.MINUS)
    return f"{text}{formatting.SPACE}{row.unit}" if row.unit else text


def _sigma(row: SensorParameter) -> str:
    return "n/a" if row.sigma is None else _number(row, row.sigma)


def _state(row: SensorParameter) -> str:
    if row.is_kept:
        return "<strong>corrected</strong>"
    if row.is_implausible:
        return (
            "not believed"
            if row.p_sensor is None
            else f"not corrected ({row.p_sensor:.0%} the sensor's)"
        )
    return "held" if row.sigma is None else "left alone"


def items_with_photos(
    items: Iterable[tuple[Finding, str]], result: RefineResult, pictures: Mapping[int, bytes]
) -> str:
    """List items of findings and their words (HTML), with photos where there are some: few beside each, and
    twice as many in all.
    """
    left, html = 2 * FEW_NAMED, []
    for finding, words in items:
        frames = list(dict.fromkeys(frames_to_show(finding, result, pictures)))
        frames = frames[: min(left, FEW_NAMED)]
        left -= len(frames)
        photos = "".join(_photo(frame, pictures[frame]) for frame in frames)
        html.append(
            f"<li>{words}" + (f'<div class="photos">{photos}</div>' if photos else "") + "</li>"
        )
    return "".join(html)


def frames_to_show(
    finding: Finding, result: RefineResult, pictures: Mapping[int, bytes]
) -> Iterator[int]:
    """Of each run of frames the one in its middle that has a picture; of each wall the one whose piece of
    wall lies nearest to it."""
    if not pictures or finding.subject:
        return
    pictured = np.array(sorted(pictures))
    for first, last in finding.frames:
        inside = pictured[(pictured >= first) & (pictured <= last)]
        if len(inside):
            yield int(inside[len(inside) // 2])
    if finding.faces and result.floorplan is not None:
        yield from _frames_that_see(finding.faces, result, pictured)


def _frames_that_see(
    faces: tuple[int, ...], result: RefineResult, pictured: np.ndarray
) -> Iterator[int]:
    plan, patches = result.floorplan, result.structure.walls
    assert plan is not None
    normals, ends = wall_patches_in_plan(patches, result.plan_from_cams)
    is_pictured = np.isin(patches.frame_idx, pictured)
    for face in faces:
        off = ends.mean(axis=1) - plan.ends[face].mean(axis=0)
        along = np.abs(off @ (plan.ends[face, 1] - plan.ends[face, 0])) / plan.lengths[face]
        facing = np.abs(normals @ plan.normals[face])
        sees = is_pictured & (facing > np.cos(np.deg2rad(PATCH_TURN_MOST_DEG.value)))
        sees &= np.abs(off @ plan.normals[face]) < WALL_MOVED_MOST_M.value
        sees &= along < plan.lengths[face] / 2
        if sees.any():
            yield int(patches.frame_idx[sees][np.argmin(along[sees])])


def _photo(frame: int, jpeg: bytes) -> str:
    data = base64.b64encode(jpeg).decode("ascii")
    return (
        f'<figure><img src="data:image/jpeg;base64,{data}" alt="image of frame {frame}">'
        f'<figcaption>frame <span data-frame="{frame}">{frame}</span></figcaption></figure>'
    )
