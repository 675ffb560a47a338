"""Kernels and the types that they are called with, as lines of text: those of `signatures.txt`.

A line is the kernel's name and the types of its arguments:

    planfit.lsq.moment_kernels.weigh_all float64[1,C] int64 float64

An array has the type of its numbers, its dimensions and its layout in memory (C, F, or A for any), and `ro`
where it is read-only; a tuple is written in parentheses.
"""

import re
from collections.abc import Sequence
from pathlib import Path

from numba import types

LISTED = Path(__file__).with_name("signatures.txt")
"""What runs call: recorded by benchmarks/kernel_signatures.py, to be compiled ahead of them."""
_SCALARS: dict[str, types.Type] = {
    str(kind): kind
    for kind in (
        *(types.boolean, types.float32, types.float64),
        *(types.int8, types.int16, types.int32, types.int64),
        *(types.uint8, types.uint16, types.uint32, types.uint64),
    )
}


def listed_lines() -> list[str]:
    """The lines of `signatures.txt`, without its comments."""
    lines = LISTED.read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line and not line.startswith("#")]


def line_of(kernel: str, signature: Sequence[types.Type]) -> str:
    """A kernel, by its full name, and the types of its arguments; empty for types that no line tells."""
    words = [_word(each) for each in signature]
    return " ".join([kernel, *words]) if all(words) else ""


def parse_line(line: str) -> tuple[str, tuple[types.Type, ...]]:
    """Name of the kernel and types of its arguments.

    Raises:
        ValueError: it is no such line.
    """
    name, *words = re.findall(r"[^\s()\[\]]+(?:\[[^\]]*\])?|[()]", line)
    return name, _types(words, line)


def _word(kind: types.Type) -> str:
    if str(kind) in _SCALARS:
        return str(kind)
    if type(kind) is types.Array and str(kind.dtype) in _SCALARS and kind.aligned:
        return f"{kind.dtype}[{kind.ndim},{kind.layout}{'' if kind.mutable else ',ro'}]"
    if isinstance(kind, types.Tuple | types.UniTuple):
        words = [_word(each) for each in kind]
        return f"({' '.join(words)})" if all(words) else ""
    return ""


def _types(words: list[str], line: str) -> tuple[types.Type, ...]:
    """Types of words; those up to a closing parenthesis are taken out of the list."""
    found: list[types.Type] = []
    while words:
        word = words.pop(0)
        array = re.fullmatch(r"(\w+)\[(\d),([CFA])(,ro)?\]", word)
        if word == ")":
            break
        if word == "(":
            found.append(types.Tuple(_types(words, line)))
        elif array and array[1] in _SCALARS:
            found.append(
                types.Array(_SCALARS[array[1]], int(array[2]), array[3], readonly=bool(array[4]))
            )
        elif word in _SCALARS:
            found.append(_SCALARS[word])
        else:
            raise ValueError(f"{line!r}: expected the type of an argument, found {word!r}")
    return tuple(found)
