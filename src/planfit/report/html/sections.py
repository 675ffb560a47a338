"""Parts of the report that are pictures, with the words a reader needs to judge them."""

import base64
import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from html import escape

import numpy as np

from planfit.adjust.uncertainty import radius_95
from planfit.as_built import AsBuilt
from planfit.evaluation import NEAR_FACE_M
from planfit.floorplan import Floorplan
from planfit.pipeline.result import RefineResult
from planfit.report import formatting
from planfit.report.html import tables
from planfit.report.html.as_built_section import as_built_section
from planfit.report.key_metrics import TruthErrors
from planfit.report.measures import BeforeAfter, Measures
from planfit.report.plots import charts
from planfit.report.plots.charts import (
    loop_closure_map,
    loop_closures_of,
    matches_by_frame,
    matches_plot,
)
from planfit.report.plots.close_ups import choose_close_ups
from planfit.report.plots.cross_sections import CrossSection, cut_walls, draw_section
from planfit.report.plots.drawing import (
    AGREES,
    DISPLACED,
    NOT_SEEN,
    PANEL_IN,
    UNMATCHED,
    Picture,
    Side,
)
from planfit.report.plots.overlay import WIDE_IN, fit_in_words, is_wide, side_picture
from planfit.report.plots.top_view import Crop, Mark
from planfit.report.walls import (
    AGREES_WITHIN_M,
    FEW_PATCHES,
    SeenFace,
    seen_faces,
)


def overview(floorplan: Floorplan | None, both: BeforeAfter, crop: Crop, storey: str = "") -> str:
    """The whole scan on the plan, or alone, before and after, and close-ups; or a storey of it, by name."""
    marks = choose_close_ups(both, crop)
    pictures = [
        captioned(
            _of_side(name, side_picture(floorplan, both, side, crop, marks, _width_in(crop))),
            f"<strong>{name}:</strong> {escape(fit_in_words(both, side))}",
            f"{'Wall points' if both.has_plan else 'The scan'} {name}, from above",
        )
        for name, side in _sides(both)
    ]
    if not both.has_plan:
        words = (
            "Seen from above: points at about the height of the camera, walls and furniture. Where the poses "
            "are right, one wall makes one line of dots, not several, and corners are sharp."
        )
    elif both.is_aligned:
        words = (
            "Seen from above. Each coloured dot is a scanned point of a wall; thin dark lines are "
            "the walls as drawn. Where the poses are right, dots lie on the lines, and one wall "
            "makes one line of dots, not several. Where the camera path runs through a drawn wall, "
            "there is an opening that the plan does not show, or the poses are wrong there."
        )
    else:
        words = "Seen from above. The scan was not aligned with the plan, so the plan is not drawn."
    head = storey or ("The scan on the plan" if both.has_plan else "The scan from above")
    html = [f"<h2>{head}</h2><p>{words}</p>{_side_by_side(pictures, crop)}"]
    if marks and floorplan is not None:
        html.append(
            "<h3>Close-ups</h3><p>The windows marked above, where before and after differ most.</p>"
        )
        html += [_close_up(floorplan, both, mark) for mark in marks]
    return "\n".join(html)


def certainty(result: RefineResult, truth: TruthErrors | None) -> str:
    """Predicted error of each frame, and what it rests on, stretch by stretch."""
    evidence = result.evidence
    true_m = truth.after_by_frame_m if truth else None
    known = " Dotted: the true error." if true_m is not None else ""
    named = " Shaded: frames with a reservation." if result.verdict.reservations else ""
    picture = captioned(
        charts.certainty_plot(
            result.verdict, radius_95(evidence.pose_covariances[:, 3:, 3:]), true_m
        ),
        "<strong>Predicted error of each camera position:</strong> one standard deviation, and the "
        f"radius that holds the true position in 95 of 100 frames.{named}{known}",
        "Predicted error of each frame",
    )
    worst, seen = evidence.worst_frame, [s for s in evidence.stretches if s.n_patches]
    visits = (
        f"{len(evidence.visits)} {_plural(len(evidence.visits), 'time', 'times')} a place is seen again, "
        if evidence.visits
        else "no place is seen again, "
    )
    return (
        "<h2>How sure each frame is</h2><p>The scan was solved again several times, each time without some "
        "of the places that are seen again and without the walls of some stretches of the walk. How far the "
        "poses move then, how far measurements lie from where the result puts them, and what is not known "
        "of the sensor and the plan's scale, give the error that is to be expected: "
        f"<strong>{formatting.length(evidence.predicted_rms_m)} RMS, worst "
        f"{formatting.length(float(evidence.predicted_error_m[worst]))} at frame "
        f'<span data-frame="{worst}">{worst}</span></strong> (frame '
        f"by frame in <code>trajectory_sigma.csv</code>). What was left out is the evidence: {visits}"
        f"walls on {len(seen)} of {len(evidence.stretches)} stretches.</p>"
        f'<div class="pair">{picture}</div><details><summary>Stretch by stretch</summary>'
        "<p>Wall patches on the plan, and beside a drawn wall, where the solve without them puts them.</p>"
        f"{tables.stretch_table(evidence)}</details>"
    )


