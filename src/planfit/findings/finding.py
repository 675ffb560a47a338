"""What a part of the program found out: facts, of which words are made only where somebody reads them."""

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum, StrEnum, auto
from functools import partial
from string import Formatter
from typing import Any

import numpy as np
from jaxtyping import Float

from planfit.units import in_units, share_reached

Fact = float | str | bool | tuple[float, ...] | tuple[str, ...] | None
"""A number in the unit that its name ends in, a name, or several of either; None where it is not known."""

SCHEMA_VERSION = 1
"""Of the findings in `run.json` and `alignment.json`: raised where what programs read changes its sense; new
kinds and facts leave it."""
_Words = str | Callable[..., str] | tuple[str | Callable[..., str], ...]
"""A template that facts are put into by name, a function that takes facts by name, or several of these one
after the other."""
_GIVEN = frozenset(("frames", "which", "are", "first", "last", "runs", "parts"))
"""What words may ask for besides the facts of their kind: its frames ("3, 40-52"; "frames 3, 40-52"; "are"),
the ends of the first run of them, all runs, the words of its parts."""

FEW_NAMED = 3
"""Things of one kind that a sentence names one by one; of more it gives the number."""
MAX_NAMED = 6
"""The same of short names: frames, points."""


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
class _Message:
    """One kind of finding: how grave it is, and its words."""

    severity: Severity
    what: _Words
    """A sentence without its full stop."""
    advice: _Words = ""
    """The next step; empty where there is none, or where the sentence has it."""
    joint: str = "; "
    """Between the two."""

    @property
    def fact_names(self) -> frozenset[str]:
        """Facts that the words ask for."""
        return (_asked(self.what) | _asked(self.advice)) - _GIVEN


against = partial(_Message, Severity.AGAINST)
reservation = partial(_Message, Severity.RESERVATION)
warning = partial(_Message, Severity.WARNING)

note = partial(_Message, Severity.NOTE)


class Kind(Enum):
    """A kind of finding; its value is its row in the table."""

    @property
    def message(self) -> _Message:
        """Its words."""
        return self.value

    @property
    def code(self) -> str:
        """Its name in `run.json`; it stays when words change."""
        return self.name.lower()


@dataclass(frozen=True)
class Finding:
    """One thing that was found: decisions read its kind and facts, users its words."""

    kind: Kind
    facts: Mapping[str, Fact] = field(default_factory=dict)
    """By name. A kind has the same ones always (docs/findings.md)."""
    frames: tuple[tuple[int, int], ...] = ()
    """Runs of frames that it concerns, first and last, as numbered in the scan."""
    faces: tuple[int, ...] = ()
    """Faces of the plan that it concerns."""
    parts: tuple["Finding", ...] = ()
    """What it is made of, such as each of several moved walls."""
    subject: str = ""
    """The scan or the storey that it is about, where there are several. Frames are numbered in that scan."""

    def __post_init__(self) -> None:
        expected = self.kind.message.fact_names
        if not expected <= set(self.facts):
            raise ValueError(
                f"{self.kind}: expected the facts {sorted(expected)}, found {sorted(self.facts)}"
            )

    @property
    def severity(self) -> Severity:
        """What it means for who uses the result."""
        return self.kind.message.severity

    @property
    def words(self) -> str:
        """What was found: a sentence without its full stop."""
        sentence = filled(self.kind.message.what, self._fields)
        return f"{self.subject}: {sentence}" if self.subject else sentence

    @property
    def advice(self) -> str:
        """What to do about it; empty where there is nothing, or where the sentence has it."""
        return filled(self.kind.message.advice, self._fields)

    @property
    def sentence(self) -> str:
        """Words and advice, without a full stop."""
        advice = self.advice
        return f"{self.words}{self.kind.message.joint}{advice}" if advice else self.words

    def about(self, subject: str) -> "Finding":
        """The same, said of one of several scans or storeys."""
        return replace(self, subject=f"{subject}: {self.subject}" if self.subject else subject)

    @property
    def _fields(self) -> dict[str, Any]:
        fields: dict[str, Any] = dict(self.facts)
        fields["parts"] = tuple(part.sentence for part in self.parts)
        if self.frames:
            runs, (first, last) = frame_ranges(self.frames), self.frames[0]
            is_one = self.frames == ((first, first),)
            which = f"{'frame' if is_one else 'frames'} {runs}"
            fields |= {"runs": self.frames, "frames": runs, "first": first, "last": last}
            fields |= {"which": which, "are": "is" if is_one else "are"}
        return fields


def sentences_of(findings: Iterable[Finding]) -> tuple[str, ...]:
    """All findings for a user, a sentence each."""
    return tuple(each.sentence for each in findings)


def finding_record(finding: Finding) -> dict[str, Any]:
    """A finding as plain values, for JSON; its schema is docs/findings.md."""
    return {
        "kind": finding.kind.code,
        "severity": finding.severity.value,
        "facts": {name: _plain(value) for name, value in finding.facts.items()},
        "frames": [[int(first), int(last)] for first, last in finding.frames],
        "faces": [int(face) for face in finding.faces],
        "parts": [finding_record(part) for part in finding.parts],
        "subject": finding.subject,
        "words": finding.words,
        "advice": finding.advice,
    }


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_plain(each) for each in value]
    if isinstance(value, np.generic):
        value = value.item()
    # JSON has neither infinities nor NaN.
    return None if isinstance(value, float) and not np.isfinite(value) else value


class _WithUnits(Formatter):
    """Formats lengths whose template says so: `{off_m:.2f m}`, and `{low_m:.2f (m)}` where the next one has
    the unit; and shares that a limit is asked of: `{within_share:reached}`."""

    def format_field(self, value: Any, format_spec: str) -> str:
        """One fact."""
        if format_spec.endswith((" m", " (m)")):
            spec, _, unit = format_spec.partition(" ")
            return in_units(value, spec, unit if unit == "m" else "")
        if format_spec == "reached":
            return share_reached(value)
        return super().format_field(value, format_spec)


_FORMATTER = _WithUnits()


def filled(words: _Words, facts: Mapping[str, Any]) -> str:
    """A sentence with its facts."""
    if isinstance(words, tuple):
        return "".join(filled(each, facts) for each in words)
    if isinstance(words, str):
        return _FORMATTER.vformat(words, (), facts)
    return words(**{name: facts.get(name) for name in _asked(words)})


def _asked(words: _Words) -> frozenset[str]:
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
    more = f" and {len(ids) - MAX_NAMED} more" if len(ids) > MAX_NAMED else ""
    return ", ".join(ids[:MAX_NAMED]) + more


def direction_words(normal: Float[np.ndarray, " 2"], offset_m: float) -> str:
    """Which way a face is off, by the plan's axes: "towards +x"."""
    towards = normal * np.sign(offset_m)
    axis = int(np.argmax(np.abs(towards)))
    if abs(towards[axis]) < 0.9:
        return f"towards ({towards[0]:.2f}, {towards[1]:.2f})"
    return f"towards {'+' if towards[axis] > 0 else '-'}{'xy'[axis]}"
