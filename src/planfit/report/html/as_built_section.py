"""The section of the report that holds every wall and opening against its drawing: a map and tables, whose
verdicts follow a tolerance that is chosen on the page (`as_built.js`)."""

from collections.abc import Iterator, Sequence
from html import escape
from typing import TypeVar

import numpy as np
from jaxtyping import Float

from planfit.as_built import (
    SURE_SIGMAS,
    AsBuilt,
    AsBuiltOpening,
    AsBuiltWall,
    ClearWidth,
    OpeningVerdict,
    RoomAsBuilt,
    Verdict,
    counted,
    counted_openings,
    deviations,
    in_words,
    opening_words,
)
from planfit.report import formatting
from planfit.report.html.tables import Cell, color_keys, plural, sortable_table, table
from planfit.report.plots import colors
from planfit.report.plots.top_view import Crop
from planfit.units import INCH_M, area, asked, in_units

Drawn = TypeVar("Drawn", AsBuiltWall, AsBuiltOpening)
COLORS = {
    Verdict.AGREES: colors.AGREES,
    Verdict.MOVED: colors.MOVED,
    Verdict.MISSING: colors.BEFORE,
    Verdict.NEW: colors.UNMATCHED,
    Verdict.NOT_SEEN: colors.NOT_SEEN,
}
"""On the map and in the 3D view (`STATUS_COLORS` of renderer.js)."""
_HEADS = (
    "No.", "verdict", "offset", "sigma", "patches", "frames", "looked through", "length", "middle x, y (m)",
)  # fmt: skip


def as_built_section(as_built: AsBuilt, crop: Crop, rooms: Sequence[RoomAsBuilt] = ()) -> str:
    """Words, the control of the tolerance, a map of the part that was scanned, and the table of the walls of
    which something is known.
    """
    options = as_built.options
    unit, unit_m, step = ("in", INCH_M, 0.125) if asked() == "ft" else ("m", 1.0, 0.005)
    # Walls of a campus that the scan does not come near are in the exports, not on the page.
    shown = _shown(as_built.walls, crop)
    keys = color_keys((color, verdict.value) for verdict, color in COLORS.items())
    counts = counted([as_built.verdict(wall) for _, wall in shown])
    words = ", ".join(f"{count} {escape(verdict.value)}" for verdict, count in counts.items())
    n_walls = len(deviations(as_built))
    length_m = sum(wall.length_m for _, wall in shown if wall.face_idx >= 0)
    seen_m = length_m - sum(
        wall.length_m for _, wall in shown if as_built.verdict(wall) is Verdict.NOT_SEEN
    )
    return f"""<section class="as-built"><h3>As built against as planned</h3>
<p>Every face of the plan half a metre long or more: it agrees, was moved (its offset, positive into the
room, with one standard deviation, what the poses may be off included), is missing (cameras look through where
it should be), or was not seen; and walls that the plan does not draw. Of {in_units(length_m, ".0f")} of
faces in this part of the plan, outer ones among them, {in_units(seen_m, ".0f")} were seen.
At {in_units(options.tolerance_m, "g")}, {n_walls}
{"wall is" if n_walls == 1 else "walls are"} not as planned, both faces of a wall counted as one; a verdict in
italics is not sure: the tolerance lies within {SURE_SIGMAS:g} standard deviations of the offset.
Short bars are doors, windows and passages, listed below.
<code>planfit export RUN --to as-built</code> writes all this as CSV, GeoJSON, DXF and BCF.</p>
<p class="as-built-tools"><label>tolerance <input class="as-built-tolerance" type="number" min="0"
max="{1 / unit_m:.3g}" step="{step:g}"
value="{round(options.tolerance_m / unit_m, 3):g}" data-metres="{unit_m:g}"
data-sure="{SURE_SIGMAS:g}"> {unit}:</label>
<span class="as-built-counts" role="status">{words}</span></p>
<p>{keys}</p>{_map(as_built, shown, crop)}
{sortable_table(_HEADS, list(_rows(as_built, shown)))}</section>
{_openings_section(as_built, crop)}
{_rooms_section(rooms)}"""


def _shown(drawn: Sequence[Drawn], crop: Crop) -> list[tuple[int, Drawn]]:
    """Walls or openings of the part of the plan that is shown, with their numbers."""
    touched = crop.touches(np.array([one.ends for one in drawn]).reshape(-1, 2, 2))
    return [one for one, on in zip(enumerate(drawn, start=1), touched, strict=True) if on]


def _number(number: int, face_idx: int) -> Cell:
    # Walls that the plan lacks have no face: in the 3D view they go by their number.
    wall = face_idx if face_idx >= 0 else -number
    return Cell(f'<span data-wall="{wall}">{number}</span>', number)


