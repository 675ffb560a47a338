"""What is wrong with a row, and what got worse since the rows that were kept."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from textwrap import shorten

import numpy as np
from faults.measure import CRASHED, REFUSED

from buildings.judging import FALSE, MISSED
from buildings.rows import RIGHT, SILENT, Row

TOLERANCE_M = 0.15
"""Error up to which exit 0 may be said: what users are told that it means, by default."""
GOOD_M = 0.08
"""A result as near as this should be vouched for."""
MAX_SIGMAS = 2.5
"""RMS error over the predicted RMS: beyond it, the prediction was no prediction."""
LEAST_M = 0.02
"""What an error may be beyond any prediction: truth itself is no better."""
LEAST_METRE = 0.002
"""What a metre may be off, as a share, beyond any prediction."""
WORSE_HEIGHT_M = 0.02
"""Heights may be worse than recorded by this."""
STEADY_SHARE = 0.95
"""Of the frames that stay within twice their predicted error where a little is left out."""
SHOWN = 120
"""Characters of a sentence that are shown."""
WORSE_TIMES, WORSE_M = 1.3, 0.01
"""An error that grew by both is a regression."""


@dataclass(frozen=True)
class Failure:
    """One thing that is wrong with a row."""

    kind: str
    """The same in two runs where the same thing is wrong, whatever its numbers."""
    words: str


def failures_of(row: Row) -> list[Failure]:
    """What is wrong with a row; nothing where all is as it should be."""
    if row.exit_code == CRASHED:
        return [Failure("crashed", f"crashed: {shorten(row.said, SHOWN)}")]
    if row.reading:
        return _of_reading(row)
    if row.exit_code == REFUSED or row.error_m is None or row.before_m is None:
        return [Failure("refused", f"refused: {shorten(row.said, SHOWN)}")]
    return [*_of_errors(row, row.error_m, row.before_m), *_of_claims(row), *_of_steadiness(row)]


def _of_errors(row: Row, error_m: float, before_m: float) -> Iterator[Failure]:
    is_vouched, sigmas = row.exit_code == 0, row.sigmas or 0.0
    is_misjudged = sigmas > MAX_SIGMAS and error_m > LEAST_M
    words = f"{error_m:.3f} m, {sigmas:.1f} sigmas"
    if is_vouched and (error_m > TOLERANCE_M or is_misjudged):
        yield Failure(SILENT, f"{SILENT}: {words}")
    elif is_misjudged:
        yield Failure("predicted too small", f"predicted too small: {words}")
    if not is_vouched and error_m <= GOOD_M and error_m < before_m:
        yield Failure("right, refused", f"right, and not vouched for: {words}")
    if error_m > before_m and not row.said.startswith("no better"):
        yield Failure("made worse", f"made worse: {before_m:.3f} -> {error_m:.3f} m")
    before, now = row.height_before_m or 0.0, row.height_m or 0.0
    if now > before + WORSE_HEIGHT_M:
        yield Failure("heights worse", f"heights made worse: {before:.3f} -> {now:.3f} m")


def _of_claims(row: Row) -> Iterator[Failure]:
    """Corrections that are false or missed; of a plan without unit, a metre that is off by more than said."""
    for kind, (said, _, verdict) in row.corrections.items():
        if verdict in (FALSE, MISSED):
            yield Failure(f"{verdict} {kind}", f"{verdict}: {kind} {_short(said)}".rstrip())
    if not row.is_metric and row.scale_error is not None:
        off, sigma = abs(row.scale_error), row.scale_sigma or 0.0
        if off > max(MAX_SIGMAS * sigma, LEAST_METRE):
            yield Failure("metre", f"metre {off:.1%} off, said within {sigma:.1%}")


def _of_steadiness(row: Row) -> Iterator[Failure]:
    for words in row.flipped:
        yield Failure(f"flipped {words.partition(':')[0]}", f"flipped: {words}")
    if row.moved_within is not None and row.moved_within < STEADY_SHARE:
        share = f"{1 - row.moved_within:.0%}"
        yield Failure("unsteady", f"unsteady: {share} of frames moved beyond their prediction")


def _of_reading(row: Row) -> list[Failure]:
    if row.reading == RIGHT:
        return []
    wrong = [
        f"{what}: {found}, not {right}"
        for what, right, found, is_right in row.facts
        if not is_right
    ]
    return [Failure(row.reading, f"{row.reading}: {'; '.join(wrong) or shorten(row.said, SHOWN)}")]


@dataclass(frozen=True)
class Comparison:
    """Rows beside those that were kept."""

    worse: tuple[str, ...]
    """A line each, the worst first."""
    better: tuple[str, ...]
    new: tuple[str, ...]
    """Names of rows that were not there."""


def compare(kept: Sequence[Row], now: Sequence[Row]) -> Comparison:
    """Regressions and progress by name; rows that were not measured now are left as they are."""
    before = {row.name: row for row in kept}
    worse, better, new = [], [], []
    for row in now:
        if row.name not in before:
            new.append(row.name)
            continue
        lost, won, weight = _differences(before[row.name], row)
        if lost:
            worse.append((weight, f"{row.name}: {'; '.join(lost)}"))
        if won:
            better.append(f"{row.name}: {'; '.join(won)}")
    ordered = sorted(worse, key=lambda each: -each[0])
    return Comparison(tuple(words for _, words in ordered), tuple(better), tuple(new))


def _differences(before: Row, now: Row) -> tuple[list[str], list[str], float]:
    """What got worse, what better, and how bad it is: silence first, then by how much."""
    had, has = ({each.kind: each.words for each in failures_of(row)} for row in (before, now))
    lost = [words for kind, words in has.items() if kind not in had]
    won = [f"no longer {words}" for kind, words in had.items() if kind not in has]
    weight = sum(10.0 if kind in ("crashed", SILENT) else 1.0 for kind in has if kind not in had)
    if before.error_m is not None and now.error_m is not None:
        change, told = now.error_m - before.error_m, f"{before.error_m:.3f} -> {now.error_m:.3f} m"
        if change > WORSE_M and now.error_m > WORSE_TIMES * before.error_m:
            lost.append(told)
            weight += change
        if change < -WORSE_M and before.error_m > WORSE_TIMES * now.error_m:
            won.append(told)
    return lost, won, weight


def median(values: Iterable[float | None]) -> float | None:
    """Of those that there are; None of none."""
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None


def _short(said: object) -> str:
    if isinstance(said, list):
        return ", ".join(_short(each) for each in said[:3])
    return f"{said:.4g}" if isinstance(said, float) else str(said)
