"""The cases of the battery: which fault, how large, on which scan with which drift. The list only grows.

A case's number is its place in the list, so chapters are added at the end. Even numbers are there to choose
thresholds on, odd ones to report on: every chapter has both of every fault.
"""

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from faults.images import IMAGES, LOOK_ALIKES
from faults.inputs import Fault, Inputs
from faults.plans import NO_PLAN, PLANS
from faults.poses import CONVENTIONS, ORDER, TRACKING
from faults.scans import NICHES, SYNTHETIC, WALKS, rendered_walks

FAULTS: dict[str, Fault] = {
    fault.name: fault
    for fault in (*TRACKING, *CONVENTIONS, *ORDER, *PLANS, *IMAGES, *LOOK_ALIKES, NO_PLAN)
}


@dataclass(frozen=True)
class Part:
    """One fault of a case."""

    fault: str
    size: int
    """0, 1, 2 from small to large; 0 where there is but one."""


@dataclass(frozen=True)
class Case:
    """A scan with a drift, and up to two faults; without any, what the others are compared with."""

    number: int
    scan: str
    drift_seed: int
    parts: tuple[Part, ...] = ()

    @property
    def name(self) -> str:
        """Scan, drift and faults in words; no two cases share it."""
        return f"{self.scan}, drift {self.drift_seed}: {self.faults_in_words}"

    @property
    def faults_in_words(self) -> str:
        """Without the scan."""
        words = []
        for part in self.parts:
            size = FAULTS[part.fault].sizes[part.size]
            words.append(f"{part.fault}, {size}" if size else part.fault)
        return " + ".join(words) or "none"

    @property
    def is_reference(self) -> bool:
        """Whether others are compared with it: it has no fault."""
        return all(part.fault == NO_PLAN.name for part in self.parts)

    @property
    def reference(self) -> tuple[str, int, bool]:
        """Scan, drift and whether there is a plan: cases that share them are compared with the reference
        among them."""
        return self.scan, self.drift_seed, Part(NO_PLAN.name, 0) not in self.parts

    def spoil(self, inputs: Inputs) -> Inputs:
        """The drifted inputs with the faults of this case, the first one first.

        Raises:
            ScanError: no scan can have such poses.
        """
        for k, part in enumerate(self.parts):
            # By name, not by number: a case stays the same wherever it stands in the list.
            rng = np.random.default_rng([zlib.crc32(self.name.encode()), k])
            inputs = FAULTS[part.fault].spoil(inputs, part.size, rng)
        return inputs


def all_cases() -> tuple[Case, ...]:
    """All of the battery, in the order of their numbers; what an earlier chapter has is not taken again."""
    return tuple(Case(k, *what) for k, what in enumerate(dict.fromkeys(_chapters())))


What = tuple[str, int, tuple[Part, ...]]


def _chapters() -> Iterator[What]:
    """What each case is, chapter by chapter."""
    yield from _faultless()
    yield from _conslam_alone()
    yield from _conslam_over_drifts()
    yield from _synthetic_alone()
    yield from _conventions()
    yield from _kitchen()
    yield from _pairs()
    yield from _look_alikes()
    yield from _without_plan()
    yield from _starts()
    yield from _rendered_walks()


def _sizes(faults: Sequence[Fault]) -> Iterator[Part]:
    for fault in faults:
        for size in range(len(fault.sizes)):
            yield Part(fault.name, size)


def _faultless() -> Iterator[What]:
    """What the others are compared with; also the starts that optimality is measured over."""
    for seed in range(10):
        yield "conslam", seed, ()
    for seed in range(5):
        yield "kitchen", seed, ()
    for scan in SYNTHETIC:
        for seed in range(8):
            yield scan.name, seed, ()


def _conslam_alone() -> Iterator[What]:
    """Every fault in every size on the real scan, each over two drifts: one number even, one odd."""
    for part in _sizes((*TRACKING, *CONVENTIONS, *ORDER, *PLANS, *IMAGES)):
        for seed in (4, 5):
            yield "conslam", seed, (part,)


def _conslam_over_drifts() -> Iterator[What]:
    """What is asked for over ten drifts."""
    for part in (Part("drift", 1), Part("walls missing", 2), Part("walls moved", 1)):
        for seed in (0, 1, 2, 3, 6, 7, 8, 9):
            yield "conslam", seed, (part,)
    for name in ("one jump", "two jumps", "three jumps"):
        for size in range(3):
            for seed in (0, 7):
                yield "conslam", seed, (Part(name, size),)