def _length(value_m: float) -> Cell:
    return Cell(formatting.length(value_m, ".2f"), value_m)


def _centimetres(value_m: float, is_known: bool = True, signed: bool = False) -> Cell:
    return Cell(formatting.centimetres(value_m, signed), value_m) if is_known else Cell.empty()


def _share(value: float) -> Cell:
    return Cell(formatting.share(round(value, 2)), value)


def _position(x: float, y: float) -> Cell:
    return Cell(f"{x:.1f}, {y:.1f}".replace("-", formatting.MINUS), x)


def _map(as_built: AsBuilt, shown: Sequence[tuple[int, AsBuiltWall]], crop: Crop) -> str:
    """Lines where walls are drawn, and, of those that stand elsewhere, thin ones where they stand; short ones
    across openings."""
    width, height = crop.size
    lines = []
    for number, wall in shown:
        verdict = as_built.verdict(wall)
        name = escape(f"{number}: {in_words(wall, verdict)}")
        lines.append(
            f'<g class="{_style(verdict)}" {_data(number, wall)}><title>{name}</title>'
            f"{_line(wall.ends, crop, 'drawn')}"
            + (_line(wall.built_ends, crop, "stands") if wall.is_standing else "")
            + _label(number, wall, crop)
            + "</g>"
        )
    for number, opening in _shown(as_built.openings, crop):
        lines.append(
            f'<g class="{_opening_style(opening)}">'
            f"<title>{escape(f'O{number}: {opening_words(opening)}')}</title>"
            f"{_line(opening.built_ends, crop, 'drawn')}</g>"
        )
    strokes = {f"opening-{v.value.replace(' ', '-')}": c for v, c in OPENING_COLORS.items()}
    strokes |= {_style(verdict): color for verdict, color in COLORS.items()}
    styles = " ".join(f".as-built .{name} line {{ stroke: {c}; }}" for name, c in strokes.items())
    styles += (
        f" .as-built text {{ font-size: {width / 55:.3f}px; stroke-width: {width / 300:.3f}px; }}"
    )
    return (
        f'<svg viewBox="0 0 {width:.3f} {height:.3f}" data-left="{crop.low[0]:.4f}" '
        f'data-top="{crop.high[1]:.4f}" role="img" '
        f'aria-label="Walls of the plan by verdict"><style>{styles}</style>{"".join(lines)}</svg>'
    )


def _label(number: int, wall: AsBuiltWall, crop: Crop) -> str:
    """The number of a wall, beside its middle: seen where it is not as drawn."""
    x, y = wall.built_ends.mean(axis=0) + 0.012 * crop.size[0] * wall.normal
    return f'<text x="{x - crop.low[0]:.2f}" y="{crop.high[1] - y:.2f}">{number}</text>'


def _line(ends: Float[np.ndarray, "2 2"], crop: Crop, style: str) -> str:
    (x1, y1), (x2, y2) = (
        (end[0] - crop.low[0], crop.high[1] - end[1]) for end in np.asarray(ends, dtype=float)
    )
    return f'<line class="{style}" x1="{x1:.3f}" y1="{y1:.3f}" x2="{x2:.3f}" y2="{y2:.3f}"/>'


def _rows(
    as_built: AsBuilt, shown: Sequence[tuple[int, AsBuiltWall]]
) -> Iterator[tuple[str, str, tuple[Cell, ...]]]:
    """Style, attributes and cells of each row, first of what is not as planned; what was not seen is on the
    map alone."""
    told = [(as_built.verdict(wall), number, wall) for number, wall in shown]
    told = [each for each in told if each[0] is not Verdict.NOT_SEEN]
    for verdict, number, wall in sorted(told, key=lambda each: each[0] is Verdict.AGREES):
        x, y = map(float, wall.ends.mean(axis=0))
        is_off = wall.is_standing and wall.face_idx >= 0
        sure = "" if as_built.is_sure(wall) else " unsure"
        yield (
            f"{_style(verdict)}{sure}",
            _data(number, wall),
            (
                _number(number, wall.face_idx),
                Cell(escape(verdict.value), verdict.value),
                _centimetres(wall.offset_m, is_off, signed=True),
                _centimetres(wall.sigma_m, wall.is_standing),
                Cell(str(wall.n_patches), wall.n_patches),
                Cell(str(wall.n_frames), wall.n_frames),
                _share(wall.through_share),
                _length(wall.length_m),
                _position(x, y),
            ),
        )


def _data(number: int, wall: AsBuiltWall) -> str:
    """What the page's scripts go by: number, face, and offset and sigma of walls of the plan that stand."""
    face = wall.face_idx if wall.face_idx >= 0 else -number
    named = f'data-number="{number}" data-face="{face}"'
    if wall.face_idx < 0 or not wall.is_standing:
        return named
    return f'{named} data-offset="{wall.offset_m:.5f}" data-sigma="{wall.sigma_m:.5f}"'


