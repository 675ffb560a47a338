"""The table of walls: what the scan says of each wall of the plan, and what the plan lacks."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from jaxtyping import Int

from planfit.floorplan import Floorplan
from planfit.report import formatting
from planfit.report.walls import SeenFace, UndrawnWall

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


_NONE = Cell.empty()


def wall_table(
    faces: Sequence[SeenFace],
    undrawn: Sequence[UndrawnWall] = (),
    unseen: Sequence[int] | Int[np.ndarray, " k"] = (),
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
    blank = (_NONE,) if has_solved else ()
    rows = [("displaced" if f.is_displaced else "", "", _seen(f, has_solved)) for f in faces]
    rows += [("undrawn", "", (*_undrawn(wall), *blank)) for wall in undrawn]
    if len(unseen):
        assert floorplan is not None
        rows += [("unseen", "", (*_unseen(floorplan, face), *blank)) for face in unseen]
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
        f'<div class="walls"><table class="sortable"><thead><tr>{head}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def _undrawn(wall: UndrawnWall) -> tuple[Cell, ...]:
    """Cells of a wall that the plan lacks."""
    return (
        _NONE,
        Cell("missing in the plan", "missing in the plan"),
        _NONE,
        _NONE,
        Cell(str(wall.n_patches), wall.n_patches),
        _length(wall.length),
        _position(*wall.middle_xy),
    )


def _unseen(floorplan: Floorplan, face: int) -> tuple[Cell, ...]:
    """Cells of a face that the scan does not show."""
    x, y = floorplan.ends[face].mean(axis=0)
    verdict = Cell(f'<span data-wall="{face}">not seen</span>', "not seen")
    size = _length(float(floorplan.lengths[face]))
    return _NONE, verdict, _NONE, _NONE, Cell("0", 0), size, _position(float(x), float(y))


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
        return (*cells, _NONE)
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
