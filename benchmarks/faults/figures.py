"""What the battery asks of planfit, counted from its measurements."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from faults.cases import FAULTS, Case, Part
from faults.measure import CRASHED, REFUSED, Measured
from planfit.errors import PlanfitError

JUMPS = ("one jump", "two jumps", "three jumps")
WITHOUT_PLACE = ("other building",)
NEVER_VOUCHED = (*WITHOUT_PLACE, "shuffled poses", "constant poses")
SCALES = ("plan too large", "plan too small")
WRONG_FAULTLESS_TIMES = 2.0
"""A scan without a fault that errs by more than this times the median over its drifts went wrong."""
WRONG_M, WRONG_TIMES, RIGHT_TIMES = 0.10, 3.0, 1.5


@dataclass(frozen=True)
class Result:
    """A case, what came of it, and the error of the same scan and drift without a fault."""

    case: Case
    measured: Measured
    faultless_m: float | None

    @property
    def is_even(self) -> bool:
        """Even numbers are there to choose thresholds on."""
        return self.case.number % 2 == 0

    @property
    def faults(self) -> tuple[str, ...]:
        """Names."""
        return tuple(part.fault for part in self.case.parts)

    @property
    def is_silent_wrong(self) -> bool:
        """Exit code 0, but wrong by much more than without the fault, worse than the input, or without a
        place on the plan."""
        m = self.measured
        if m.exit_code != 0 or m.error_m is None or m.before_m is None:
            return False
        if any(fault in WITHOUT_PLACE for fault in self.faults):
            return True
        limit = max(WRONG_M, WRONG_TIMES * (self.faultless_m or 0.0))
        return m.error_m > limit or m.error_m > m.before_m

    @property
    def is_right(self) -> bool:
        """Nearly as good as without the fault, and no worse than the input."""
        m = self.measured
        if m.error_m is None or m.before_m is None or m.error_m > m.before_m:
            return False
        return self.within(RIGHT_TIMES)

    def within(self, times: float, plus_m: float = 0.0) -> bool:
        """Whether there is a result whose error is at most so many times the faultless one, and a bit."""
        if any(fault in WITHOUT_PLACE for fault in self.faults):
            return False
        error_m = self.measured.error_m
        if error_m is None or self.faultless_m is None:
            return False
        return error_m <= times * self.faultless_m + plus_m


@dataclass(frozen=True)
class Figure:
    """One line of what is asked."""

    name: str
    asked: str
    found: str
    n: int
    """Cases that it was counted over."""


def match_results(cases: Sequence[Case], measured: Iterable[Measured]) -> list[Result]:
    """Cases with their last measurement, by number; measurements of cases of another name are left out."""
    last = {m.number: m for m in measured}
    done = [(case, last[case.number]) for case in cases if case.number in last]
    done = [(case, m) for case, m in done if m.name == case.name]
    own = {
        case.reference: m.error_m for case, m in done if case.is_reference and m.error_m is not None
    }
    return [Result(case, m, _faultless(case, own)) for case, m in done]


def _faultless(case: Case, own: dict[tuple[str, int, bool], float]) -> float | None:
    """Error without the fault; where that went wrong by itself, what the scan's other drifts allow."""
    if case.reference not in own:
        return None
    scan, _, has_plan = case.reference
    others = [error for key, error in own.items() if (key[0], key[2]) == (scan, has_plan)]
    return min(own[case.reference], WRONG_FAULTLESS_TIMES * float(np.median(others)))