def _synthetic_alone() -> Iterator[What]:
    """Every fault of tracking, plan and order in every size, going round the synthetic scans."""
    parts = list(_sizes((*TRACKING, *PLANS, *ORDER, *IMAGES)))
    for k, part in enumerate(parts):
        for turn in range(2):
            scan = SYNTHETIC[(3 * k + 5 * turn + k // 10) % len(SYNTHETIC)]
            yield scan.name, (k + turn) % 8, (part,)
    for name in ("one jump", "two jumps", "three jumps", "plan too large", "plan too small"):
        for size in range(3):
            for turn in range(2):
                scan = SYNTHETIC[(size + 4 * turn + 1) % len(SYNTHETIC)]
                yield scan.name, 6 + turn - 3, (Part(name, size),)


def _conventions() -> Iterator[What]:
    """Every convention on every scan that it can be told on."""
    delays = (Part("delay", 0), Part("delay", 2))
    for k, part in enumerate((*_sizes(CONVENTIONS), *delays)):
        for j, scan in enumerate(SYNTHETIC):
            # Two of ten scans of the delays are among those above already.
            seed = (k + j) % 8 if part not in delays else (k + j + 4) % 8
            yield scan.name, seed, (part,)


def _kitchen() -> Iterator[What]:
    """The room with a plan drawn by hand; it does not say which way is up."""
    kinds = [fault for fault in CONVENTIONS if fault.name != "z up"]
    for k, part in enumerate(_sizes((*TRACKING, *kinds, *ORDER))):
        yield "kitchen", k % 4, (part,)
    for k, part in enumerate((Part("walls missing", 1), Part("other building", 0),
                              Part("plan too large", 1), Part("walls moved", 1))):  # fmt: skip
        yield "kitchen", k % 4, (part,)


_PAIRS = (
    ("drift", "walls moved"),
    ("drift", "walls missing"),
    ("one jump", "walls missing"),
    ("one jump", "walls moved"),
    ("three jumps", "plan too large"),
    ("two jumps", "drift"),
    ("frozen, then on", "walls added"),
    ("gap", "wing rebuilt"),
    ("walls moved", "plan too small"),
    ("walls missing", "walls moved"),
    ("drift", "depth long"),
    ("one jump", "clock"),
)


def _pairs() -> Iterator[What]:
    """Two faults at once, both of one size, on ConSLAM and a synthetic scan."""
    for k, (first, second) in enumerate(_PAIRS):
        for size in range(3):
            parts = (Part(first, size), Part(second, size))
            # A drift anew would undo a jump: it comes first.
            if second == "drift":
                parts = parts[::-1]
            yield "conslam", (k + size) % 4 + 5, parts
            yield SYNTHETIC[(k + 3 * size) % len(SYNTHETIC)].name, k % 8, parts


def _look_alikes() -> Iterator[What]:
    """Forty walks without posters, and the same with the same posters in many places."""
    for k, scan in enumerate(WALKS):
        bare = (scan.name, k % 4, ())
        hung = (scan.name, k % 4, (Part("same posters", k // 2 % 3),))
        # In turns, so that both halves of the battery have walks with posters.
        yield from (bare, hung) if k % 2 else (hung, bare)


def _without_plan() -> Iterator[What]:
    """The kitchen, which came without a plan, and each fault of tracking there; others without a fault."""
    none = Part(NO_PLAN.name, 0)
    for scan in ("kitchen", "conslam", "flat", "same offices"):
        for seed in range(4):
            yield scan, seed, (none,)
    for k, part in enumerate(_sizes((*TRACKING, *ORDER))):
        yield "kitchen", k % 4, (none, part)


def _starts() -> Iterator[What]:
    """Drift of about one and three per cent of the way where a scan a decimetre off finds a face as well."""
    for scan in NICHES:
        for seed in range(8):
            yield scan.name, seed, ()
            yield scan.name, seed, (Part("drift", 0),)


def _rendered_walks() -> Iterator[What]:
    """Walks rendered in real plans."""
    parts = [(), *[(Part(name, 1),) for name in (
        "one jump", "three jumps", "drift", "frozen, then on", "walls missing", "walls moved",
        "other building",
    )]]  # fmt: skip
    for k, scan in enumerate(rendered_walks()):
        for part in parts:
            yield scan.name, k % 4, part


def choose(
    cases: Sequence[Case], only: str = "", scans: Sequence[str] = (), every: int = 1
) -> list[Case]:
    """A choice of cases, with those that they are compared with.

    Args:
        cases: all of them.
        only: words of the name; all cases where empty. Several, with `|` between, are any of them.
        scans: names of scans; all where empty.
        every: one in so many pairs of an even and an odd number.
    """
    words = [word.strip().lower() for word in only.split("|") if word.strip()]
    chosen = [
        case
        for case in cases
        if (not words or any(word in case.name.lower() for word in words))
        and (not scans or case.scan in scans)
        and case.number // 2 % every == 0
    ]
    references = {case.reference for case in chosen}
    numbers = {case.number for case in chosen}
    numbers |= {case.number for case in cases if case.is_reference and case.reference in references}
    return [case for case in cases if case.number in numbers]
