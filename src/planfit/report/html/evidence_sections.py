"""Sections on evidence: how sure each frame is, and what contradicts what; the registration, fit and
held-out residuals side by side, with the accuracy; residuals of control and check points, both apart and of
each point."""

from collections.abc import Sequence
from html import escape
from math import isfinite

import numpy as np

from planfit.adjust.uncertainty import radius_95
from planfit.pipeline.disagreements import Disagreement, EvidenceItem
from planfit.pipeline.links import Link, Visit
from planfit.pipeline.registration import Registration, RegistrationRow
from planfit.pipeline.result import RefineResult
from planfit.pipeline.strength import DirectionStrength
from planfit.report.formatting import SPACE, length, quantity, share
from planfit.report.html import tables
from planfit.report.html.tables import captioned, plural, table
from planfit.report.measures import TruthErrors
from planfit.report.plots import charts
from planfit.survey import PointResidual, RoleResiduals, SurveyResiduals
from planfit.units import bare, column


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
        f"{len(evidence.visits)} {plural(len(evidence.visits), 'time', 'times')} a place is seen again, "
        if evidence.visits
        else "no place is seen again, "
    )
    return (
        "<h2>How sure each frame is</h2><p>The scan was solved again several times, each time without some "
        "of the places that are seen again and without the walls of some stretches of the walk. How far the "
        "poses move then, how far measurements lie from where the result puts them, and what is not known "
        "of the sensor and the plan's scale, give the error that is to be expected: "
        f"<strong>{length(evidence.predicted_rms_m)} RMS, worst "
        f"{length(float(evidence.predicted_error_m[worst]))} at frame "
        f'<span data-frame="{worst}">{worst}</span></strong> (frame '
        f"by frame in <code>trajectory_sigma.csv</code>). What was left out is the evidence: {visits}"
        f"walls on {len(seen)} of {len(evidence.stretches)} stretches.</p>"
        f'<div class="pair">{picture}</div><details><summary>Stretch by stretch</summary>'
        "<p>Wall patches on the plan, and beside a drawn wall, where the solve without them puts them.</p>"
        f"{tables.stretch_table(evidence)}</details>"
    )


def disagreement_section(found: Sequence[Disagreement], points: Sequence[str] = ()) -> str:
    """Suspects, the most suspect first; and a sentence for each control point that the rest contradicts."""
    told = "".join(f"<li>{escape(words)}</li>" for words in points)
    of_points = f"<ul>{told}</ul>" if told else ""
    if not found:
        words = "Nothing: each visit and each wall is about where the solves without it put it."
        if points:
            words = "Each visit and each wall is about where the solves without it put it, but:"
        return f"<h3>What contradicts what</h3><p>{words}</p>{of_points}"
    heads = ("evidence", "off in the result", "off by the rest", "fits better without it")
    rows = [
        (
            _named(each.item),
            length(each.after_m),
            length(each.kept_out_m),
            ", ".join(f"{_named(e.item)} by {length(e.by_m)}" for e in each.eased) or "nothing",
        )
        for each in found
    ]
    return (
        "<h3>What contradicts what</h3><p>The rest of the evidence puts these elsewhere: each was left out "
        "alone, and the scan solved again. What then fits better is what it stands against, and one of the "
        "two is wrong; where nothing does, nothing was bent by it. Images of the frames tell which: "
        "<code>planfit view</code> shows them, and deletes a loop or leaves out a wall.</p>"
        f"{table(heads, rows, 'wnnw')}{of_points}"
    )


def _named(item: EvidenceItem) -> str:
    """In words, its frames or its wall to be pressed."""
    if item.face_idx is not None:
        return f'<span data-wall="{item.face_idx}">{escape(item.words)}</span>'
    words = escape(item.words)
    for frames in (item.first_frames, item.last_frames):
        if frames is not None:
            run = f"{frames[0]}-{frames[1]}"
            link = f'<span data-frame="{frames[0]}">{frames[0]}</span>\u2013'
            link += f'<span data-frame="{frames[1]}">{frames[1]}</span>'
            words = words.replace(run, link, 1)
    return words


