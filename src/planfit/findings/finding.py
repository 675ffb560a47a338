"""What a part of the program found out: facts, of which words are made only where somebody reads them."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from planfit.findings.message import Kind, Severity, filled, frame_ranges

Fact = float | str | bool | tuple[float, ...] | tuple[str, ...] | None
"""A number in the unit that its name ends in, a name, or several of either; None where it is not known."""

SCHEMA_VERSION = 1
"""Of the findings in `run.json` and `alignment.json`: raised where what programs read changes its sense; new
kinds and facts leave it."""


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
