"""Openings in the report: their lines on the map of walls as built, and a table of their own."""

from collections.abc import Iterator, Sequence
from html import escape

import numpy as np

from planfit.as_built import (
    AsBuilt,
    AsBuiltOpening,
    OpeningVerdict,
    counted_openings,
    opening_words,
)
from planfit.report import formatting
from planfit.report.html.tables import Cell, sortable_table
from planfit.report.plots import colors
from planfit.report.plots.top_view import Crop

COLORS = {
    OpeningVerdict.OPEN: colors.AGREES,
    OpeningVerdict.CLOSED: colors.BEFORE,
    OpeningVerdict.NOT_SEEN: colors.NOT_SEEN,
    OpeningVerdict.NEW: colors.UNMATCHED,
}
_HEADS = (
    "No.", "verdict", "width", "sigma", "drawn", "shifted", "looked through", "closed", "frames",
    "middle x, y (m)",
)  # fmt: skip


def openings_section(as_built: AsBuilt, crop: Crop) -> str:
    """Words and the table; nothing where no opening is known.

    Args:
        as_built: verdicts.
        crop: part of the plan that is shown.
    """
    shown = shown_openings(as_built, crop)
    if not shown:
        return ""
    counts = counted_openings([opening for _, opening in shown])
    words = ", ".join(f"{count} {escape(verdict.value)}" for verdict, count in counts.items())
    return f"""<section class="openings"><h3>Doors, windows and passages</h3>
<p>Every gap of a wall that the plan draws: open (cameras look through it), closed (by a
shut door, which stands back from the wall, or walled up, flush with it on both sides, or by one of both where
the scan does not tell), or not seen; and openings of walls that the plan draws without. Widths are between
the sides of the wall as seen, with one standard deviation; "shifted" is along the wall. {words}.</p>
{sortable_table(_HEADS, list(_rows(shown)), "openings")}</section>"""


def shown_openings(as_built: AsBuilt, crop: Crop) -> list[tuple[int, AsBuiltOpening]]:
    """Those of the part of the plan that is shown, with their numbers."""
    if not as_built.openings:
        return []
    touched = crop.touches(np.array([opening.ends for opening in as_built.openings]))
    numbered = enumerate(as_built.openings, start=1)
    return [one for one, on in zip(numbered, touched, strict=True) if on]


def opening_title_text(number: int, opening: AsBuiltOpening) -> str:
    """What is told of an opening where it is pointed at, HTML."""
    return escape(f"O{number}: {opening_words(opening)}")


def style_of(opening: AsBuiltOpening) -> str:
    """Class of its row and its line."""
    verdict = opening.verdict
    planned = "" if opening.differs else " as-planned"
    return f"opening opening-{verdict.value.replace(' ', '-')}{planned}"


def _verdict_words(opening: AsBuiltOpening) -> str:
    verdict = opening.verdict
    if verdict is OpeningVerdict.CLOSED and opening.kind != "window":
        return f"{verdict.value}: {opening.closed_by.value}"
    return verdict.value


def _rows(
    shown: Sequence[tuple[int, AsBuiltOpening]],
) -> Iterator[tuple[str, str, tuple[Cell, ...]]]:
    none = Cell.empty()
    for number, opening in shown:
        verdict = opening.verdict
        x, y = map(float, opening.ends.mean(axis=0))
        is_measured = bool(np.isfinite(opening.width_m)) and verdict is not OpeningVerdict.CLOSED
        n_frames = max(opening.n_through_frames, opening.n_surface_frames)
        kind = f" ({escape(opening.kind)})" if opening.kind else ""
        yield (
            style_of(opening),
            "",
            (
                Cell(f"O{number}", number),
                Cell(escape(_verdict_words(opening)) + kind, verdict.value),
                Cell(formatting.length(opening.width_m), opening.width_m) if is_measured else none,
                Cell(formatting.centimetres(opening.width_sigma_m), opening.width_sigma_m)
                if is_measured
                else none,
                Cell(formatting.length(opening.drawn_width_m), opening.drawn_width_m)
                if opening.is_drawn
                else none,
                Cell(formatting.centimetres(opening.shift_m, signed=True), opening.shift_m)
                if is_measured and opening.is_drawn
                else none,
                Cell(formatting.share(round(opening.open_share, 2)), opening.open_share),
                Cell(formatting.share(round(opening.closed_share, 2)), opening.closed_share),
                Cell(str(n_frames), n_frames),
                Cell(f"{x:.1f}, {y:.1f}".replace("-", formatting.MINUS), x),
            ),
        )
