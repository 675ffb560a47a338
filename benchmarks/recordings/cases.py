"""What is done to recordings, and what should come of it. The list only grows: a case's number is its place.

Thresholds and constants are chosen on even numbers, which are of the first frames of scans, and reported on
odd ones, which are of the last frames.
"""

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from planfit.pipeline.depth_unit import MILLIMETRE, REPLICA, TUM, WHOLE_UNITS
from planfit.units import FOOT_M
from recordings.sources import AT_RATE, NAMES

UNITS, RIGHT_UNITS, OWN_UNITS = "unit of depth changed", "unit of depth right", "poses in a unit"
MOUNTS, NO_MOUNTS, CLOCKS = "mount", "no mount", "clock"
N_UNITS, N_MOUNTS = 215, 43
"""The real lounge is on few machines: without it they are 201 and 40."""

_READ_IN = (MILLIMETRE, TUM, REPLICA)
"""What formats of whole numbers are read in where nothing states the unit."""
OTHER_UNITS = (
    *((read, stored) for read, stored in product(_READ_IN, WHOLE_UNITS) if read != stored),
    (1.0, MILLIMETRE),
    (1.0, FOOT_M),
)
"""Metres of the unit that depth is read in, and of the one that it is stored in."""


@dataclass(frozen=True)
class Clock:
    """How the times of a trajectory depart from those of images."""

    per_s: float = 1.0
    """Of the trajectory's numbers in a second."""
    late_s: float = 0.0
    """How much later images are taken than poses of the same time, at the first image."""
    rate: float = 0.0
    """By which share of the time images get later than their poses."""
    poses_hz: float = 30.0
    order: str = ""
    """`backwards`: the newest pose is written first; `set back`: by a third of a second, half way."""

    @property
    def words(self) -> str:
        """Of it, for a table."""
        unit = {1.0: "s", 1e3: "ms", 1e6: "us", 1e9: "ns"}[self.per_s]
        parts = [f"in {unit} at {self.poses_hz:g} Hz"]
        parts += [f"{1e3 * self.late_s:+g} ms"] if self.late_s else []
        parts += [f"rate {100 * self.rate:+g} %"] if self.rate else []
        return ", ".join([*parts, *([self.order] if self.order else [])])


CLOCK_FAULTS = (
    Clock(),
    Clock(late_s=0.05, poses_hz=100),
    Clock(per_s=1e9, late_s=-0.05, poses_hz=100),
    Clock(per_s=1e6, late_s=0.08),
    Clock(per_s=1e3, late_s=0.1, poses_hz=10),
    Clock(rate=0.005, poses_hz=100),
    Clock(rate=-0.005, late_s=0.03),
    Clock(rate=0.001, late_s=-0.05, poses_hz=100),
    Clock(per_s=1e9, rate=0.005, late_s=0.04, poses_hz=100),
    Clock(rate=-0.003, late_s=0.06, poses_hz=10),
    Clock(poses_hz=10),
    Clock(order="backwards"),
    Clock(late_s=0.06, order="backwards"),
    Clock(order="set back"),
    Clock(per_s=1e9, order="set back"),
)
"""Times begin in 2023: nanoseconds have nineteen digits."""


@dataclass(frozen=True)
class Case:
    """A recording and what is changed of it."""

    number: int
    group: str
    scan: str
    variant: int
    """Which of the group's changes, or 0."""

    @property
    def name(self) -> str:
        """In words; no two cases share it."""
        return f"{self.number}: {self.group}, {self.scan}, {self.words}"

    @property
    def words(self) -> str:
        """What is changed."""
        if self.group == UNITS:
            read_m, stored_m = OTHER_UNITS[self.variant]
            return f"stored in {_unit(stored_m)} and read in {_unit(read_m)}"
        return CLOCK_FAULTS[self.variant].words if self.group == CLOCKS else f"draw {self.variant}"

    @property
    def is_last(self) -> bool:
        """Whether it is of the last frames of its scan, and reports."""
        return self.number % 2 == 1

    def rng(self) -> np.random.Generator:
        """Of all that is random in it: it follows from the name, wherever the case stands in the list."""
        return np.random.default_rng(zlib.crc32(self.name.encode()))


def _unit(metres: float) -> str:
    return "m" if metres == 1.0 else f"1/{1 / metres:.5g} m"


def all_cases() -> tuple[Case, ...]:
    """All of the battery, in the order of their numbers."""
    return tuple(Case(k, *what) for k, what in enumerate(_chapters()))


def _chapters() -> Iterator[tuple[str, str, int]]:
    # As many as their number is even, so that places in the list and in the chapter are of one half.
    yield from _round(UNITS, N_UNITS + 1, len(OTHER_UNITS))
    yield from _round(RIGHT_UNITS, 4 * len(NAMES), len(_READ_IN) + 1)
    yield from _round(OWN_UNITS, 2 * len(NAMES), 1)
    yield from _round(MOUNTS, N_MOUNTS + 1, 1)
    yield from _round(NO_MOUNTS, 4 * len(NAMES), 1)
    for k, (variant, scan) in enumerate(product(range(len(CLOCK_FAULTS)), AT_RATE)):
        yield CLOCKS, AT_RATE[(AT_RATE.index(scan) + k // 2) % 2], variant


def _round(group: str, count: int, n_variants: int) -> Iterator[tuple[str, str, int]]:
    for k in range(count):
        turn = k // len(NAMES)
        yield group, NAMES[k % len(NAMES)], turn % n_variants if n_variants > 1 else turn


def choose(cases: Sequence[Case], only: str, every: int) -> list[Case]:
    """Cases whose names hold some words (several with `|` between), one in so many pairs of even and odd."""
    words = [word.strip().lower() for word in only.split("|") if word.strip()]
    return [
        case
        for case in cases
        if (not words or any(word in case.name.lower() for word in words))
        and case.number // 2 % every == 0
    ]
