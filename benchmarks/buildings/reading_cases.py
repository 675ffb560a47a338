"""What a case of a file that is only read is, and how what was found is held beside what is right."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from faults.measure import REFUSED
from faults.scans import SHARED

from buildings.rows import Fact, Reading
from planfit.errors import PlanfitError


@dataclass(frozen=True)
class ReadingCase:
    """One plan or recording, how it is read, and what is known of it."""

    name: str
    """No other case has it: "plan archicad-sheet-pdf"."""
    building: str
    """Kind of files: "plans", "field plans", "recordings"."""
    path: str
    """In the folder of test inputs."""
    read: Callable[[], Reading]
    """Of a module, or a `partial` of one: each case is read in a process of its own."""
    is_short: bool = False
    """Whether it is part of the quick choice."""


def present(case: ReadingCase) -> bool:
    """Whether its file is at hand."""
    return (SHARED / case.path).exists()


def fact_within(what: str, right: float, found: float, tolerance: float) -> Fact:
    """A number that is right within a tolerance, both in the unit that `what` names."""
    words = f"{right:.4g} +- {tolerance:.2g}"
    return Fact(what, words, f"{found:.4g}", abs(found - right) <= tolerance)


def fact_between(what: str, low: float, high: float, found: float) -> Fact:
    """A number that is right from `low` to `high`, both included."""
    return Fact(what, f"{low:.4g} to {high:.4g}", f"{found:.4g}", low <= found <= high)


def fact_at_least(what: str, least: float, found: float) -> Fact:
    """A number that is right from `least` on."""
    return Fact(what, f"{least:.4g} or more", f"{found:.4g}", found >= least)


def fact_at_most(what: str, most: float, found: float) -> Fact:
    """A number that is right up to `most`."""
    return Fact(what, f"{most:.4g} or less", f"{found:.4g}", found <= most)


def fact_same(what: str, right: object, found: object) -> Fact:
    """What has one right value."""
    return Fact(what, str(right), str(found), found == right)


def names_one_of(sentence: str, words: Iterable[str], path: Path | None = None) -> bool:
    """Whether a sentence holds one of some words, in any case of letters; not in the path of the file that it
    speaks of, which may be called like the trouble."""
    if path is not None:
        sentence = sentence.replace(str(path), "").replace(str(path.parent), "")
    return any(word.lower() in sentence.lower() for word in words)


def read_or_refused(
    read: Callable[[], Reading], steps: Sequence[str] = (), path: Path | None = None
) -> Reading:
    """What was read, or the sentence of the refusal.

    Args:
        read: reads, and holds what it found beside what is right.
        steps: words of which a refusal that says what works has one; none: no refusal is right.
        path: file that is named in the sentence.
    """
    try:
        return read()
    except PlanfitError as error:
        sentence = str(error)
        is_right = names_one_of(sentence, steps, path)
        return Reading((), sentence, exit_code=REFUSED, is_refusal_right=is_right)


def case_of(
    kind: str,
    building: str,
    name: str,
    path: str,
    read: Callable[[], Reading],
    steps: Sequence[str] = (),
    is_short: bool = False,
) -> ReadingCase:
    """A case named by what it is (`kind`) and its own name, whose refusals are told from crashes."""
    guarded = partial(read_or_refused, read, tuple(steps), SHARED / path)
    return ReadingCase(f"{kind} {name}", building, path, guarded, is_short)
