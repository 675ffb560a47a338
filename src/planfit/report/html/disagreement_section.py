"""What contradicts what, in the report: evidence that the rest puts elsewhere, and what it stands against."""

from collections.abc import Sequence
from html import escape

from planfit.pipeline.disagreements import Disagreement, EvidenceItem
from planfit.report import formatting
from planfit.report.html.tables import table


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
