"""What all kinds of findings have: a severity, a sentence, a next step."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, StrEnum, auto
from functools import partial
from string import Formatter
from typing import Any

import numpy as np
from jaxtyping import Float

Words = str | Callable[..., str] | tuple[str | Callable[..., str], ...]
"""A template that facts are put into by name, a function that takes facts by name, or several of these one
after the other."""
GIVEN = frozenset(("frames", "which", "are", "first", "last", "runs", "parts"))
"""What words may ask for besides the facts of their kind: its frames ("3, 40-52"; "frames 3, 40-52"; "are"),
the ends of the first run of them, all runs, the words of its parts."""

FEW_NAMED = 3
"""Things of one kind that a sentence names one by one; of more it gives the number."""


class Severity(StrEnum):
    """What a finding means for who uses the result."""

    NOTE = auto()
    """What was found and dealt with; nothing is left to do."""
    WARNING = auto()
    """Something to look at; the result may be right nevertheless."""
    RESERVATION = auto()
    """The result is not vouched for where the finding says: its frames, or all."""
    AGAINST = auto()
    """The recorded poses are to be preferred."""


@dataclass(frozen=True)
class Message:
    """One kind of finding: how grave it is, and its words."""

    severity: Severity
    what: Words
    """A sentence without its full stop."""
    advice: Words = ""
    """The next step; empty where there is none, or where the sentence has it."""
    joint: str = "; "
    """Between the two."""

    @property
    def fact_names(self) -> frozenset[str]:
        """Facts that the words ask for."""
        return (_asked(self.what) | _asked(self.advice)) - GIVEN


note = partial(Message, Severity.NOTE)
warning = partial(Message, Severity.WARNING)
reservation = partial(Message, Severity.RESERVATION)
against = partial(Message, Severity.AGAINST)


class Kind(Enum):
    """A kind of finding; its value is its row in the table."""

    @property
    def message(self) -> Message:
        """Its words."""
        return self.value

    @property
    def code(self) -> str:
        """Its name in `run.json`; it stays when words change."""
        return self.name.lower()


def filled(words: Words, facts: Mapping[str, Any]) -> str:
    """A sentence with its facts."""
    if isinstance(words, tuple):
        return "".join(filled(each, facts) for each in words)
    if isinstance(words, str):
        return words.format_map(facts)
    return words(**{name: facts.get(name) for name in _asked(words)})


def _asked(words: Words) -> frozenset[str]:
    if isinstance(words, tuple):
        return frozenset().union(*(_asked(each) for each in words))
    if isinstance(words, str):
        return frozenset(name for _, name, _, _ in Formatter().parse(words) if name)
    return frozenset(inspect.signature(words).parameters)


def frame_ranges(runs: Sequence[tuple[int, int]], max_runs: int = 5) -> str:
    """ "3, 40-52 and 60-61": runs of frames by their first and last."""
    names = [f"{first}" if first == last else f"{first}-{last}" for first, last in runs]
    if len(names) > max_runs:
        names = [*names[:max_runs], f"{len(names) - max_runs} more runs"]
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def some_ids(ids: Sequence[str]) -> str:
    """The first few of some points' names."""
    return ", ".join(ids[:6]) + (f" and {len(ids) - 6} more" if len(ids) > 6 else "")


def direction_words(normal: Float[np.ndarray, " 2"], offset_m: float) -> str:
    """Which way a face is off, by the plan's axes: "towards +x"."""
    towards = normal * np.sign(offset_m)
    axis = int(np.argmax(np.abs(towards)))
    if abs(towards[axis]) < 0.9:
        return f"towards ({towards[0]:.2f}, {towards[1]:.2f})"
    return f"towards {'+' if towards[axis] > 0 else '-'}{'xy'[axis]}"
