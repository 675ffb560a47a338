"""Files by patterns of their names, and text files of numbers, with errors that name the line."""

import json
import re
from collections.abc import Iterable
from io import StringIO
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from planfit.errors import ScanError
from planfit.scan.source import FileSource, in_order, read_text

MAX_QUOTED = 80
_BEGIN_NUMBERS = tuple("+-0123456789")
_BETWEEN_NUMBERS = re.compile(r"[\s;]+")
_WITH_COMMA = re.compile(r"[+-]?\d+,\d+(?:[eE][+-]?\d+)?")
_NO_NUMBER = re.compile(r"[+-]?1\.#(?:INF|IND|[QS]NAN)0*")
"""As C libraries of Windows print what is infinite or none; no comment begins there."""
_BETWEEN_COMMAS = re.compile(r"(?=.*,0\d)[+-]?\d+(?:,[+-]?\d+)*")
"""Whole numbers alone, one of which begins with 0 as decimals alone do."""


def shorten(found: object) -> str:
    """What was found in a file, fit for a message: printable, one line, not too long."""
    text = "".join(c if c.isprintable() else "?" for c in str(found).replace("\\x00", "?"))
    return text if len(text) <= MAX_QUOTED else text[: MAX_QUOTED - 3] + "..."


def read_rows(
    source: FileSource, name: str, expected: str, separator: str | None = None
) -> list[list[str]]:
    """Words of each line; comments begin with `#`, empty lines are left out.

    Raises:
        ScanError: the file is missing, no text, or empty.
    """
    rows = [
        [word.strip() for word in line.split("#")[0].split(separator)]
        for line in _NO_NUMBER.sub("nan", read_text(source, name)).splitlines()
        if line.split("#")[0].strip()
    ]
    if not rows:
        raise ScanError(f"{source.path / name}: expected {expected}, found an empty file")
    return rows


def read_matrix(
    source: FileSource, name: str, expected: str, separator: str | None = None
) -> Float[np.ndarray, "rows columns"]:
    """A table of numbers, all rows of one length; NaN and infinity are let through.

    Raises:
        ScanError: it is none.
    """
    rows = read_rows(source, name, expected, separator)
    lengths = sorted({len(row) for row in rows})
    if len(lengths) > 1:
        raise ScanError(
            f"{source.path / name}: expected {expected}, found lines of {lengths[0]} to {lengths[-1]} "
            "numbers; export it again"
        )
    try:
        return np.array([[float(word) for word in row] for row in rows])
    except ValueError as error:
        raise ScanError(
            f"{source.path / name}: expected {expected}, found text that is not ({shorten(error)})"
        ) from error


def number_table(text: str) -> Float[np.ndarray, "rows columns"] | None:
    """Numbers of a text, between blanks, `#` begins a comment; None where lines differ in length or hold
    anything else.

    A twentieth of the time and a tenth of the memory of words in lists, which a million lines need.
    """
    if not any(line.split("#", 1)[0].strip() for line in islice(StringIO(text), 1000)):
        return None  # nothing, or a long comment: NumPy would warn of it
    try:
        return np.loadtxt(StringIO(text), dtype=float, comments="#", ndmin=2)
    except ValueError:
        return None


def with_decimal_point(word: str) -> str:
    """A number whose decimal mark is a comma with a point instead; any other word as it is."""
    return word.replace(",", ".") if _WITH_COMMA.fullmatch(word) else word


def with_decimal_points(text: str, path: Path) -> str:
    """A table of numbers whose decimal mark is a comma, as programs write in many a country's settings, with
    points instead; any other text as it is.

    A comma is decimal where each line of numbers has other marks between them, no number has two commas, and
    none a point.

    Raises:
        ScanError: commas are both, so that numbers cannot be told apart.
    """
    if "," not in text:
        return text
    lines = text.split("\n")
    is_row = [line.lstrip()[:1] in _BEGIN_NUMBERS for line in lines]
    found = False
    for line, is_one in zip(lines, is_row, strict=True):
        if not is_one or not line.strip():
            continue
        words = _BETWEEN_NUMBERS.split(line.split("#")[0].strip())
        if len(words) == 1 and _BETWEEN_COMMAS.fullmatch(words[0]):
            raise ScanError(
                f"{path}: expected numbers that can be told apart, found decimal commas with commas between "
                f"numbers ({shorten(words[0])}); export it with decimal points, or separated by blanks"
            )
        if len(words) == 1 or not all(_WITH_COMMA.fullmatch(w) for w in words if "," in w):
            return text
        if any("." in word for word in words):
            return text
        found |= "," in line
    if not found:
        return text
    return "\n".join(
        line.replace(",", ".") if is_one else line
        for line, is_one in zip(lines, is_row, strict=True)
    )


