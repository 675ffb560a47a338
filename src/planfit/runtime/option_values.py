"""Values of options by name: from files, records and Python; wrong names and kinds are told plainly."""

import dataclasses
import math
import types
import typing
from collections.abc import Mapping
from functools import cache
from numbers import Integral, Real
from pathlib import Path
from typing import Any, TypeVar

from planfit.errors import OptionError, did_you_mean

Options = TypeVar("Options")
_MAX_DIGITS = 9
"""Of a number in words: no frame, storey or length has more, and Python converts no more than 4,300."""


class Changeable:
    """Options that give copies of themselves in which one value is another."""

    def with_(self: Options, name: str, value: Any) -> Options:
        """A copy in which one option has another value: `options.with_("adjust.walls.weight", 2)`.

        Args:
            name: names that lead to it, by dots, as on the command line.
            value: as in Python, or as in TOML (text for a named choice).

        Raises:
            OptionError: there is no option of this name, which names the nearest, or it takes other values.
        """
        known = option_names(self)
        path = name.replace("-", "_")
        if path not in known:
            all_of_them = "'planfit help options' lists them all"
            raise OptionError(
                f"{name}: expected an option of {type(self).__name__}, found an unknown one; "
                f"{did_you_mean(path, known) or all_of_them}"
            )
        return _with(self, path.split("."), value, name)


def options_of(values: Mapping[str, Any], defaults: Options, where: str) -> Options:
    """Options dataclass with plain values, as in TOML and in run.json, in place of its defaults.

    Raises:
        OptionError: a name is unknown, or a value of another kind; the message begins with `where`.
    """
    found: Any = defaults
    known = {field.name: getattr(found, field.name) for field in dataclasses.fields(found)}
    changed = {}
    for raw_name, value in values.items():
        name = raw_name.replace("-", "_")
        if name not in known:
            meant = did_you_mean(name, known)
            raise OptionError(
                f"{where}unknown option {raw_name!r}; {f'{meant} ' if meant else ''}known: {', '.join(known)}"
            )
        changed[name] = _converted(known[name], value, f"{where}{raw_name}: ")
    return dataclasses.replace(found, **changed)


def whole_number(word: str) -> int | None:
    """The number from 0 that a word is; None where it is none, or looks like one alone (a superscript 2)."""
    return int(word) if word.isdecimal() and len(word) <= _MAX_DIGITS else None


def option_names(options: Any, prefix: str = "") -> list[str]:
    """Names of all options of a dataclass, and of the groups inside."""
    names = []
    for field in dataclasses.fields(options):
        name, value = f"{prefix}{field.name}", getattr(options, field.name)
        names.append(name)
        if dataclasses.is_dataclass(value):
            names += option_names(value, f"{name}.")
    return names


def require_kinds(options: Any) -> None:
    """Raise `OptionError` where a field of a dataclass of options, or of one inside, holds a value of another
    kind than it says."""
    hints = _hints(type(options))
    for field in dataclasses.fields(options):
        value, hint = getattr(options, field.name), hints[field.name]
        if not _is_of(value, hint):
            raise OptionError(
                f"{type(options).__name__}.{field.name}: expected {kind_words(hint)}, found "
                f"{_shortened(value)}{_advice(value, hint, field.name)}"
            )
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            require_kinds(value)


def _with(options: Any, path: list[str], value: Any, where: str) -> Any:
    head, *rest = path
    before = getattr(options, head)
    if rest:
        after = _with(before, rest, value, where)
    elif isinstance(before, tuple) and isinstance(value, list):
        after = tuple(value)
    else:
        after = value
    changed = dataclasses.replace(options, **{head: after})
    require_kinds(changed)
    return changed


def _converted(default: Any, value: Any, where: str) -> Any:
    if dataclasses.is_dataclass(default):
        if not isinstance(value, dict):
            raise OptionError(f"{where}expected a table of options, found {_shortened(value)}")
        return options_of(value, default, where)
    if isinstance(default, tuple) and isinstance(value, list):
        # An empty default tells no kind; the only such options hold text.
        return tuple(_converted(default[0] if default else "", item, where) for item in value)
    if isinstance(default, float) and type(value) is int and abs(value) < 2**1000:
        return float(value)
    is_number = not isinstance(value, float) or math.isfinite(value) or value == default
    if type(value) is not type(default) or not is_number:
        raise OptionError(f"{where}expected {type(default).__name__}, found {_shortened(value)}")
    return value


@cache
def _hints(cls: type) -> dict[str, Any]:
    return typing.get_type_hints(cls)


def _is_of(value: Any, hint: Any) -> bool:
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return any(_is_of(value, one) for one in inner)
    if origin is typing.Literal:
        return value in inner
    if origin is tuple:
        if not isinstance(value, tuple):
            return False
        if len(inner) == 2 and inner[1] is Ellipsis:
            return all(_is_of(one, inner[0]) for one in value)
        return len(value) == len(inner) and all(map(_is_of, value, inner))
    if hint is float:
        return isinstance(value, Real) and not isinstance(value, bool)
    if hint is int:
        return isinstance(value, Integral) and not isinstance(value, bool)
    # What has no class of its own to compare with, such as a callable, is left to who calls it.
    return isinstance(value, hint) if isinstance(hint, type) else True


def kind_words(hint: Any) -> str:
    """What an option takes: `a whole number`, `text`."""
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return " or ".join(kind_words(one) for one in inner)
    if origin is typing.Literal:
        return " or ".join(repr(one) for one in inner)
    if origin is tuple:
        return f"a tuple of {kind_words(inner[0])}"
    plain = {
        float: "a number",
        int: "a whole number",
        str: "text",
        bool: "True or False",
        type(None): "None",
    }
    return plain.get(hint) or getattr(hint, "__name__", str(hint))


def _shortened(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:80]}..."


def _advice(value: Any, hint: Any, name: str) -> str:
    """How to write what was probably meant."""
    kinds = (hint, *typing.get_args(hint))
    if isinstance(value, Mapping) and any(dataclasses.is_dataclass(kind) for kind in kinds):
        return f'; give one, or change single options: options.with_("{name}.NAME", value)'
    if isinstance(value, str) and Path in kinds:
        return f"; write Path({value!r})"
    return ""
