"""The section of the report that holds every wall against its drawing: a map and a table, whose verdicts
follow a tolerance that is chosen on the page (`as_built.js`)."""

from collections.abc import Iterator, Sequence
from html import escape

import numpy as np
from jaxtyping import Float

from planfit.as_built import AsBuilt, AsBuiltWall, Verdict, counted, deviations, in_words
from planfit.report import formatting
from planfit.report.html.wall_table import Cell, sortable_table
from planfit.report.plots.drawing import AGREES, BEFORE, DISPLACED, NOT_SEEN, UNMATCHED
from planfit.report.plots.top_view import Crop

COLORS = {
    Verdict.AGREES: AGREES,
    Verdict.MOVED: DISPLACED,
    Verdict.MISSING: BEFORE,
    Verdict.NEW: UNMATCHED,
    Verdict.NOT_SEEN: NOT_SEEN,
}
_HEADS = (
    "No.", "verdict", "offset", "sigma", "patches", "frames", "looked through", "length", "middle x, y (m)",
)  # fmt: skip


def as_built_section(as_built: AsBuilt, crop: Crop) -> str:
    """Words, the control of the tolerance, a map of the part that was scanned, and the table of all walls."""
    options = as_built.options
    # Walls of a campus that the scan does not come near are in the exports, not on the page.
    touched = crop.touches(np.array([wall.ends for wall in as_built.walls]).reshape(-1, 2, 2))
    shown = [(k, w) for k, (w, on) in enumerate(zip(as_built.walls, touched, strict=True), 1) if on]
    keys = " ".join(
        f'<span class="entry"><span class="key" style="background:{color}"></span>{verdict.value}</span>'
        for verdict, color in COLORS.items()
    )
    counts = counted([as_built.verdict(wall) for _, wall in shown])
    words = ", ".join(f"{count} {escape(verdict.value)}" for verdict, count in counts.items())
    n_walls = len(deviations(as_built))
    return f"""<section class="as-built"><h2>As built against as planned</h2>
<p>Every face of the plan half a metre long or more: it agrees, was moved (its offset, positive into the
room, with one standard deviation, what the poses may be off included), is missing (cameras look through where
it should be), or was not seen; and walls that the plan does not draw. {n_walls}
{"wall is" if n_walls == 1 else "walls are"} not as planned, both faces of a wall counted as one; a verdict in
italics is not sure: the tolerance lies within {options.sure_sigmas:g} standard deviations of the offset.
<code>planfit export RUN --to as-built</code> writes all this as CSV, GeoJSON, DXF and BCF.</p>
<p class="as-built-tools"><label>tolerance <input class="as-built-tolerance" type="number" min="0" max="1"
step="0.005" value="{options.tolerance_m:g}" data-sure="{options.sure_sigmas:g}"> m</label>
<span class="as-built-counts" role="status">{words}</span></p>
<p>{keys}</p>{_map(as_built, shown, crop)}
{sortable_table(_HEADS, list(_rows(as_built, shown)))}</section>"""


def _map(as_built: AsBuilt, shown: Sequence[tuple[int, AsBuiltWall]], crop: Crop) -> str:
    """Lines where walls are drawn, and, of those that stand elsewhere, thin ones where they stand."""
    width, height = crop.size
    lines = []
    for number, wall in shown:
        verdict = as_built.verdict(wall)
        name = escape(f"{number}: {in_words(wall, verdict)}")
        lines.append(
            f'<g class="{_style(verdict)}" {_data(number, wall)}><title>{name}</title>'
            f"{_line(wall.ends, crop, 'drawn')}"
            + (_line(wall.built_ends, crop, "stands") if wall.is_standing else "")
            + "</g>"
        )
    styles = " ".join(
        f".as-built .{_style(verdict)} line {{ stroke: {color}; }}"
        for verdict, color in COLORS.items()
    )
    return (
        f'<svg viewBox="0 0 {width:.3f} {height:.3f}" role="img" '
        f'aria-label="Walls of the plan by verdict"><style>{styles}</style>{"".join(lines)}</svg>'
    )


def _line(ends: Float[np.ndarray, "2 2"], crop: Crop, style: str) -> str:
    (x1, y1), (x2, y2) = (
        (end[0] - crop.low[0], crop.high[1] - end[1]) for end in np.asarray(ends, dtype=float)
    )
    return f'<line class="{style}" x1="{x1:.3f}" y1="{y1:.3f}" x2="{x2:.3f}" y2="{y2:.3f}"/>'


def _rows(
    as_built: AsBuilt, shown: Sequence[tuple[int, AsBuiltWall]]
) -> Iterator[tuple[str, str, tuple[Cell, ...]]]:
    """Style, attributes and cells of each row."""
    none = Cell.empty()
    for number, wall in shown:
        verdict = as_built.verdict(wall)
        x, y = wall.ends.mean(axis=0)
        name = str(number)
        if wall.face_idx >= 0:
            name = f'<span data-wall="{wall.face_idx}">{number}</span>'
        is_off = wall.is_standing and wall.face_idx >= 0
        sure = "" if as_built.is_sure(wall) else " unsure"
        yield (
            f"{_style(verdict)}{sure}",
            _data(number, wall),
            (
                Cell(name, number),
                Cell(escape(verdict.value), verdict.value),
                Cell(formatting.centimetres(wall.offset_m, signed=True), wall.offset_m)
                if is_off
                else none,
                Cell(formatting.centimetres(wall.sigma_m), wall.sigma_m)
                if wall.is_standing
                else none,
                Cell(str(wall.n_patches), wall.n_patches),
                Cell(str(wall.n_frames), wall.n_frames),
                Cell(formatting.share(round(wall.through_share, 2)), wall.through_share),
                Cell(f"{wall.length_m:.2f}{formatting.SPACE}m", wall.length_m),
                Cell(f"{x:.1f}, {y:.1f}".replace("-", formatting.MINUS), float(x)),
            ),
        )


def _data(number: int, wall: AsBuiltWall) -> str:
    """What the page's script goes by: number, and offset and sigma of walls of the plan that stand."""
    if wall.face_idx < 0 or not wall.is_standing:
        return f'data-number="{number}"'
    return (
        f'data-number="{number}" data-offset="{wall.offset_m:.5f}" data-sigma="{wall.sigma_m:.5f}"'
    )


def _style(verdict: Verdict) -> str:
    return f"as-built-{verdict.value.replace(' ', '-')}"
