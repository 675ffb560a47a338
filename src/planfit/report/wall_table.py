"""The table of walls: what the scan says of each wall of the plan, and what the plan lacks."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from planfit.floorplan import Floorplan
from planfit.report import amounts
from planfit.report.missing_walls import UndrawnWall
from planfit.report.walls import SeenFace

_HEADS = ("No.", "verdict", "offset", "spread", "pieces", "length", "middle x, y (m)")


@dataclass(frozen=True)
class _Cell:
    """What is shown, and what it is sorted by."""

    html: str
    key: float | str


_NONE = _Cell("", float("inf"))
"""An empty cell; last when sorted."""


def wall_table(
    faces: Sequence[SeenFace],
    undrawn: Sequence[UndrawnWall] = (),
    unseen: Sequence[int] | np.ndarray = (),
    floorplan: Floorplan | None = None,
) -> str:
    """A table that sorts by the column whose head is pressed.

    Args:
        faces: seen walls of the plan, in the order to begin with.
        undrawn: walls that the plan lacks; after those.
        unseen: faces of `floorplan` that were not seen; last.
        floorplan: needed where there are any unseen.
    """
    has_solved = any(face.solved for face in faces)
    heads = (*_HEADS, "given way by") if has_solved else _HEADS
    rows = [_seen(face, has_solved) for face in faces]
    styles = ["shifted" if face.is_shifted else "" for face in faces]
    blank = (_NONE,) if has_solved else ()
    for wall in undrawn:
        rows.append(
            (
                _NONE,
                _Cell("missing in the plan", "missing in the plan"),
                _NONE,
                _NONE,
                _Cell(str(wall.n_patches), wall.n_patches),
                _length(wall.length),
                _place(*wall.middle_xy),
                *blank,
            )
        )
        styles.append("undrawn")
    for face in unseen:
        assert floorplan is not None
        x, y = floorplan.ends[face].mean(axis=0)
        verdict = _Cell("not seen", "not seen")
        size = _length(float(floorplan.lengths[face]))
        rows.append(
            (_NONE, verdict, _NONE, _NONE, _Cell("0", 0), size, _place(float(x), float(y)), *blank)
        )
        styles.append("unseen")
    number = ' class="num"'
    kinds = [number, "", *[number] * (len(heads) - 2)]
    head = "".join(
        f'<th scope="col"{kind}><button type="button">{escape(h)}</button></th>'
        for h, kind in zip(heads, kinds, strict=True)
    )
    body = "".join(
        f'<tr class="{style}">'
        + "".join(_td(c, k) for c, k in zip(row, kinds, strict=True))
        + "</tr>"
        for row, style in zip(rows, styles, strict=True)
    )
    return (
        f'<div class="walls"><table class="sortable"><thead><tr>{head}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def _seen(face: SeenFace, has_solved: bool) -> tuple[_Cell, ...]:
    cells = (
        _Cell(str(face.number), face.number),
        _Cell(escape(face.verdict), face.verdict),
        _Cell(amounts.centimetres(face.offset, signed=True), face.offset),
        _Cell(amounts.centimetres(face.spread), face.spread),
        _Cell(str(face.n_patches), face.n_patches),
        _length(face.length),
        _place(*face.middle_xy),
    )
    if not has_solved:
        return cells
    if face.solved is None:
        return (*cells, _NONE)
    offset, sigma = face.solved
    shown = f"{amounts.centimetres(offset, signed=True)} ± {amounts.centimetres(sigma)}"
    return (*cells, _Cell(shown, offset))


def _length(value_m: float) -> _Cell:
    return _Cell(f"{value_m:.2f}{amounts.SPACE}m", value_m)


def _place(x: float, y: float) -> _Cell:
    return _Cell(f"{x:.1f}, {y:.1f}".replace("-", amounts.MINUS), x)


def _td(cell: _Cell, kind: str) -> str:
    if isinstance(cell.key, str):
        return f'<td{kind} data-key="{escape(cell.key)}">{cell.html}</td>'
    key = "" if np.isinf(cell.key) else f"{cell.key:.6g}"
    return f'<td{kind} data-key="{key}">{cell.html}</td>'
