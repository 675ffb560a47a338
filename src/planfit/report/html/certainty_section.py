"""Sections on what the evidence says: how sure each frame is, and what contradicts what."""

from collections.abc import Sequence
from html import escape

from planfit.adjust.uncertainty import radius_95
from planfit.pipeline.disagreements import Disagreement, EvidenceItem
from planfit.pipeline.result import RefineResult
from planfit.report import formatting
from planfit.report.html import tables
from planfit.report.html.tables import captioned, plural, table
from planfit.report.key_metrics import TruthErrors
from planfit.report.plots import charts


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
        f"<strong>{formatting.length(evidence.predicted_rms_m)} RMS, worst "
        f"{formatting.length(float(evidence.predicted_error_m[worst]))} at frame "
        f'<span data-frame="{worst}">{worst}</span></strong> (frame '
        f"by frame in <code>trajectory_sigma.csv</code>). What was left out is the evidence: {visits}"
        f"walls on {len(seen)} of {len(evidence.stretches)} stretches.</p>"
        f'<div class="pair">{picture}</div><details><summary>Stretch by stretch</summary>'
        "<p>Wall patches on the plan, and beside a drawn wall, where the solve without them puts them.</p>"
        f"{tables.stretch_table(evidence)}</details>"
    )


def disagreement_section(found: Sequence[Disagreement], points: Sequence[str] = ()) -> str:
    """Suspects, the most suspect first.

    Args:
        found: visits and walls.
        points: what is said of control points that the rest contradicts, a sentence each.
    """
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
            formatting.length(each.after_m),
            formatting.length(each.kept_out_m),
            ", ".join(f"{_named(e.item)} by {formatting.length(e.by_m)}" for e in each.eased)
            or "nothing",
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
