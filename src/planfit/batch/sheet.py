"""Files of jobs as rows of named cells: CSV as spreadsheets write it, TOML and JSON."""

import csv
import io
import json
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from planfit.errors import OptionError, require

SEVERAL = "|"
"""Between several values in one cell of a CSV file: never part of a path on Windows, no delimiter of CSV."""
Values = tuple[str, ...]


@dataclass(frozen=True)
class Row:
    """One job as it stands in the file."""

    where: str
    """File and line or number, for messages."""
    cells: dict[str, Values]
    """By column, `_` written `-`, without leading dashes; empty cells are left out. A switch is `true` or
    `false`."""


def read_rows(path: Path) -> list[Row]:
    """All jobs of a file, told apart by its name: `.toml`, `.json`, anything else is CSV.

    Raises:
        OptionError: it is missing, no such file, has no jobs, or a row does not fit its columns.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise OptionError(
            f"{path}: expected a file of jobs (CSV, TOML or JSON), found none that can be read "
            f"({error.strerror}); check the path"
        ) from error
    text = _text(path, content)
    kind = path.suffix.lower()
    rows = _csv_rows(path, text) if kind not in (".toml", ".json") else _data_rows(path, text, kind)
    require(
        bool(rows),
        f"{path}: expected a line a job below the names of the columns (name, scan, plan, ...), found no "
        "job; write at least one",
    )
    return rows


def _text(path: Path, content: bytes) -> str:
    """Text of a file that may begin with a byte order mark, as those of Excel do."""
    encoding = "utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    try:
        return content.decode(encoding)
    except UnicodeDecodeError as error:
        raise OptionError(
            f"{path}: expected text in UTF-8, found other bytes at {error.start}; in Excel, save it as "
            "'CSV UTF-8'"
        ) from error


def _csv_rows(path: Path, text: str) -> list[Row]:
    text, delimiter = _without_hint(text)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, strict=True)
    columns: list[str] = []
    rows = []
    try:
        for raw in reader:
            cells = [cell.strip() for cell in raw]
            if not any(cells):
                continue
            where = f"{path}, line {reader.line_num}"
            if not columns:
                columns = _columns(path, cells)
                continue
            require(
                not any(cells[len(columns) :]),
                f"{where}: expected {len(columns)} cells, as there are columns, found {len(cells)}; put "
                "quotes around a cell that holds the delimiter",
            )
            values = {
                column: tuple(part.strip() for part in cell.split(SEVERAL))
                for column, cell in zip(columns, cells, strict=False)
                if cell and column
            }
            rows.append(Row(where, values))
    except csv.Error as error:
        raise OptionError(
            f"{path}, line {reader.line_num}: expected CSV, found {error}; look for a quote that is not "
            "closed"
        ) from error
    return rows


def _without_hint(text: str) -> tuple[str, str]:
    """Text and its delimiter: told by Excel's first line `sep=;`, else the most frequent one of the head."""
    first, _, rest = text.partition("\n")
    if first.strip().lower().startswith("sep=") and len(first.strip()) == 5:
        return rest, first.strip()[-1]
    head = next((line for line in text.splitlines() if line.strip()), "")
    return text, max(",;\t", key=head.count)


def _columns(path: Path, cells: list[str]) -> list[str]:
    while cells and not cells[-1]:
        cells = cells[:-1]
    columns = [_column(cell) for cell in cells]
    twice = sorted({c for c in columns if c and columns.count(c) > 1})
    require(
        not twice,
        f"{path}: expected each column once, found {', '.join(twice)} more than once; leave out one",
    )
    return columns


def _column(name: str) -> str:
    return name.strip().lstrip("-").replace("_", "-")


def _data_rows(path: Path, text: str, kind: str) -> list[Row]:
    """Jobs of TOML (`[[jobs]]`) or of JSON (`{"jobs": [...]}`, or the list alone)."""
    try:
        data = tomllib.loads(text) if kind == ".toml" else json.loads(text)
    except (ValueError, RecursionError) as error:
        raise OptionError(f"{path}: expected {kind[1:].upper()}, found {error}") from error
    jobs = data.get("jobs") if isinstance(data, dict) else data
    if not isinstance(jobs, list) or not all(isinstance(job, dict) for job in jobs):
        raise OptionError(
            f"{path}: expected a list of jobs, each with its name and scan, found something else; write "
            + (
                "[[jobs]] above each"
                if kind == ".toml"
                else '{"jobs": [{"name": ..., "scan": ...}]}'
            )
        )
    return [
        Row(f"{path}, job {i}", _flat(f"{path}, job {i}", job)) for i, job in enumerate(jobs, 1)
    ]


def _flat(where: str, table: dict[str, Any], prefix: str = "") -> dict[str, Values]:
    """Nested tables as dotted names, as the flags have them."""
    cells: dict[str, Values] = {}
    for name, value in table.items():
        column = prefix + _column(name)
        new = (
            _flat(where, value, f"{column}.")
            if isinstance(value, dict)
            else {column: _words(where, column, value)}
        )
        twice = new.keys() & cells.keys()
        require(
            not twice,
            f"{where}: expected each option once, found {', '.join(sorted(twice))} more than once",
        )
        cells |= new
    return {column: words for column, words in cells.items() if words}


def _words(where: str, column: str, value: Any) -> Values:
    if isinstance(value, list):
        return tuple(word for item in value for word in _words(where, column, item))
    if isinstance(value, bool):
        return ("true" if value else "false",)
    if value is None or value == "":
        return ()
    require(
        isinstance(value, str | int | float),
        f"{where}: expected text, numbers or a list of them as {column}, found {value!r}",
    )
    return (str(value),)