def make_figures(results: Sequence[Result]) -> list[Figure]:
    """All that is asked; figures without cases have 0 of them."""
    alone = [r for r in results if len(r.case.parts) == 1]
    jumps = [r for r in alone if r.faults[0] in JUMPS]
    scales = [r for r in alone if r.faults[0] in SCALES]
    solved = [r for r in results if r.measured.cost_from_truth is not None and _is_start(r.case)]
    optimal = [r for r in solved if _is_optimal(r)]
    told = [r for r in results if r.measured.convention]
    ten_drifts = [r for r in alone if r.case.scan == "conslam"]
    return [
        _count("silent wrong", "0", results, lambda r: r.is_silent_wrong),
        _share("vouched for when right", 0.95, [r for r in results if r.is_right], _is_vouched),
        _share("jumps within 1.3 times + 2 cm", 0.95, jumps, lambda r: r.within(1.3, 0.02)),
        _worst("six times the drift, ConSLAM", 0.15, ten_drifts, "drift", 1),
        _worst("half of the walls missing, ConSLAM", 0.15, ten_drifts, "walls missing", 2),
        _worst("30 % of the walls moved, ConSLAM", 0.15, ten_drifts, "walls moved", 1),
        _moved_named(results),
        _count("look-alikes beyond 1.5 times", "0", _of(alone, "same posters"), _is_torn),
        _share("scale: told within 0.3 %", 0.95, scales, _has_scale),
        _share("conventions named", 0.95, told, lambda r: bool(r.measured.is_recognised)),
        _count("conventions named wrongly of right poses", "0",
               [r for r in results if not r.measured.convention], _is_accused),
        _count("wrong plans, shuffled, constant: exit 0", "0",
               [r for r in results if set(r.faults) & set(NEVER_VOUCHED)], _is_vouched),
        _share("optimality: cost within 1 %", 0.95, solved, _is_optimal),
        _count("optimality: others with exit 0", "0",
               [r for r in solved if r not in optimal], _is_vouched),
        _count("crashes", "0", results, lambda r: r.measured.exit_code == CRASHED),
    ]  # fmt: skip


def require_none_bad(results: Sequence[Result]) -> None:
    """Raise `PlanfitError` where planfit broke its word: never worse, never silent."""
    bad = [f"{r.case.number} {r.case.name}: {words}" for r in results if (words := _broken(r))]
    if bad:
        raise PlanfitError(
            f"expected no broken word in {len(results)} cases, found {'; '.join(bad)}"
        )


def _broken(result: Result) -> str:
    """What is wrong with a result, in words; empty for nothing."""
    m = result.measured
    if m.exit_code == CRASHED:
        return f"crashed ({m.said})"
    if result.is_silent_wrong:
        return f"{m.error_m:.3f} m off with exit 0"
    if _is_vouched(result) and set(result.faults) & set(NEVER_VOUCHED):
        return "exit 0, though nothing of it can be right"
    if result.case.is_reference and not _is_vouched(result):
        return f"exit {m.exit_code} without a fault ({m.said})"
    is_mistaken = not m.convention and _is_accused(result)
    return "a convention is named that the poses are not in" if is_mistaken else ""


def _is_start(case: Case) -> bool:
    """Whether nothing but drift, up to three times the usual one, keeps the scan from its best place."""
    return all(part == Part("drift", 0) for part in case.parts)


def _is_vouched(result: Result) -> bool:
    return result.measured.exit_code == 0


def _is_torn(result: Result) -> bool:
    return not result.within(1.5)


def _is_accused(result: Result) -> bool:
    return result.measured.is_recognised is False


def _has_scale(result: Result) -> bool:
    """Whether a plan in metres of another scale was doubted, and the true scale named."""
    error = result.measured.scale_error
    return not _is_vouched(result) and error is not None and abs(error) <= 0.003


def _is_optimal(result: Result) -> bool:
    cost, best = result.measured.cost, result.measured.cost_from_truth
    return cost is not None and best is not None and cost <= 1.01 * best


def _of(results: Iterable[Result], fault: str) -> list[Result]:
    return [r for r in results if fault in r.faults]


def _count(
    name: str, asked: str, results: Sequence[Result], is_counted: Callable[[Result], bool]
) -> Figure:
    return Figure(name, asked, str(sum(is_counted(r) for r in results)), len(results))


def _share(
    name: str, asked: float, results: Sequence[Result], is_counted: Callable[[Result], bool]
) -> Figure:
    found = f"{np.mean([is_counted(r) for r in results]):.0%}" if results else ""
    return Figure(name, f">= {asked:.0%}", found, len(results))


