"""What is kept of a case: poses beside their truth, or what was read of a file beside what is right."""

from dataclasses import dataclass, field
from typing import Any

from faults.measure import Measured

SILENT, DOUBTED, REFUSED, RIGHT = "silent wrong", "doubted", "refused", "right"
"""How a reading ended."""


@dataclass(frozen=True)
class Fact:
    """One thing that is to be read of a file."""

    what: str
    """What was looked at, with its unit."""
    right: str
    """What is right, in words or numbers."""
    found: str
    is_right: bool


@dataclass(frozen=True)
class Reading:
    """What was read of one plan or recording."""

    facts: tuple[Fact, ...]
    """Empty where it was refused."""
    refusal: str = ""
    """The sentence of the error; empty where it was read."""
    doubts: tuple[str, ...] = ()
    """What planfit says against its own reading."""
    exit_code: int = 0
    """As the command line gives it."""
    is_refusal_right: bool = False
    """Whether the refusal names the step that works."""

    @property
    def outcome(self) -> str:
        """`RIGHT`, `DOUBTED` (wrong, and said so), `REFUSED`, or `SILENT` (wrong without a word)."""
        if self.refusal:
            return RIGHT if self.is_refusal_right else REFUSED
        if all(fact.is_right for fact in self.facts):
            return RIGHT
        return DOUBTED if self.doubts or self.exit_code else SILENT


@dataclass(frozen=True)
class Row(Measured):
    """What came of a case; numbers of poses are None where only a file was read."""

    building: str = ""
    change: str = ""
    """Drift of the recorded poses, or what was left out; empty of files that are only read."""
    is_metric: bool = True
    """Whether the plan was given with its unit: else errors are those on the plan, its scale undone."""
    height_before_m: float | None = None
    """RMS error of recorded heights, less their mean."""
    height_m: float | None = None
    """The same of refined ones."""
    sigmas: float | None = None
    """RMS error of positions over the RMS of the predicted one."""
    scale_sigma: float | None = None
    """Predicted standard deviation of the plan's scale, as a share; 0 where it was known."""
    corrections: dict[str, list] = field(default_factory=dict)
    """By kind: what was announced, the truth, and `right`, `false` or `missed`."""
    decisions: dict[str, Any] = field(default_factory=dict)
    """What may not flip when a little is left out: outcome, scale, calibration, thickness, place."""
    flipped: list[str] = field(default_factory=list)
    """Decisions that flipped, where something was left out."""
    moved_within: float | None = None
    """Share of frames that moved by less than twice their predicted error, where something was left out."""
    reading: str = ""
    """How the reading of a file ended."""
    facts: list[list] = field(default_factory=list)
    """Of a file: what, right, found, whether that is right."""
    cpu_s: float = 0.0
    peak_gb: float = 0.0
