"""The numbers that matter, before and after, and the verdict in words."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from planfit.evaluation import NEAR_FACE_M
from planfit.pipeline.result import RefineResult
from planfit.pipeline.validation import Check
from planfit.pipeline.verdict import Verdict
from planfit.report import formatting
from planfit.report.measures import BeforeAfter
from planfit.units import in_units


@dataclass(frozen=True)
class TruthErrors:
    """Errors of camera positions against true ones, root mean square, where the truth is known."""

    before_rms_m: float
    """Of the recorded poses, in the truth's frame."""
    after_rms_m: float
    """Of the refined poses, in the truth's frame."""
    before_aligned_rms_m: float
    """Of the recorded poses, after the rigid motion that fits best."""
    after_aligned_rms_m: float
    """Of the refined poses, after the rigid motion that fits best."""
    after_by_frame_m: Float[np.ndarray, " n"] | None = None
    """Of each refined pose, in the truth's frame."""


@dataclass(frozen=True)
class KeyMetric:
    """One number before and after."""

    name: str
    meaning: str
    """What it says, in plain words."""
    before: float
    after: float
    unit: str
    """m, or share."""
    is_worse: bool = False

    @property
    def is_improved(self) -> bool:
        """Better by more than a hundredth: of the number, or of all points where it is a share."""
        if self.unit == "share":
            return self.after > self.before + 0.01
        return self.after < 0.99 * self.before


_CHECKS = {
    "m": (
        "Places seen twice",
        "median distance between two sightings of one point, visit by visit, each by a solve that did "
        "without that visit",
    ),
    "share": (
        "Wall points on the plan",
        "share of scanned wall points within {near} of a drawn wall",
    ),
}


def key_metrics(
    result: RefineResult, both: BeforeAfter, truth: TruthErrors | None
) -> list[KeyMetric]:
    """All that could be measured, the checks first."""
    metrics = [
        KeyMetric(*_words(check), check.before, check.after, check.unit, check.is_worse)
        for check in result.checks
    ]

    def add(name: str, meaning: str, first: float, last: float) -> None:
        metrics.append(KeyMetric(name, meaning, first, last, "m", last > 1.02 * first + 1e-4))

    before, after = both.before, both.after
    if both.is_aligned and before.walls is not None and after.walls is not None:
        meaning = "mean distance of scanned wall points to the nearest drawn wall"
        add("Distance to the plan (NSD)", meaning, before.walls.nsd_m, after.walls.nsd_m)
    if before.floor is not None and after.floor is not None:
        first, last = before.floor, after.floor
        meaning = "lie within this of their median height"
        add("Floor, half of the points", meaning, first.height_median_m, last.height_median_m)
        meaning = "RMS height about their mean; counts things that lie on the floor too"
        add("Floor, all points", meaning, first.height_rms_m, last.height_rms_m)
    if truth:
        meaning = "RMS distance of camera positions to the true ones"
        add("Position error", meaning, truth.before_rms_m, truth.after_rms_m)
        meaning = "the same after the best rigid fit to the true positions"
        aligned_m = truth.before_aligned_rms_m, truth.after_aligned_rms_m
        add("Position error, shape only", meaning, *aligned_m)
    return metrics


def told_first(verdict: Verdict) -> str:
    """The outcome and its main reason, as a sentence."""
    return f"{verdict.headline[0].upper()}{verdict.headline[1:]}."


def reasons_in_words(verdict: Verdict, truth: TruthErrors | None = None) -> str:
    """What else speaks for the outcome, in plain words; the metrics say what became better or worse."""
    words = " ".join(f"{each[0].upper()}{each[1:]}." for each in verdict.further_reasons)
    if truth:
        before, after = (formatting.length(v) for v in (truth.before_rms_m, truth.after_rms_m))
        words += f" Against the true positions, the error went from {before} to {after} RMS."
    return words.strip()


def _words(check: Check) -> tuple[str, str]:
    name, meaning = _CHECKS.get(check.unit, (check.name, ""))
    return name, meaning.format(near=in_units(NEAR_FACE_M))
