"""The table of walls that the fit used, and what sortable tables are made of."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from planfit.report import formatting
from planfit.report.walls import SeenFace

_HEADS = ("No.", "verdict", "offset", "MAD", "patches", "length", "middle x, y (m)")


@dataclass(frozen=True)
class Cell:
    """What is shown, and what it is sorted by."""

    html: str
    key: float | str

    @staticmethod
    def empty() -> "Cell":
        """Last when sorted."""
        return Cell("", float("inf"))


def wall_table(faces: Sequence[SeenFace]) -> str:
    """Seen walls of the plan, in the order to begin with."""
    has_solved = any(face.solved for face in faces)
    heads = (*_HEADS, "given way by") if has_solved else _HEADS
    rows = [("displaced" if f.is_displaced else "", "", _seen(f, has_solved)) for f in faces]
    return sortable_table(heads, rows)


def sortable_table(heads: Sequence[str], rows: Sequence[tuple[str, str, tuple[Cell, ...]]]) -> str:
    """A table whose heads sort it (`sort.js`); the second column is words, the others are numbers.

    Args:
        heads: plain text.
        rows: class, more attributes (HTML), and cells of each.
    """
    number = ' class="num"'
    kinds = [number, "", *[number] * (len(heads) - 2)]
    head = "".join(
        f'<th scope="col"{kind}><button type="button">{escape(h)}</button></th>'
        for h, kind in zip(heads, kinds, strict=True)
    )
    body = "".join(
        f'<tr class="{style}"{f" {more}" if more else ""}>'
        + "".join(_td(c, k) for c, k in zip(row, kinds, strict=True))
        + "</tr>"
        for style, more, row in rows
    )
    return (
        '<p class="on-paper">On paper, only walls that are not as drawn are listed.</p>'
        f'<div class="walls"><table class="sortable"><thead><tr>{head}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def _seen(face: SeenFace, has_solved: bool) -> tuple[Cell, ...]:
    """Cells of a face that the scan shows."""
    cells = (
        Cell(f'<span data-wall="{face.face_idx}">{face.number}</span>', face.number),
        Cell(escape(face.verdict), face.verdict),
        Cell(formatting.centimetres(face.offset, signed=True), face.offset),
        Cell(formatting.centimetres(face.mad), face.mad),
        Cell(str(face.n_patches), face.n_patches),
        _length(face.length),
        _position(*face.middle_xy),
    )
    if not has_solved:
        return cells
    if face.solved is None:
        return (*cells, Cell.empty())
    offset, sigma = face.solved
    shown = f"{formatting.centimetres(offset, signed=True)} ± {formatting.centimetres(sigma)}"
    return (*cells, Cell(shown, offset))


def _length(value_m: float) -> Cell:
    return Cell(f"{value_m:.2f}{formatting.SPACE}m", value_m)


def _position(x: float, y: float) -> Cell:
    return Cell(f"{x:.1f}, {y:.1f}".replace("-", formatting.MINUS), x)


def _td(cell: Cell, kind: str) -> str:
    if isinstance(cell.key, str):
        return f'<td{kind} data-key="{escape(cell.key)}">{cell.html}</td>'
    key = "" if np.isinf(cell.key) else f"{cell.key:.6g}"
    return f'<td{kind} data-key="{key}">{cell.html}</td>'
