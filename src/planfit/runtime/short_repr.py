"""`repr` of types that hold arrays: readable lines in a notebook, arrays by kind and shape.

Options keep the `repr` of dataclasses: it can be pasted, and names what a cache was computed with.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from enum import Enum
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

MAX_LINE, MAX_TEXT, MAX_NESTED = 96, 60, 72
_FIRST = 24
_FEW = 3
"""So many items of a tuple, and numbers of an array, are told each."""


def short_repr(self: Any) -> str:
    """A dataclass with its fields on one line, or one a line; in its body: `__repr__ = short_repr`."""
    parts = [
        f"{field.name}={_brief(getattr(self, field.name))}"
        for field in dataclasses.fields(self)
        if field.repr
    ]
    name = type(self).__name__
    counted = f"{name} of {len(self)}" if hasattr(self, "__len__") else name
    line = f"{counted}({', '.join(parts)})"
    if len(line) <= MAX_LINE:
        return line
    return "\n  ".join([f"{counted}(", *(f"{part}," for part in parts)]) + "\n)"


def short_html(self: Any) -> str:
    """The same as a small table for notebooks; in its body: `_repr_html_ = short_html`."""
    fields = [field for field in dataclasses.fields(self) if field.repr]
    counted = f" of {len(self)}" if hasattr(self, "__len__") else ""
    rows = [(field.name, _brief(getattr(self, field.name))) for field in fields]
    return html_table(f"{type(self).__name__}{counted}", rows)


def html_table(title: str, rows: Sequence[Sequence[str]]) -> str:
    """A table of plain text."""
    cells = ["".join(f"<td>{escape(cell)}</td>" for cell in row) for row in rows]
    lines = "".join(f'<tr style="text-align: left">{row}</tr>' for row in cells)
    return f"<table><caption>{escape(title)}</caption>{lines}</table>"


def _brief(value: Any) -> str:
    if isinstance(value, np.ndarray):
        if value.ndim <= 1 and value.size <= _FEW:
            return np.array2string(value, precision=4, separator=", ")
        return f"{value.dtype}[{', '.join(map(str, value.shape))}]"
    if isinstance(value, Enum):
        return value.name.lower()
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, str):
        return repr(value if len(value) <= MAX_TEXT else f"{value[:MAX_TEXT]}...")
    if isinstance(value, Path):
        return repr(str(value))
    if isinstance(value, Mapping):
        return f"{{{_listed([str(key) for key in value])}}}"
    if isinstance(value, tuple | list):
        return f"({_listed([_brief(one) for one in value])})"
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return _nested(value)
    text = repr(value)
    return text if len(text) <= MAX_NESTED and "\n" not in text else f"<{type(value).__name__}>"


def _nested(value: Any) -> str:
    """A dataclass within another: whole where it is short, else by its name and how many it holds."""
    text = short_repr(value)
    if len(text) <= MAX_NESTED and "\n" not in text:
        return text
    length = f" of {len(value)}" if hasattr(value, "__len__") else ""
    return f"<{type(value).__name__}{length}>"


def _listed(words: list[str]) -> str:
    text = ", ".join(words)
    if len(words) <= _FEW and len(text) <= MAX_NESTED:
        return text
    return (
        f"{words[0]}, ... {len(words)} in all"
        if len(words[0]) <= _FIRST
        else f"{len(words)} in all"
    )