def _worst(name: str, asked_m: float, results: Sequence[Result], fault: str, size: int) -> Figure:
    """Largest error; a refused or crashed case has no better."""
    chosen = [r for r in results if r.case.parts[0].fault == fault and r.case.parts[0].size == size]
    errors = [r.measured.error_m for r in chosen]
    known = [error for error in errors if error is not None]
    found = f"{max(known):.3f} m" if known else ""
    if len(known) < len(errors):
        found += f", {len(errors) - len(known)} without result"
    return Figure(name, f"<= {asked_m:g} m", found, len(chosen))


def _moved_named(results: Sequence[Result]) -> Figure:
    seen = sum(r.measured.moved_seen for r in results)
    named = sum(r.measured.moved_named for r in results)
    found = f"{named / seen:.0%} of {seen} walls" if seen else ""
    n = sum(r.measured.moved_seen > 0 for r in results)
    return Figure("moved walls named within 3 cm", ">= 90%", found, n)


@dataclass(frozen=True)
class FaultRow:
    """All cases of one fault, or two, in one size."""

    faults: str
    size: str
    n: int
    before_m: float | None
    """Median, as recorded."""
    faultless_m: float | None
    """Median, of the same scans and drifts."""
    median_m: float | None
    worst_m: float | None
    exit_codes: tuple[int, int, int, int]
    """How many ended with 0, 1, 2, and crashed."""


def fault_rows(results: Sequence[Result]) -> list[FaultRow]:
    """Fault by fault and size by size, single ones first, in the order of the battery's list."""
    order = {name: k for k, name in enumerate(FAULTS)}
    groups: dict[tuple, list[Result]] = {}
    for r in results:
        size = r.case.parts[0].size if r.case.parts else 0
        names = tuple(sorted(order[fault] for fault in r.faults))
        groups.setdefault((len(names), names, size), []).append(r)
    return [_row(groups[key]) for key in sorted(groups)]


def _row(group: Sequence[Result]) -> FaultRow:
    parts = group[0].case.parts
    sizes = [FAULTS[part.fault].sizes[part.size] for part in parts]
    codes = Counter(r.measured.exit_code for r in group)
    errors = [r.measured.error_m for r in group if r.measured.error_m is not None]
    return FaultRow(
        " + ".join(part.fault for part in parts) or "none",
        "; ".join(size for size in sizes if size),
        len(group),
        _median([r.measured.before_m for r in group]),
        _median([r.faultless_m for r in group]),
        _median(errors),
        max(errors) if errors else None,
        (codes[0], codes[1], codes[REFUSED], codes[CRASHED]),
    )


def _median(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None


PREDICTED_BINS_M = (0.0, 0.02, 0.05, 0.1, 0.2, 0.5, np.inf)


@dataclass(frozen=True)
class ReliabilityRow:
    """Results whose predicted error lies between two values."""

    low_m: float
    high_m: float
    n: int
    median_predicted_m: float
    median_error_m: float
    within: float
    """Mean share of frames whose error is within twice what was predicted."""


def reliability_rows(results: Sequence[Result]) -> list[ReliabilityRow]:
    """Predicted against true errors; empty where no error was predicted."""
    rows = []
    # Predicted and true error, and the share of frames within twice the predicted one.
    given = np.array(
        [
            (m.predicted_m, m.error_m, m.within_predicted)
            for m in (r.measured for r in results)
            if None not in (m.predicted_m, m.error_m, m.within_predicted)
        ],
        dtype=float,
    ).reshape(-1, 3)
    for low, high in pairwise(PREDICTED_BINS_M):
        inside = given[(given[:, 0] >= low) & (given[:, 0] < high)]
        if len(inside):
            predicted, error = np.median(inside[:, :2], axis=0)
            within = float(inside[:, 2].mean())
            rows.append(
                ReliabilityRow(low, high, len(inside), float(predicted), float(error), within)
            )
    return rows
