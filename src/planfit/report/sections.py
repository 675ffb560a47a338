"""Parts of the report that are pictures, with the words a reader needs to judge them."""

import base64
from collections.abc import Sequence
from html import escape

import numpy as np

from planfit.floorplan import Floorplan
from planfit.matching import Matches
from planfit.pipeline import validation as checks
from planfit.pipeline.refine import RefineResult
from planfit.report import amounts, figures, tables
from planfit.report.close_ups import choose_close_ups
from planfit.report.cross_sections import CrossSection, cut_walls, draw_section
from planfit.report.drawing import AGREES, NOT_SEEN, PANEL_IN, SHIFTED, UNMATCHED, Picture
from planfit.report.links import loop_map, loops_of, matches_by_frame, matches_plot
from planfit.report.measures import BeforeAfter, Measures
from planfit.report.missing_walls import undrawn_walls, unseen_faces
from planfit.report.overlay import WIDE_IN, fit_in_words, is_wide, side_picture
from planfit.report.top_view import Crop, Mark
from planfit.report.wall_table import wall_table
from planfit.report.walls import AGREES_WITHIN_M, FEW_PATCHES, SeenFace, seen_faces


def overview(floorplan: Floorplan, both: BeforeAfter, crop: Crop) -> str:
    """The whole scan on the plan, before and after, and close-ups."""
    marks = choose_close_ups(both, crop)
    pictures = [
        _figure(
            side_picture(floorplan, both, side, crop, marks, _width_in(crop)),
            f"<strong>{name}:</strong> {escape(fit_in_words(both, side))}",
            f"Wall points {name} on the plan, from above",
        )
        for name, side in _sides(both)
    ]
    if both.is_placed:
        words = (
            "Seen from above. Each coloured dot is a scanned point of a wall; thin dark lines are "
            "the walls as drawn. Where the poses are right, dots lie on the lines, and one wall "
            "makes one line of dots, not several. Where the camera path runs through a drawn wall, "
            "there is an opening that the plan does not show, or the poses are wrong there."
        )
    else:
        words = "Seen from above. The scan was not placed on the plan, so the plan is not drawn."
    html = [f"<h2>The scan on the plan</h2><p>{words}</p>{_side_by_side(pictures, crop)}"]
    if marks:
        html.append(
            "<h3>Close-ups</h3><p>The places marked above, where before and after differ most.</p>"
        )
        html += [_close_up(floorplan, both, mark) for mark in marks]
    return "\n".join(html)


def fit_and_correction(both: BeforeAfter) -> str:
    """How far wall points are from the plan, and how each frame was moved."""
    parts = []
    if both.has_walls:
        picture, end = figures.distance_histogram(both)
        beyond = [float(np.mean(side.sample_distances > end)) for _, side in _sides(both)]
        parts.append(
            _figure(
                picture,
                "<strong>Distance of wall points to the plan.</strong> The more of them on the "
                f"left, the better the fit. Dashed: the {checks.NEAR_FACE_M:.2f}{amounts.SPACE}m "
                f"of the key figures. Beyond {end:.1f}{amounts.SPACE}m lie "
                f"{amounts.share(beyond[0])} of the points before and "
                f"{amounts.share(beyond[1])} after.",
                "Histogram of distances of wall points to the plan, before and after",
            )
        )
    shift = float(np.linalg.norm(both.correction[:, 3:], axis=1).max(initial=0.0))
    turn = float(np.rad2deg(np.linalg.norm(both.correction[:, :3], axis=1).max(initial=0.0)))
    parts.append(
        _figure(
            figures.correction_plot(both),
            "<strong>Correction of each frame,</strong> from the recorded to the refined pose: at "
            f"most {amounts.length(shift)} and {turn:.1f}{amounts.SPACE}deg. Slow waves are drift "
            "that was taken out. A jump is to be expected at a gap in the path; elsewhere it "
            "deserves a look at that frame.",
            "Shift and turn of each frame",
        )
    )
    return f'<h2>Fit and correction</h2><div class="pair">{"".join(parts)}</div>'


