"""The cases of the table: every building with every change, and every file that is only read."""

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from faults.inputs import Inputs

from buildings.changes import AS_RECORDED, DRIFTS, STEADINESS, Change
from buildings.plan_readings import plan_cases
from buildings.reading_cases import ReadingCase
from buildings.recordings import recording_cases
from buildings.sites import Building, buildings

SHORT_STEADINESS = ("frames left out, 3", "walls left out, 2")
"""Of the quick choice, beside the first drift of each building."""


@dataclass(frozen=True)
class Case:
    """One row of the table."""

    number: int
    name: str
    scan: str
    """Name of the building, or of the kind of files."""
    building: Building | None = None
    """None of files that are only read."""
    change: Change = AS_RECORDED
    reading: ReadingCase | None = None
    is_short: bool = False
    """Whether it is part of the quick choice."""
    seed: int = 0
    """Drifts are drawn from it."""

    def inputs(self, made: Inputs) -> Inputs:
        """The building's inputs as this case has them."""
        assert self.building is not None
        changed = made
        if self.change.is_steadiness:
            changed = self.building.base.apply(made, self._rng(self.building.base))
        return self.change.apply(changed, self._rng(self.change))

    def _rng(self, change: Change) -> np.random.Generator:
        # By name, not by number: a case stays the same wherever it stands in the list.
        words = f"{self.scan}: {change.name}".encode()
        return np.random.default_rng([self.seed, zlib.crc32(words)])


def all_cases(seed: int = 0) -> list[Case]:
    """All rows in the order of the table."""
    found = [*_of_buildings(seed)]
    for reading in (*plan_cases(), *recording_cases()):
        found.append(
            Case(0, reading.name, reading.building, reading=reading, is_short=reading.is_short)
        )
    return [_numbered(case, k) for k, case in enumerate(found)]


def choose(cases: Sequence[Case], only: str, is_short: bool) -> list[Case]:
    """Those whose name holds one of some words, `|` between them; of the quick choice alone if asked."""
    words = [word.strip() for word in only.split("|") if word.strip()]
    kept = [case for case in cases if case.is_short or not is_short]
    return [case for case in kept if not words or any(word in case.name for word in words)]


def base_name(case: Case) -> str:
    """Name of the case of which something was left out."""
    assert case.building is not None
    return f"{case.scan}: {case.building.base.name}"


def _of_buildings(seed: int) -> Iterator[Case]:
    for building in buildings():
        changes = list(DRIFTS)
        if building.base is AS_RECORDED:
            changes = [AS_RECORDED, *changes]
        if building.is_steadied:
            changes += STEADINESS
        for change in changes:
            is_short = change is building.base
            if building.is_steadied and change.name in SHORT_STEADINESS:
                is_short = True
            name = f"{building.name}: {change.name}"
            yield Case(0, name, building.name, building, change, None, is_short, seed)


def _numbered(case: Case, number: int) -> Case:
    return replace(case, number=number)
