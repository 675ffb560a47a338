"""What may stand behind a flag: how many words, of what kind, and what is wrong with one."""

import sys
import types
import typing
from enum import Enum
from pathlib import Path
from typing import Any

from planfit.cli.flags import Flag
from planfit.errors import did_you_mean
from planfit.runtime import choices_of, kind_words, member_of


def word_counts(flag: Flag) -> tuple[int, int]:
    """How many words a flag takes, at least and at most."""
    hint = flag.type
    # Of those that may be repeated, each takes what one item takes.
    return _counts(typing.get_args(hint)[0] if flag.is_repeated else hint)


def _counts(hint: Any) -> tuple[int, int]:
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        return _counts(_without_none(hint)[0])
    inner = typing.get_args(hint)
    if typing.get_origin(hint) is not tuple:
        return 1, 1
    if inner[-1] is Ellipsis:
        return 0, sys.maxsize
    return len(inner), len(inner)


def _without_none(hint: Any) -> list[Any]:
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        return [one for one in typing.get_args(hint) if one is not type(None)]
    return [hint]


def _single(hint: Any) -> Any:
    """The kind of one word of a value."""
    (hint, *_) = _without_none(hint)
    if typing.get_origin(hint) is tuple:
        return _single(typing.get_args(hint)[0])
    return hint


def _listed(hint: Any) -> list[str]:
    """The words that one may choose from, if these can be listed."""
    kind = _single(hint)
    if typing.get_origin(kind) is typing.Literal:
        return [str(one) for one in typing.get_args(kind)]
    return [*choices_of(kind)] if isinstance(kind, type) and issubclass(kind, Enum) else []


def wanted(flag: Flag) -> str:
    """What each word behind a flag must be."""
    listed = _listed(flag.type)
    if listed:
        return f"one of {', '.join(listed)}"
    if flag.metavar:
        return flag.metavar
    kind = _single(flag.type)
    return "a path" if kind is Path else kind_words(kind)


def fault_of_value(flag: Flag, name: str, word: str, prog: str) -> str:
    """What is wrong with one word of a value; empty where nothing is."""
    kind, listed = _single(flag.type), _listed(flag.type)
    if word == "None" and type(None) in typing.get_args(flag.type):
        return ""
    try:
        if isinstance(kind, type) and issubclass(kind, Enum):
            member_of(kind, word)
        elif kind in (int, float):
            kind(word)
        elif listed and word not in listed:
            raise ValueError
    except ValueError:
        step = did_you_mean(word, listed) if listed else example(flag, name)
        step = step or f"'{prog} --help-all' tells what they mean"
        return f"{name}: expected {wanted(flag)}, found {word!r}; {step}"
    return ""


def example(flag: Flag, name: str) -> str:
    """The next step where the default shows how a value is written."""
    default = flag.default.name.lower() if isinstance(flag.default, Enum) else flag.default
    if isinstance(default, tuple) and default and not isinstance(default[0], tuple):
        default = " ".join(map(str, default))
    is_shown = isinstance(default, str | int | float) and default != ""
    return f"write it as {name} {default}" if is_shown else ""