def floor(floorplan: Floorplan, both: BeforeAfter, crop: Crop) -> str:
    """Heights of the floor, before and after."""
    if not both.has_floor:
        return "<h2>Floor</h2><p>No floor was seen in this scan.</p>"
    maps = []
    for name, side in _sides(both):
        maps.append(
            _figure(
                figures.floor_map(
                    floorplan if both.is_placed else None, side, crop, _width_in(crop)
                ),
                f"<strong>{name}:</strong> half of the floor points lie within "
                f"{amounts.length(side.floor_median)} of the floor plane; RMS "
                f"{amounts.length(side.floor_rms)} about their mean",
                f"Floor heights {name}",
            )
        )
    limit = f"{figures.FLOOR_RANGE_M:.1f}{amounts.SPACE}m"
    return (
        "<h2>Floor</h2><p>Height of the scanned floor: red is above the floor plane, blue below, "
        f"colours end at ±{limit}. A flat floor is white all over. Slopes, and steps where the "
        "path comes back to a place, show that cameras drifted in height or tilt. What lies on the "
        "floor and was taken for floor stays red, however good the poses are.</p>"
        f"{_side_by_side(maps, crop)}"
    )


def walls(floorplan: Floorplan, result: RefineResult, crop: Crop) -> str:
    """Which walls of the plan were seen, and how far each is from where it is drawn."""
    n_patches = len(result.structure.walls)
    if n_patches == 0:
        return "<h2>Walls of the plan</h2><p>No flat piece of wall was seen in this scan.</p>"
    faces = seen_faces(floorplan, result.walls)
    association = result.walls.association
    n_lost = n_patches - association.n_associated
    keys = (
        (AGREES, "agrees with the scan"),
        (SHIFTED, "scanned elsewhere (number: see table)"),
        (UNMATCHED, "scanned, but not on the plan"),
        (NOT_SEEN, "drawn, but not scanned"),
    )
    legend = " ".join(
        f'<span class="entry"><span class="key" style="background:{color}"></span>{words}</span>'
        for color, words in keys
    )
    picture = _figure(
        figures.wall_map(floorplan, result, faces, crop, _width_in(crop)),
        legend,
        "Walls of the plan by agreement with the scan",
    )
    html = [
        f"<h2>Walls of the plan</h2><p>{escape(_walls_in_words(faces))} {n_lost} of {n_patches} "
        "flat pieces of scanned wall found no wall on the plan: furniture, what the plan does not "
        f"draw, or walls that were moved.</p>{_side_by_side([picture], crop)}"
    ]
    cuts = cut_walls(floorplan, result, faces)
    if cuts:
        html.append(
            "<h3>Walls cut across</h3><p>The walls that changed most, seen along themselves: each dot "
            "is a scanned point, the dark line the wall as drawn, and distances from it are stretched. "
            "A wall that was scanned twice makes two upright bands before; after, one.</p>"
            f'<div class="pair">{"".join(_cut(cut) for cut in cuts)}</div>'
        )
    undrawn = undrawn_walls(result.structure.walls, association, result.plan_from_cams)
    unseen = unseen_faces(floorplan, association, crop)
    if faces or undrawn:
        html.append(
            "<h3>Wall by wall</h3>"
            f"<p>{len(faces)} seen, {len(undrawn)} missing in the plan, {len(unseen)} not seen. Press a "
            "head to sort. Offset: median distance of the scanned "
            "pieces of a wall from where it is drawn, after the fit; positive towards the room, "
            "negative into the wall. Spread: median deviation of the pieces from that. Walls with most "
            "pieces come first, then what was scanned but is missing in the plan (furniture, too, where "
            "it stands like a wall), then walls of the part shown above that were not seen.</p>"
            f"{wall_table(faces, undrawn, unseen, floorplan)}"
        )
    return "\n".join(html)


