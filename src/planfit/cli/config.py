"""Options from and to TOML and run.json: the same names as on the command line, unknown ones are errors."""

import dataclasses
import tomllib
from enum import Enum
from pathlib import Path
from typing import Any, TypeVar

from planfit.errors import OptionError, ScanError
from planfit.export.record import plain
from planfit.scan import ScanOptions

Options = TypeVar("Options")
_FILES_OF_SCAN = ("poses", "calibration")
"""Fields of `ScanOptions` that are paths."""


def read_options(path: Path, defaults: Options) -> Options:
    """Options dataclass with the values of a TOML file in place of its defaults.

    Raises:
        OptionError: the file is missing or not TOML, a name is unknown, or a value of another kind.
    """
    try:
        values = tomllib.loads(path.read_text())
    except OSError as error:
        raise OptionError(f"{path}: expected a TOML file of options, {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise OptionError(f"{path}: expected TOML, found {error}") from error
    return options_of(values, defaults, f"{path}: ")


def to_toml(options: Any) -> str:
    """Options dataclass as TOML text."""
    return "\n".join(_toml_lines(plain(options), ())) + "\n"


def scan_options_record(options: ScanOptions) -> dict[str, Any]:
    """How a scan was read as plain values; relative paths of files would lead nowhere later."""
    values = dataclasses.asdict(options)
    for name in _FILES_OF_SCAN:
        values[name] = str(values[name].resolve()) if values[name] else None
    return values


def scan_options_of(record: dict[str, Any], where: str) -> ScanOptions:
    """How the run of a record read its scan.

    Raises:
        ScanError: the record is of another version; the message begins with `where`.
    """
    values = dict(record.get("scan_options") or {})
    for name in _FILES_OF_SCAN:
        if values.get(name):
            values[name] = Path(values[name])
    try:
        return ScanOptions(**values)
    except TypeError as error:
        raise ScanError(
            f"{where}expected scan_options of this version of planfit, found others ({error}); "
            "run planfit refine again"
        ) from error


def options_of(values: dict[str, Any], defaults: Options, where: str) -> Options:
    """Options dataclass with plain values, as in TOML and in run.json, in place of its defaults.

    Raises:
        OptionError: a name is unknown, or a value of another kind; the message begins with `where`.
    """
    return _replaced(defaults, values, where)


def choices_of(kind: type[Enum]) -> dict[str, Enum]:
    """Members by their names as they are shown."""
    return {member.name.lower(): member for member in kind}


def member_of(kind: type[Enum], word: str) -> Enum:
    """The member that a word names, in any case, `-` and `_` alike.

    Raises:
        ValueError: there is none of this name.
    """
    choices = choices_of(kind)
    name = word.lower().replace("-", "_")
    if name not in choices:
        raise ValueError(f"expected one of {', '.join(choices)}, found {word!r}")
    return choices[name]


def _replaced(defaults: Any, values: dict[str, Any], where: str) -> Any:
    known = {field.name: getattr(defaults, field.name) for field in dataclasses.fields(defaults)}
    changed = {}
    for raw_name, value in values.items():
        name = raw_name.replace("-", "_")
        if name not in known:
            raise OptionError(f"{where}unknown option {raw_name!r}; known: {', '.join(known)}")
        changed[name] = _converted(known[name], value, f"{where}{raw_name}: ")
    return dataclasses.replace(defaults, **changed)


def _converted(default: Any, value: Any, where: str) -> Any:
    if dataclasses.is_dataclass(default):
        if not isinstance(value, dict):
            raise OptionError(f"{where}expected a table of options, found {value!r}")
        return _replaced(default, value, where)
    if isinstance(default, Enum):
        try:
            return member_of(type(default), str(value))
        except ValueError as error:
            raise OptionError(f"{where}{error}") from error
    if isinstance(default, tuple) and isinstance(value, list):
        # An empty default tells no kind; the only such options hold text.
        return tuple(_converted(default[0] if default else "", item, where) for item in value)
    if isinstance(default, float) and type(value) is int:
        return float(value)
    if type(value) is not type(default):
        raise OptionError(f"{where}expected {type(default).__name__}, found {value!r}")
    return value


def _toml_lines(values: dict[str, Any], path: tuple[str, ...]) -> list[str]:
    lines = [f"[{'.'.join(path)}]"] if path else []
    lines += [f"{k} = {_toml(v)}" for k, v in values.items() if not isinstance(v, dict)]
    for name, value in values.items():
        if isinstance(value, dict):
            lines += ["", *_toml_lines(value, (*path, name))]
    return lines


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, list):
        return "[" + ", ".join(_toml(item) for item in value) + "]"
    return repr(value)