def _style(verdict: Verdict) -> str:
    return f"as-built-{verdict.value.replace(' ', '-')}"


OPENING_COLORS = {
    OpeningVerdict.OPEN: colors.AGREES,
    OpeningVerdict.CLOSED: colors.BEFORE,
    OpeningVerdict.NOT_SEEN: colors.NOT_SEEN,
    OpeningVerdict.NEW: colors.UNMATCHED,
}
_OPENING_HEADS = (
    "No.", "verdict", "width", "sigma", "drawn", "shifted", "looked through", "closed", "frames",
    "middle x, y (m)",
)  # fmt: skip


def _openings_section(as_built: AsBuilt, crop: Crop) -> str:
    """Words and the table; nothing where no opening is known."""
    shown = _shown(as_built.openings, crop)
    if not shown:
        return ""
    counts = counted_openings([opening for _, opening in shown])
    words = ", ".join(f"{count} {escape(verdict.value)}" for verdict, count in counts.items())
    return f"""<section class="openings"><h3>Doors, windows and passages</h3>
<p>Every gap of a wall that the plan draws: open (cameras look through it), closed (by a
shut door, which stands back from the wall, or walled up, flush with it on both sides, or by one of both where
the scan does not tell), or not seen; and openings of walls that the plan draws without. Widths are between
the sides of the wall as seen, with one standard deviation; "shifted" is along the wall. {words}.</p>
{sortable_table(_OPENING_HEADS, list(_opening_rows(shown)), "openings")}</section>"""


def _opening_style(opening: AsBuiltOpening) -> str:
    """Class of its row and its line."""
    verdict = opening.verdict
    planned = "" if opening.differs else " as-planned"
    return f"opening opening-{verdict.value.replace(' ', '-')}{planned}"


def _verdict_words(opening: AsBuiltOpening) -> str:
    verdict = opening.verdict
    if verdict is OpeningVerdict.CLOSED and opening.kind != "window":
        return f"{verdict.value}: {opening.closed_by.value}"
    return verdict.value


def _opening_rows(
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
            _opening_style(opening),
            "",
            (
                Cell(f"O{number}", number),
                Cell(escape(_verdict_words(opening)) + kind, verdict.value),
                Cell(formatting.length(opening.width_m), opening.width_m) if is_measured else none,
                _centimetres(opening.width_sigma_m, is_measured),
                Cell(formatting.length(opening.drawn_width_m), opening.drawn_width_m)
                if opening.is_drawn
                else none,
                _centimetres(opening.shift_m, is_measured and opening.is_drawn, signed=True),
                _share(opening.open_share),
                _share(opening.closed_share),
                Cell(str(n_frames), n_frames),
                _position(x, y),
            ),
        )


def _rooms_section(rooms: Sequence[RoomAsBuilt]) -> str:
    """Areas and clear widths; nothing where no room is known or seen."""
    seen = [room for room in rooms if room.seen_share > 0]
    if not seen:
        return ""
    were = plural(len(seen), "was", "were")
    count = f"{len(seen)} of {len(rooms)} {plural(len(rooms), 'room', 'rooms')} of the plan {were} seen."
    rows = []
    for number, room in enumerate(seen, start=1):
        built = (area(a, spec, formatting.SPACE) for a, spec in (
            (room.area_m2, ".1f"), (room.built_area_m2 - room.area_m2, "+.2f"), (room.area_sigma_m2, ".2f")
        ))  # fmt: skip
        rows.append(
            (
                str(number),
                *(words.replace("-", formatting.MINUS) for words in built),
                "<br>".join(_clear(width) for width in room.widths),
                formatting.share(room.seen_share),
                _position(*room.middle_xy).html,
            )
        )
    heads = (
        "No.",
        "area as planned",
        "as built",
        "sigma",
        "clear widths",
        "walls seen",
        "inside, x, y (m)",
    )
    shown = table(heads, rows, "nnnnwnn")
    return (
        f'<section class="rooms"><h3>Rooms</h3><p>{count} Areas as planned, and how much more or less '
        "they are as built, between walls where they were seen and as drawn where not; clear widths between "
        f"walls that face each other, as planned and how far off.</p>{shown}</section>"
    )


def _clear(width: ClearWidth) -> str:
    """As planned, and how far off it is, where that was seen."""
    planned = formatting.length(width.planned_m)
    if not np.isfinite(width.built_m):
        return f"{planned}, not seen"
    off = formatting.centimetres(width.built_m - width.planned_m, signed=True)
    return f"{planned} {off} (± {formatting.centimetres(width.sigma_m)})"