def read_json(source: FileSource, name: str) -> dict[str, Any]:
    """A JSON object.

    Raises:
        ScanError: the file is missing or holds none.
    """
    return parse_json(read_text(source, name), source.path / name)


def parse_json(text: str, path: Path) -> dict[str, Any]:
    """A JSON object from its text, which messages call `path`.

    Raises:
        ScanError: it is none.
    """
    try:
        value = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ScanError(f"{path}: expected JSON, found text that is not ({error})") from error
    if not isinstance(value, dict):
        raise ScanError(f"{path}: expected a JSON object, found {type(value).__name__}")
    return value


def numbers_of(value: object) -> Float[np.ndarray, "..."]:
    """Numbers out of JSON, in lists of any depth; none where it holds anything else."""
    try:
        return np.array(value, dtype=float)
    except (ValueError, TypeError, OverflowError):
        return np.zeros(0)


def number_list(value: object, count: int, where: str) -> Float[np.ndarray, " count"]:
    """`count` numbers out of JSON, flattened.

    Raises:
        ScanError: they are not.
    """
    try:
        array = np.array(value, dtype=float).ravel()
    except (ValueError, TypeError, OverflowError) as error:
        raise ScanError(f"{where}: expected {count} numbers, found {shorten(value)!r}") from error
    if array.size != count:
        raise ScanError(f"{where}: expected {count} numbers, found {array.size}")
    return array


def has_part(source: FileSource, part: str) -> bool:
    """Whether a file, a pattern or a folder (with a slash) is there; of `a|b`, one of them."""
    for one in part.split("|"):
        if one.endswith("/"):
            inside, _, last = one[:-1].rpartition("/")
            if (not inside or inside in source.folders()) and last in source.folders(inside):
                return True
        elif "{}" in one:
            if Names(one).by_key(source):
                return True
        elif source.exists(one):
            return True
    return False


def first_of(source: FileSource, names: Iterable[str]) -> str:
    """The first of some names that is a file; the first of all where none is."""
    listed = list(names)
    return next((name for name in listed if source.exists(name)), listed[0])


class Names:
    """Files of one kind, by patterns whose `{}` stands for what tells frames apart.

    `.*` at the end of a pattern is any suffix.
    """

    def __init__(self, *patterns: str, key: str = r"\d+") -> None:
        self.patterns = patterns
        self._found = [
            (pattern.rpartition("/")[0], _expression(pattern.rpartition("/")[2], key))
            for pattern in patterns
        ]

    def listed(self, source: FileSource, folder: str = "") -> list[tuple[str, str]]:
        """Keys and names of the files that lie there, below `folder` (which ends with a slash)."""
        found: dict[str, str] = {}
        for inside, expression in self._found:
            for name in source.names(folder + inside):
                if match := expression.fullmatch(name):
                    found.setdefault(f"{inside}/{name}".lstrip("/"), match[1])
        return sorted(
            ((key, name) for name, key in found.items()), key=lambda one: in_order(one[0])
        )

    def by_key(self, source: FileSource, folder: str = "") -> dict[str, str]:
        """Names of the files by their keys."""
        return dict(self.listed(source, folder))

    def of(self, key: str) -> list[str]:
        """What the files of a frame may be called."""
        return [pattern.format(key) for pattern in self.patterns]


def _expression(pattern: str, key: str) -> re.Pattern[str]:
    text = re.escape(pattern).replace(re.escape("{}"), f"({key})").replace(r"\.\*", r"\.[^.]*")
    return re.compile(text, re.IGNORECASE)