MAX_ROWS = 20
"""Loops on the page, and links."""


def registration_section(registration: Registration) -> str:
    """What a surveyor looks for first."""
    heads = ("", "before", "fit", "held out", "number")
    rows = table(heads, [_residual_row(row) for row in registration.rows], "wnnnn")
    stated = "No accuracy is stated."
    if registration.stated_95_m is not None:
        by_checks = ""
        if registration.checked_95_m is not None:
            by_checks = f", by check points {length(registration.checked_95_m, '.3f')}"
        stated = (
            f"<strong>Accuracy at 95{SPACE}%: {length(registration.stated_95_m, '.3f')}, USIBD "
            f"{registration.loa}</strong> (predicted "
            f"{length(registration.predicted_95_m, '.3f')}{by_checks})."
        )
    basis = registration.basis[0].upper() + registration.basis[1:]
    return (
        "<h2>Registration</h2><p>How well something fits that was fitted is no accuracy: what is held out "
        f"had no say in the poses. {stated} {escape(basis)}. Of camera positions; points add the error of "
        "depth. Also in <code>registration.csv</code>.</p>"
        f"{rows if registration.rows else ''}"
        f"{_strength(registration.strength)}{_loops(registration.loops)}"
        f"{_links(registration.links)}"
    )


def _strength(strength: Sequence[DirectionStrength]) -> str:
    """What fixes each direction, in words."""
    if not strength:
        return ""
    rows = [
        (
            escape(each.direction),
            quantity(each.sigma, each.unit),
            escape(_shares(each.shares)),
            f"frames {_frames(each.weakest_frames)} ({share(each.weakest_share)} of the median)",
        )
        for each in strength
    ]
    return (
        "<h3>What fixes each direction</h3><p>Each stretch of the walk as one body, all else held: how much "
        "of what resists when it is moved or turned is of which kind, mean over stretches; and the stretch "
        "that is held least. Axes of the plan, z up.</p>"
        + table(("", "predicted sigma", "fixed by", "weakest stretch"), rows, "wnww")
    )


def _shares(shares: Sequence[tuple[str, float]]) -> str:
    named = [f"{share(value)} {name}" for name, value in shares if round(100 * value)]
    return ", ".join(named) or "nothing"


def _loops(loops: Sequence[Visit]) -> str:
    """The error of each loop, the worst first."""
    if not loops:
        return ""
    rows = [
        (
            _frames(loop.first_frames),
            _frames(loop.last_frames),
            quantity(loop.mean_m, "m"),
            quantity(loop.after_m, "m"),
            quantity(loop.kept_out_m, "m"),
            length(loop.way_m),
            str(loop.n_points),
        )
        for loop in loops[:MAX_ROWS]
    ]
    heads = ("frames", "seen again", "mean", "median", "held out", "way between", "points")
    return (
        "<h3>Error of each loop</h3><p>Distance between both sightings of the points of a place that was "
        "seen again, by the result; held out: the median by a solve without this loop. The worst come first"
        f"{_more(loops)}.</p>{table(heads, rows, 'wwnnnnn')}"
    )


def _links(links: Sequence[Link]) -> str:
    """Overlap and error of each link, the worst first."""
    if not links:
        return ""
    rows = [
        (
            _frames(link.first_frames),
            _frames(link.last_frames),
            share(link.overlap) if isfinite(link.overlap) else "",
            quantity(link.before_m, "m"),
            quantity(link.after_m, "m"),
            str(link.n_points or ""),
            str(link.n_pairs),
        )
        for link in links[:MAX_ROWS]
    ]
    heads = ("frames", "and frames", "overlap", "before", "mean", "points", "pairs")
    return (
        "<h3>Overlap and error of each link</h3><p>Stretches of the walk that are held together by what both "
        "see. Overlap: of the floor, wall and ceiling of the one that sees less, the share that the other "
        "sees too. Error: mean distance between both sightings of a point; where surfaces alone hold a "
        f"link (no points), how far the result is from where they put it. The worst come first{_more(links)}."
        f"</p>{table(heads, rows, 'wwnnnnn')}"
    )


