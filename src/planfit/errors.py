"""Errors a user can mend: each names the file, what was expected, what was found, the next step.

PlanfitError
├── ScanError       the scan (frames, poses, intrinsics, masks) cannot be used
├── FloorplanError  the plan cannot be read or does not make sense
├── OptionError     an option has a value that cannot work, or an unknown name
└── OutputError     results cannot be written
"""

import dataclasses
import difflib
import math
import unicodedata
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")
MAX_REASON = 160
"""Characters of a library's own words that an error repeats."""


MAX_MESSAGE = 2000
"""Characters of an error: a file may hold names and words of any length, which messages repeat."""


class PlanfitError(Exception):
    """Base of every error that is the input's and not the program's; the message is one line, whatever it
    repeats of a file."""

    def __init__(self, message: str = "") -> None:
        super().__init__(_one_line(message))


class ScanError(PlanfitError):
    """The scan cannot be used as it is."""


class FloorplanError(PlanfitError):
    """The floorplan cannot be read, or contradicts what it claims."""


class OptionError(PlanfitError):
    """An option is unknown or has a value that cannot work."""


class OutputError(PlanfitError):
    """Results cannot be written where they were asked for."""


def printable(text: str, keep: str = "") -> str:
    """Text as a terminal or a message may show it: control characters and marks that turn its direction,
    which file and layer names may hold, as their escapes; those in `keep` stay."""
    return "".join(
        c if c in keep or unicodedata.category(c) not in ("Cc", "Cf", "Cs") else
        c.encode("unicode_escape").decode()
        for c in text
    )  # fmt: skip


def _one_line(message: str) -> str:
    """Without line breaks and other control characters; of a long one the begin, and the end, which says what
    to do."""
    words = printable(" ".join(message.splitlines()))
    if len(words) <= MAX_MESSAGE:
        return words
    return f"{words[: MAX_MESSAGE // 2]} ... {words[-MAX_MESSAGE // 2 :]}"


def _words_of(error: BaseException) -> str:
    """What an error says of itself, of which not every library is able."""
    try:
        return str(error).strip()
    except Exception:
        return ""


@contextmanager
def told_as(kind: type[PlanfitError], path: Path, expected: str) -> Iterator[None]:
    """Whatever parsing a file raises becomes an error of the file: libraries raise what they come across.

    What the operating system says of files, and errors of planfit, pass.
    """
    try:
        yield
    except PlanfitError:
        raise
    except BaseException as error:
        # A library in Rust that gives up raises a PanicException, which is no Exception.
        is_panic = type(error).__name__ == "PanicException"
        if not is_panic and not isinstance(error, Exception):
            raise
        if isinstance(error, OSError) and error.errno is not None:
            raise
        why = _words_of(error).split("\n")[0][:MAX_REASON]
        found = f"{type(error).__name__}: {why}" if why else type(error).__name__
        raise kind(
            printable(
                f"{path}: expected {expected}, found a file that cannot be read ({found}); export it again"
            )
        ) from error


def each_told_as(
    kind: type[PlanfitError], path: Path, expected: str, items: Iterable[T]
) -> Iterator[T]:
    """What a library reads piece by piece, its errors told as by `told_as`; those of who takes it are not."""
    iterator = iter(items)
    while True:
        with told_as(kind, path, expected):
            try:
                item = next(iterator)
            except StopIteration:
                return
        yield item


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """`did you mean 'refine'?`, of the known word that is most like another; empty where none is like it.

    Of dotted names, one that ends as the word does comes first: `walls.weight` is `adjust.walls.weight`.
    """
    names = list(known)
    tail = word.lstrip("-").replace("_", "-")
    ends = [name for name in names if tail and name.replace("_", "-").endswith(f".{tail}")]
    close = ends or difflib.get_close_matches(word, names, n=1, cutoff=0.6)
    return f"did you mean {min(close, key=len)!r}?" if close else ""


def require(is_met: bool, message: str) -> None:
    """Raise `OptionError` with `message` unless the condition holds."""
    if not is_met:
        raise OptionError(message)


def require_positive(options: object, *names: str) -> None:
    """Raise `OptionError` unless the named fields of an options object are above 0."""
    for name in names:
        value = getattr(options, name)
        if not value > 0:
            raise OptionError(
                f"{type(options).__name__}.{name}: expected a number above 0, found {value}"
            )


def require_share(options: object, *names: str) -> None:
    """Raise `OptionError` unless the named fields of an options object are within 0 to 1."""
    for name in names:
        value = getattr(options, name)
        if not 0 <= value <= 1:
            raise OptionError(f"{type(options).__name__}.{name}: expected 0 to 1, found {value}")


def require_choice(options: object, name: str, *choices: str) -> None:
    """Raise `OptionError` unless the named field of an options object is one of `choices`."""
    value = getattr(options, name)
    if value not in choices:
        raise OptionError(
            f"{type(options).__name__}.{name}: expected {', '.join(choices[:-1])} or {choices[-1]}, "
            f"found {value!r}"
        )


def require_plain_numbers(options: object) -> None:
    """Raise `OptionError` unless every number in nested options is finite and not below 0."""
    for field in dataclasses.fields(options):  # type: ignore[arg-type]
        value = getattr(options, field.name)
        if dataclasses.is_dataclass(value):
            require_plain_numbers(value)
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, int | float) and not 0 <= number < math.inf:
                raise OptionError(
                    f"{type(options).__name__}.{field.name}: expected a finite number, 0 or more, "
                    f"found {number}"
                )