def fit_and_correction(both: BeforeAfter) -> str:
    """How far wall points are from the plan, and how each frame was moved."""
    parts = []
    if both.has_walls:
        picture, end = charts.distance_histogram(both)
        beyond = [_share_beyond(side, end) for _, side in _sides(both)]
        parts.append(
            captioned(
                picture,
                "<strong>Distance of wall points to the plan.</strong> The more of them on the "
                f"left, the better the fit. Dashed: the {NEAR_FACE_M:.2f}{formatting.SPACE}m "
                f"of the key metrics. Beyond {end:.1f}{formatting.SPACE}m lie "
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
    maps = []
    for name, side in _sides(both):
        maps.append(
            captioned(
                _of_side(
                    name,
                    charts.floor_map(
                        floorplan if both.is_aligned else None, side, crop, _width_in(crop)
                    ),
                ),
                f"<strong>{name}:</strong> half of the floor points lie within "
                f"{formatting.length(side.floor and side.floor.height_median_m)} of their median height; RMS "
                f"{formatting.length(side.floor and side.floor.height_rms_m)} about their mean",
                f"Floor heights {name}",
            )
        )
    limit = f"{charts.FLOOR_RANGE_M:.1f}{formatting.SPACE}m"
    return (
        "<h2>Floor</h2><p>Height of the scanned floor: red is above the floor plane, blue below, "
        f"colours end at ±{limit}. A flat floor is white all over. Slopes, and steps where the "
        "path comes back to a place, show that cameras drifted in height or tilt. What lies on the "
        "floor and was taken for floor stays red, however good the poses are.</p>"
        f"{_side_by_side(maps, crop)}"
    )


def walls(
    floorplan: Floorplan, result: RefineResult, crop: Crop, as_built: AsBuilt | None = None
) -> str:
    """Which walls of the plan the fit used, and, where verdicts are given, how each was built."""
    n_patches = len(result.structure.walls)
    if n_patches == 0:
        judged = "" if as_built is None else as_built_section(as_built, crop)
        return f"<h2>Walls of the plan</h2><p>No wall patch was seen in this scan.</p>{judged}"
    faces = seen_faces(floorplan, result.adjustment, as_built)
    association = result.adjustment.association
    n_lost = n_patches - association.n_associated
    keys = (
        (AGREES, "agrees with the scan"),
        (DISPLACED, "scanned elsewhere, with its number"),
        (UNMATCHED, "scanned, but not on the plan"),
        (NOT_SEEN, "drawn, but not scanned"),
    )
    legend = " ".join(
        f'<span class="entry"><span class="key" style="background:{color}"></span>{words}</span>'
        for color, words in keys
    )
    picture = captioned(
        charts.wall_map(floorplan, result, faces, crop, _width_in(crop)),
        legend,
        "Walls of the plan by agreement with the scan",
    )
    html = [
        f"<h2>Walls of the plan</h2><p>{escape(_walls_in_words(faces))} {n_lost} of {n_patches} "
        "wall patches of the scan found no wall on the plan: furniture, what the plan does not "
        f"draw, or walls that were moved.</p>{_side_by_side([picture], crop)}"
    ]
    cuts = cut_walls(floorplan, result, faces)
    if cuts:
        html.append(
            "<h3>Cross-sections of walls</h3><p>The walls that changed most, seen along themselves: each dot "
            "is a scanned point, the dark line the wall as drawn, and distances from it are stretched. "
            "A wall that was scanned twice makes two upright bands before; after, one.</p>"
            f'<div class="pair">{"".join(_cut(cut) for cut in cuts)}</div>'
        )
    if as_built is not None:
        html.append(as_built_section(as_built, crop, faces))
    return "\n".join(html)


def frame_matches(
    floorplan: Floorplan | None, both: BeforeAfter, result: RefineResult, crop: Crop
) -> str:
    """Loop closures, and matched points of each keyframe."""
    keyframe_idx, matches = result.solved_frame_idx, result.matches
    n_frames = len(keyframe_idx)
    loop_closures = loop_closures_of(matches, tables.LOOP_MIN_FRAMES, keyframe_idx)
    by_frame = matches_by_frame(matches, len(both.after.trajectory))[keyframe_idx]
    plan_ends = np.zeros((0, 2, 2))
    if floorplan is not None and both.is_aligned:
        plan_ends = floorplan.ends
    others = "floor and walls hold" if both.has_plan else "and floor hold"
    n_none = int(np.sum(by_frame == 0))
    none = (
        f" {n_none} of {n_frames} keyframes {_plural(n_none, 'has', 'have')} none: only the recorded motion, "
        f"{others} them."
        if n_none
        else ""
    )
    pictures = [
        captioned(
            loop_closure_map(
                plan_ends, both.after.trajectory, loop_closures, crop, PANEL_IN, both.scans
            ),
            f"<strong>Loop closures:</strong> {formatting.count(len(loop_closures))} pairs of frames, more "
            f"than {tables.LOOP_MIN_FRAMES} keyframes apart, that see the same part of the building. Where "
            "the path comes back and there is no line, "
            f"{'the plan alone holds' if both.has_plan else 'nothing holds'} the visits together.",
            "Verified loop closures from above",
        ),
        captioned(
            matches_plot(keyframe_idx, by_frame),
            f"<strong>Matched points of each keyframe.</strong>{none}",
            "Matched points of each keyframe",
        ),
    ]
    return f'<h2>Matches</h2><div class="pair">{"".join(pictures)}</div>'


def _cut(section: CrossSection) -> str:
    face = section.face
    apart = [
        formatting.length(float(np.abs(p[:, 0]).mean())) for p in (section.before, section.after)
    ]
    return captioned(
        draw_section(section),
        f"<strong>No.{formatting.SPACE}{face.number}:</strong> {formatting.count(len(section.after))} "
        f"points, on average {apart[0]} from the drawn wall before and {apart[1]} after",
        f"Wall {face.number} cut across, before and after",
    )


def _close_up(floorplan: Floorplan, both: BeforeAfter, mark: Mark) -> str:
    inside = mark.crop.contains(both.after.wall_xy)
    pictures = []
    for name, side in _sides(both):
        distance = formatting.length(float(side.wall_distances_m[inside].mean()))
        pictures.append(
            captioned(
                _of_side(name, side_picture(floorplan, both, side, mark.crop)),
                f"<strong>{mark.letter}, {name}:</strong> these wall points lie {distance} from "
                "the plan on average",
                f"Close-up {mark.letter} {name}",
            )
        )
    return f'<div class="pair">{"".join(pictures)}</div>'


def _walls_in_words(faces: Sequence[SeenFace]) -> str:
    if not faces:
        return "No wall of the plan was recognised in the scan."
    agree = sum(face.agrees for face in faces)
    displaced = sorted((f for f in faces if f.is_displaced), key=lambda f: -abs(f.offset))
    few = len(faces) - agree - len(displaced)
    parts = [
        f"Of {len(faces)} walls of the plan that were seen, {agree} agree with the scan within "
        f"{100 * AGREES_WITHIN_M:.0f}{formatting.SPACE}cm."
    ]
    if displaced:
        told = ", ".join(f"No.{formatting.SPACE}{f.number} ({f.verdict})" for f in displaced[:3])
        more = " and others" if len(displaced) > 3 else ""
        parts.append(
            f"{len(displaced)} {_plural(len(displaced), 'lies', 'lie')} elsewhere: {told}{more}."
        )
    if few:
        parts.append(
            f"{few} {_plural(few, 'seems', 'seem')} to lie elsewhere, but with fewer than "
            f"{FEW_PATCHES} patches that may be an accident."
        )
    return " ".join(parts)


def _plural(count: int, one: str, many: str) -> str:
    return one if count == 1 else many


def _width_in(crop: Crop) -> float:
    return WIDE_IN if is_wide(crop) else PANEL_IN


def _of_side(side: Side, picture: Picture) -> Picture:
    """A picture in which frames are pressed where they are on that side."""
    if picture.clicks is None:
        return picture
    return replace(picture, clicks=replace(picture.clicks, side=side))


def _sides(both: BeforeAfter) -> tuple[tuple[Side, Measures], tuple[Side, Measures]]:
    return ("before", both.before), ("after", both.after)


def _side_by_side(pictures: Sequence[str], crop: Crop) -> str:
    """Before and after beside each other, or one above the other where both are wide."""
    return f'<div class="{"stack" if is_wide(crop) else "pair"}">{"".join(pictures)}</div>'


def _share_beyond(side: Measures, end_m: float) -> float:
    """Share of wall points further than a distance from the plan."""
    return 0.0 if side.walls is None else float(np.mean(side.walls.nearest_m > end_m))


def captioned(picture: Picture, caption_html: str, alt: str) -> str:
    """A picture inside the page, its caption above it."""
    data = base64.b64encode(picture.png).decode("ascii")
    clicks = ""
    if picture.clicks is not None:
        clicks = f'data-clicks="{escape(json.dumps(asdict(picture.clicks)))}" '
    return (
        f"<figure><figcaption>{caption_html}</figcaption>"
        f'<img src="data:image/png;base64,{data}" alt="{escape(alt)}" {clicks}'
        f'width="{picture.width_px}" height="{picture.height_px}"></figure>'
    )