def _more(of: Sequence[object]) -> str:
    more = len(of) - MAX_ROWS
    return f"; {more} more are in <code>registration.csv</code>" if more > 0 else ""


def _frames(frames: tuple[int, int]) -> str:
    return " to ".join(f'<span data-frame="{i}">{i}</span>' for i in frames)


def _residual_row(row: RegistrationRow) -> tuple[str, ...]:
    amounts = (
        "" if v is None else quantity(v, row.unit) for v in (row.before, row.fit, row.held_out)
    )
    return (escape(row.name), *amounts, str(row.count))


def survey_section(survey: SurveyResiduals | None) -> str:
    """Empty without a survey."""
    if survey is None or not survey.points:
        return ""
    roles = [
        ("control points", survey.control),
        ("control points, each left out", survey.left_out),
        ("check points", survey.check),
    ]
    sums = [_role_row(name, role) for name, role in roles if role is not None]
    judged = (
        "Check points took no part: their residuals are the error of the result there, but for the sigmas "
        "of the points and of depth."
        if survey.check is not None
        else "There are no check points. How well control points fit is no accuracy: they are what the poses "
        "were held to."
    )
    datum = ""
    if survey.height_datum_m is not None:
        datum = f" The floor was found at {length(survey.height_datum_m, '.3f')} of the survey's heights."
    unseen = ""
    if survey.unseen:
        unseen = f"<p>Seen in no frame: {escape(', '.join(survey.unseen))}.</p>"
    heads = ("", "points", *map(column, ("RMS", "horizontal", "height", "worst")), "at")
    of_points = (
        "point", "role", "marks",
        *map(column, ("dx", "dy", "dz", "length", "sigma", "left out", "its sigma")), "sigmas",
    )  # fmt: skip
    each = table(of_points, [_point_row(point) for point in survey.points], "wwnnnnnnnnn")
    return (
        "<h2>Control and check points</h2><p>Found less surveyed, along the axes of the plan. Control points "
        "held the poses; <em>left out</em> is how far the other evidence puts each where it takes no part, "
        "<em>sigmas</em> how many standard deviations that is: a point that is wrong stands out there, while "
        f"in the fit it draws others along. {judged}{datum}</p>{table(heads, sums, 'wnnnnnw')}"
        f"<details open><summary>Point by point</summary>{each}</details>{unseen}"
    )


def _role_row(name: str, role: RoleResiduals) -> tuple[str, ...]:
    lengths_m = (role.rms_m, role.rms_horizontal_m, role.rms_height_m, role.worst_m)
    told = ("" if length_m is None else bare(length_m) for length_m in lengths_m)
    return (name, str(role.count), *told, escape(role.worst_id))


def _point_row(point: PointResidual) -> tuple[str, ...]:
    role = "check" if point.is_check else "control"
    by_axis = (bare(v) if np.isfinite(v) else "" for v in point.residual_m)
    lengths = (bare(point.length_m), bare(point.sigma_m))
    left_out = ("", "", "")
    if point.left_out_m is not None:
        told = (point.left_out_length_m, point.left_out_sigma_m)
        sigmas = f"{point.left_out_sigmas:.1f}" if np.isfinite(point.left_out_sigmas) else ""
        if point.is_contradicted:
            sigmas = f'<span class="worse">{sigmas}</span>'
        left_out = (*(bare(v) if np.isfinite(v) else "" for v in told), sigmas)
    return (escape(point.id), role, str(point.n_marks), *by_axis, *lengths, *left_out)
