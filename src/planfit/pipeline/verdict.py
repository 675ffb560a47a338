"""The verdict: what the evidence says of a result, in plain words.

Three outcomes. *Refined*: use the poses. *Improved, with reservations*: better than recorded, but some
frames may be off by more than the rest, and it is said which and what to do. *No better*: use the recorded
poses.

The thresholds were chosen on ConSLAM and synthetic scans spoiled in known ways, with even seeds.
"""

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from jaxtyping import Float

from planfit.alignment import OTHER_SCALE_ADVICE, other_scale_words
from planfit.pipeline.evidence import Evidence
from planfit.pipeline.reservations import Reservation, reservations_of
from planfit.pipeline.verdict_options import VerdictOptions
from planfit.runtime import short_repr

WORTH_SHARE = 0.35
"""A correction is no improvement when the predicted error is more than this share of it."""
WORTH_SHARE_OF_RIVALS = 0.7
"""The same of what other optima have in the predicted error: a scan that fits its plan in two places is
mostly better in either than where it was recorded."""
WORTH_SHARE_ALONE = 1.0
"""The same without a plan: no wrong place is to be feared there, and what least squares corrects is not
correlated with what is left."""
ALONE_FACTOR = 1.5
"""Predicted errors may be this many times as large where nothing fixed holds the whole (no plan): errors grow
along the walk there, and the result is judged by whether the scan agrees with itself."""
MIN_VISITS_ALONE = 3
"""Without a plan, the solve without one of fewer visits has next to nothing that closes loops: that it puts
what the visit saw where the tracker did says nothing of the result."""


class Outcome(StrEnum):
    """What is to be done with a result."""

    REFINED = "refined"
    """Use the refined poses."""
    IMPROVED = "improved"
    """Use them but where the reservations say."""
    NO_BETTER = "no better"
    """Use the recorded poses."""


@dataclass(frozen=True)
class Verdict:
    """What the evidence says of a result."""

    outcome: Outcome
    reasons: tuple[str, ...]
    """Why it is no better, or what speaks for it: a sentence each."""
    reservations: tuple[Reservation, ...]
    advice: str
    """What to do next, for the whole."""
    predicted_error_m: Float[np.ndarray, " n"]
    """Of each camera position, one standard deviation of its length."""
    is_tracked: bool = True
    """Whether the recorded poses say anything of the images."""

    __repr__ = short_repr

    @property
    def is_refined(self) -> bool:
        """Whether the poses can be used as they are."""
        return self.outcome is Outcome.REFINED

    @property
    def headline(self) -> str:
        """The outcome and its main reason, on one line."""
        if self.outcome is Outcome.NO_BETTER and not self.is_tracked:
            why = self.reasons[0]
            return f"{self.outcome.value}: neither recorded nor refined poses can be used, as {why}"
        if self.outcome is Outcome.NO_BETTER:
            return f"{self.outcome.value}: use the recorded poses, as {self.reasons[0]}"
        if self.outcome is Outcome.IMPROVED:
            first = self.reservations[0]
            return f"improved, with reservations: {first.words}; {first.advice}"
        return f"{self.outcome.value}: {self.reasons[0]}"


def judge(evidence: Evidence, options: VerdictOptions) -> Verdict:
    """Weigh the evidence."""
    if evidence.is_alone:
        options = replace(
            options,
            max_error_m=ALONE_FACTOR * options.max_error_m,
            max_stretch_error_m=ALONE_FACTOR * options.max_stretch_error_m,
        )
    against = _against(evidence, options)
    reservations = reservations_of(evidence, options)
    doubt = evidence.tracking_doubt
    if against and doubt is not None:
        outcome, reasons, advice = Outcome.NO_BETTER, (doubt.what, *against), doubt.advice
    elif against and evidence.other_scale is not None:
        # A plan at a wrong scale explains all that follows from it.
        outcome, reasons = Outcome.NO_BETTER, (other_scale_words(evidence.other_scale), *against)
        advice = OTHER_SCALE_ADVICE
    elif against:
        outcome, reasons = Outcome.NO_BETTER, against
        advice = (
            "use the recorded poses; check that it is the right plan, storey and unit, and see the report "
            "for where scan and plan part"
        )
    elif reservations:
        outcome, reasons = Outcome.IMPROVED, _in_favour(evidence)
        advice = "use the refined poses except for the frames named; then " + reservations[0].advice
    else:
        outcome, reasons = Outcome.REFINED, _in_favour(evidence)
        advice = "use the refined poses"
    return Verdict(
        outcome, reasons, reservations, advice, evidence.predicted_error_m, is_tracked=doubt is None
    )


def is_apart(before_m: float, after_m: float) -> bool:
    """Whether places seen again came apart. A solve without a visit knows of it a little less well than poses
    that were right from the beginning."""
    return after_m > 1.1 * before_m + 0.02


def _in_favour(evidence: Evidence) -> tuple[str, ...]:
    """What was done, and what was kept out and agrees."""
    moved, error = evidence.correction_rms_m, evidence.predicted_rms_m
    reasons = [
        f"cameras were moved by {moved:.2f} m and are predicted to be within about {error:.2f} m (both RMS)",
        evidence.predicted_words,
    ]
    if evidence.visit_distances_m:
        before, after = evidence.visit_distances_m
        reasons.append(
            f"places seen again agree to {after:.3f} m in solves that did without them "
            f"({before:.3f} m before)"
        )
    if evidence.near_shares:
        before, after = evidence.near_shares
        reasons.append(
            f"{after:.0%} of the wall patches lie on the plan in solves that did without them ({before:.0%} "
            "before)"
        )
    return tuple(reasons)


def _against(evidence: Evidence, options: VerdictOptions) -> tuple[str, ...]:
    """Why the recorded poses are to be preferred."""
    reasons = []
    if evidence.alignment is not None and evidence.alignment.doubt:
        reasons.append(f"the place on the plan is not certain: {evidence.alignment.doubt}")
    is_told = not evidence.is_alone or len(evidence.visits) >= MIN_VISITS_ALONE
    if evidence.visit_distances_m and is_told:
        before, after = evidence.visit_distances_m
        if is_apart(before, after):
            reasons.append(
                f"places seen again came apart, from {before:.3f} to {after:.3f} m, in solves that did "
                "without them"
            )
    if evidence.near_shares:
        before, after = evidence.near_shares
        if after < before - 0.05:
            reasons.append(
                f"walls left the plan, from {before:.0%} to {after:.0%} on it, in solves that did without "
                "them"
            )
    moved, error = evidence.correction_rms_m, evidence.predicted_rms_m
    share = WORTH_SHARE_ALONE if evidence.is_alone else WORTH_SHARE
    rival = evidence.rival_error_m
    is_worthless = np.sqrt(max(error**2 - rival**2, 0.0)) > share * moved
    if error > options.max_error_m and (is_worthless or rival > WORTH_SHARE_OF_RIVALS * moved):
        reasons.append(
            f"the predicted error, {error:.2f} m, is too large a part of what was corrected, {moved:.2f} m"
        )
    return tuple(reasons)