def links(floorplan: Floorplan, both: BeforeAfter, matches: Matches, crop: Crop) -> str:
    """Revisits, and matched points of each frame."""
    n_frames = len(both.after.trajectory)
    loops = loops_of(matches, tables.LOOP_MIN_FRAMES)
    by_frame = matches_by_frame(matches, n_frames)
    plan_ends = floorplan.ends if both.is_placed else np.zeros((0, 2, 2))
    n_none = int(np.sum(by_frame == 0))
    none = (
        f" {n_none} of {n_frames} {_plural(n_none, 'has', 'have')} none: only the recorded motion, "
        "floor and walls hold them."
        if n_none
        else ""
    )
    pictures = [
        _figure(
            loop_map(plan_ends, both.after.trajectory, loops, crop, PANEL_IN),
            f"<strong>Revisits:</strong> {amounts.count(len(loops))} pairs of frames, more than "
            f"{tables.LOOP_MIN_FRAMES} frames apart, that show the same place. Where the path comes "
            "back and there is no line, the plan alone holds the visits together.",
            "Verified revisits from above",
        ),
        _figure(
            matches_plot(by_frame),
            f"<strong>Matched points of each frame.</strong>{none}",
            "Matched points of each frame",
        ),
    ]
    return f'<h2>Matches</h2><div class="pair">{"".join(pictures)}</div>'


def _cut(section: CrossSection) -> str:
    face = section.face
    apart = [amounts.length(float(np.abs(p[:, 0]).mean())) for p in (section.before, section.after)]
    return _figure(
        draw_section(section),
        f"<strong>No.{amounts.SPACE}{face.number}:</strong> {amounts.count(len(section.after))} "
        f"points, on average {apart[0]} from the drawn wall before and {apart[1]} after",
        f"Wall {face.number} cut across, before and after",
    )


def _close_up(floorplan: Floorplan, both: BeforeAfter, mark: Mark) -> str:
    inside = mark.crop.contains(both.after.sample_xy)
    pictures = []
    for name, side in _sides(both):
        distance = amounts.length(float(side.sample_distances[inside].mean()))
        pictures.append(
            _figure(
                side_picture(floorplan, both, side, mark.crop),
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
    shifted = sorted((f for f in faces if f.is_shifted), key=lambda f: -abs(f.offset))
    few = len(faces) - agree - len(shifted)
    parts = [
        f"Of {len(faces)} walls of the plan that were seen, {agree} agree with the scan within "
        f"{100 * AGREES_WITHIN_M:.0f}{amounts.SPACE}cm."
    ]
    if shifted:
        told = ", ".join(f"No.{amounts.SPACE}{f.number} ({f.verdict})" for f in shifted[:3])
        more = " and others" if len(shifted) > 3 else ""
        parts.append(
            f"{len(shifted)} {_plural(len(shifted), 'lies', 'lie')} elsewhere: {told}{more}."
        )
    if few:
        parts.append(
            f"{few} {_plural(few, 'seems', 'seem')} to lie elsewhere, but with fewer than "
            f"{FEW_PATCHES} pieces that may be an accident."
        )
    return " ".join(parts)


def _plural(count: int, one: str, many: str) -> str:
    return one if count == 1 else many


def _width_in(crop: Crop) -> float:
    return WIDE_IN if is_wide(crop) else PANEL_IN


def _sides(both: BeforeAfter) -> tuple[tuple[str, Measures], tuple[str, Measures]]:
    return ("before", both.before), ("after", both.after)


def _side_by_side(pictures: Sequence[str], crop: Crop) -> str:
    """Before and after beside each other, or one above the other where both are wide."""
    return f'<div class="{"stack" if is_wide(crop) else "pair"}">{"".join(pictures)}</div>'


def _figure(picture: Picture, caption_html: str, alt: str) -> str:
    data = base64.b64encode(picture.png).decode("ascii")
    return (
        f"<figure><figcaption>{caption_html}</figcaption>"
        f'<img src="data:image/png;base64,{data}" alt="{escape(alt)}" '
        f'width="{picture.width_px}" height="{picture.height_px}"></figure>'
    )
