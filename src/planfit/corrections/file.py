"""The file of corrections: TOML, a table an entry; see docs/corrections.md."""

import json
import math
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

from planfit.corrections.types import (
    AddedLoop,
    Correction,
    Corrections,
    DeletedLoop,
    ExcludedFrames,
    FrameRange,
    Place,
    WallByHand,
    WallKind,
)
from planfit.errors import OptionError, did_you_mean, printable
from planfit.runtime import write_whole

VERSION = "planfit_corrections"
MAX_BYTES, MAX_ENTRIES = 10_000_000, 10_000
_WALLS: tuple[WallKind, ...] = ("exclude_wall", "erase_wall", "draw_wall")
_KEYS: dict[str, tuple[str, ...]] = {
    "place": ("frame", "pixel", "scan", "plan", "plan_file"),
    "add_loop": ("frames", "pixels"),
    "delete_loop": ("frames",),
    "exclude_frames": ("frames",),
    **{kind: ("ends",) for kind in _WALLS},
}
_NOTE = "note"


class _Unfit(Exception):
    """An entry is not as it should be: what was expected and what was found, in words."""


def read_corrections(path: Path) -> Corrections:
    """Corrections of a file.

    Raises:
        OptionError: it is missing, no TOML, or an entry has another key or value than it may have.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise OptionError(
                f"{path}: expected a file of corrections, found one of {path.stat().st_size / 1e6:.0f} MB; "
                "is it the right file?"
            )
        content = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise OptionError(
            f"{path}: expected a TOML file of corrections, found none to read ({error.strerror}); check "
            "the path"
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise OptionError(
            f"{path}: expected TOML, found {error or type(error).__name__}; see 'planfit help corrections'"
        ) from error
    return corrections_of(content, str(path))


def corrections_of(content: dict[str, Any], name: str) -> Corrections:
    """Corrections of plain values, as TOML has them.

    Raises:
        OptionError: an entry has another key or value than it may have; the message begins with `name`.
    """
    for key in content:
        if key not in (VERSION, *_KEYS):
            meant = did_you_mean(key, _KEYS) or f"known: {', '.join(_KEYS)}"
            raise OptionError(f"{name}: expected tables of corrections, found {key!r}; {meant}")
    if content.get(VERSION, 1) != 1:
        raise OptionError(
            f"{name}: expected {VERSION} = 1, found {content[VERSION]!r}; a newer planfit wrote it"
        )
    entries: list[Correction] = []
    for kind, keys in _KEYS.items():
        tables = content.get(kind, [])
        if not isinstance(tables, list) or not all(isinstance(t, dict) for t in tables):
            raise OptionError(
                f"{name}: {kind}: expected tables, found {_shown(tables)}; begin each with [[{kind}]]"
            )
        for number, table in enumerate(tables, start=1):
            where = f"{name}: {kind} {number}"
            for key in table:
                if key not in (*keys, _NOTE):
                    meant = did_you_mean(key, keys) or f"known: {', '.join((*keys, _NOTE))}"
                    raise OptionError(f"{where}: expected keys of {kind}, found {key!r}; {meant}")
            try:
                entries.append(replace(_entry(kind, number, table), note=_note(table)))
            except _Unfit as unfit:
                raise OptionError(f"{where}: {unfit}; see 'planfit help corrections'") from unfit
    if len(entries) > MAX_ENTRIES:
        raise OptionError(
            f"{name}: expected {MAX_ENTRIES} corrections at most, found {len(entries)}; scan again instead"
        )
    return Corrections(name, tuple(entries))


def to_toml(corrections: Corrections) -> str:
    """The text of a file that reads as these corrections."""
    lines = [f"{VERSION} = 1"]
    for entry in corrections:
        lines += ["", f"[[{entry.kind}]]", *_lines(entry)]
        if entry.note:
            lines.append(f"{_NOTE} = {json.dumps(printable(entry.note), ensure_ascii=False)}")
    return "\n".join(lines) + "\n"


def write_corrections(path: Path, corrections: Corrections) -> None:
    """Write what `read_corrections` reads, whole or not at all.

    Raises:
        OutputError: it cannot be written.
    """
    write_whole(path, to_toml(corrections))


def _entry(kind: str, number: int, table: dict[str, Any]) -> Correction:
    if kind == "place":
        return _place(number, table)
    if kind == "add_loop":
        return _added(number, table)
    if kind == "delete_loop":
        runs = [_run(value) for value in _list(table, "frames", "two frames or ranges of frames")]
        if len(runs) != 2:
            raise _Unfit(f"expected two frames or ranges in frames, found {len(runs)}")
        first, second = sorted(runs)
        return DeletedLoop(number, first, second)
    if kind == "exclude_frames":
        values = _list(table, "frames", "frames and ranges, as [3, [40, 55]]")
        if not values:
            raise _Unfit("expected frames, found none")
        return ExcludedFrames(number, tuple(_run(value) for value in values))
    ends = _list(table, "ends", "ends [[x, y], [x, y]]")
    if len(ends) != 2:
        raise _Unfit(f"expected two ends [[x, y], [x, y]], found {len(ends)}")
    first, last = (_numbers(end, 2, "an end [x, y]") for end in ends)
    if first == last:
        raise _Unfit("expected two different ends, found the same twice")
    return WallByHand(
        next(wall for wall in _WALLS if wall == kind),
        number,
        ((first[0], first[1]), (last[0], last[1])),
    )


def _place(number: int, table: dict[str, Any]) -> Place:
    is_of_file = "plan_file" in table
    if is_of_file == ("plan" in table):
        raise _Unfit("expected plan or plan_file, the point on the plan, found both or none")
    x, y = _numbers(table["plan_file" if is_of_file else "plan"], 2, "a point [x, y] of the plan")
    by_pixel = "frame" in table or "pixel" in table
    if by_pixel == ("scan" in table):
        raise _Unfit("expected frame and pixel, or scan, the point of the scan, found both or none")
    if not by_pixel:
        a, b, c = _numbers(table["scan"], 3, "a point [x, y, z] of the scan")
        return Place(number, (x, y), scan=(a, b, c), is_of_file=is_of_file)
    if "frame" not in table or "pixel" not in table:
        raise _Unfit("expected frame and pixel, found one of them")
    u, v = _numbers(table["pixel"], 2, "a pixel [u, v]")
    return Place(number, (x, y), _frame(table["frame"]), (u, v), is_of_file=is_of_file)


def _added(number: int, table: dict[str, Any]) -> AddedLoop:
    frames = [_frame(value) for value in _list(table, "frames", "two frames, as [12, 80]")]
    if len(frames) != 2 or frames[0] == frames[1]:
        raise _Unfit(f"expected two different frames, found {_shown(frames)}")
    if "pixels" not in table:
        return AddedLoop(number, (min(frames), max(frames)))
    pixels = [
        _numbers(value, 2, "a pixel [u, v]") for value in _list(table, "pixels", "two pixels")
    ]
    if len(pixels) != 2:
        raise _Unfit(f"expected a pixel of each frame, [[u, v], [u, v]], found {len(pixels)}")
    (one, a), (other, b) = sorted(zip(frames, pixels, strict=True))
    return AddedLoop(number, (one, other), ((a[0], a[1]), (b[0], b[1])))


def _note(table: dict[str, Any]) -> str:
    note = table.get(_NOTE, "")
    if not isinstance(note, str):
        raise _Unfit(f"expected words for note, found {_shown(note)}")
    return note


def _list(table: dict[str, Any], key: str, expected: str) -> list[Any]:
    if key not in table:
        raise _Unfit(f"expected {key}, {expected}, found none")
    value = table[key]
    if not isinstance(value, list):
        raise _Unfit(f"expected {expected} for {key}, found {_shown(value)}")
    return value


def _frame(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise _Unfit(f"expected the number of a frame, from 0, found {_shown(value)}")
    return value


def _run(value: Any) -> FrameRange:
    if not isinstance(value, list):
        return _frame(value), _frame(value)
    if len(value) != 2 or _frame(value[0]) > _frame(value[1]):
        raise _Unfit(f"expected a range of frames [first, last], found {_shown(value)}")
    return value[0], value[1]


def _numbers(value: Any, count: int, expected: str) -> tuple[float, ...]:
    is_list = isinstance(value, list) and len(value) == count
    if not is_list or not all(
        isinstance(v, int | float)
        and not isinstance(v, bool)
        and abs(v) < 1e12
        and math.isfinite(v)
        for v in value
    ):
        raise _Unfit(f"expected {expected}, found {_shown(value)}")
    return tuple(float(v) for v in value)


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def _lines(entry: Correction) -> list[str]:
    if isinstance(entry, Place):
        plan = f"{'plan_file' if entry.is_of_file else 'plan'} = {list(entry.plan)}"
        if entry.pixel is None:
            return [f"scan = {list(entry.scan or ())}", plan]
        return [f"frame = {entry.frame}", f"pixel = {list(entry.pixel)}", plan]
    if isinstance(entry, AddedLoop):
        pixels = entry.pixels and [f"pixels = {[list(pixel) for pixel in entry.pixels]}"]
        return [f"frames = {list(entry.frames)}", *(pixels or [])]
    if isinstance(entry, DeletedLoop):
        return [f"frames = [{_shorter(entry.first)}, {_shorter(entry.second)}]"]
    if isinstance(entry, ExcludedFrames):
        return [f"frames = [{', '.join(_shorter(run) for run in entry.ranges)}]"]
    return [f"ends = {[list(end) for end in entry.ends]}"]


def _shorter(run: FrameRange) -> str:
    return str(run[0]) if run[0] == run[1] else str(list(run))
