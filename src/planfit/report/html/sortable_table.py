"""Tables whose heads sort them."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np


@dataclass(frozen=True)
class Cell:
    """What is shown, and what it is sorted by."""

    html: str
    key: float | str

    @staticmethod
    def empty() -> "Cell":
        """Last when sorted."""
        return Cell("", float("inf"))


def sortable_table(
    heads: Sequence[str],
    rows: Sequence[tuple[str, str, tuple[Cell, ...]]],
    what: str = "walls",
) -> str:
    """A table whose heads sort it (`sort.js`); the second column is words, the others are numbers.

    Args:
        heads: plain text.
        rows: class, more attributes (HTML), and cells of each.
        what: is listed, in words.
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
        f'<p class="on-paper">On paper, only {what} that are not as drawn are listed.</p>'
        f'<div class="walls"><table class="sortable"><thead><tr>{head}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def _td(cell: Cell, kind: str) -> str:
    if isinstance(cell.key, str):
        return f'<td{kind} data-key="{escape(cell.key)}">{cell.html}</td>'
    key = "" if np.isinf(cell.key) else f"{cell.key:.6g}"
    return f'<td{kind} data-key="{key}">{cell.html}</td>'
