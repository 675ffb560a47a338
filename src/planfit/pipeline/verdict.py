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

from planfit.alignment import other_scale_finding
from planfit.findings import Finding, PlanKind, ResultKind
from planfit.pipeline.evidence import Evidence
from planfit.pipeline.reservations import ALONE_FACTOR, reservations_of
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
MIN_VISITS_ALONE = 3
"""Without a plan, the solve without one of fewer visits has next to nothing that closes loops: that it puts
what the visit saw where the tracker did says nothing of the result."""


NO_BETTER_ADVICE = (
    "use the recorded poses; check that it is the right plan, storey and unit, and see the report for where "
    "scan and plan part"
)


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
    because: tuple[Finding, ...]
    """Why it is no better, or what speaks for it."""
    reservations: tuple[Finding, ...]
    """Parts of the result that are not vouched for, and why."""
    predicted_error_m: Float[np.ndarray, " n"]
    """Of each camera position, one standard deviation of its length."""
    is_tracked: bool = True
    """Whether the recorded poses say anything of the images."""

    __repr__ = short_repr

    @property
    def has_rival(self) -> bool:
        """Whether the scan fits the plan elsewhere about as well."""
        kinds = {each.kind for each in (*self.because, *self.reservations)}
        return bool(kinds & {ResultKind.FITS_ELSEWHERE, PlanKind.ADJUSTED_FITS_ELSEWHERE})

    @property
    def is_refined(self) -> bool:
        """Whether the poses can be used as they are."""
        return self.outcome is Outcome.REFINED

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why it is no better, or what speaks for it: a sentence each."""
        return tuple(each.words for each in self.because)

    @property
    def further_reasons(self) -> tuple[str, ...]:
        """Those that the headline does not have."""
        return self.reasons if self.outcome is Outcome.IMPROVED else self.reasons[1:]

    @property
    def further_reservations(self) -> tuple[Finding, ...]:
        """Those that the headline does not have."""
        if self.outcome is Outcome.IMPROVED:
            return self.reservations[1:]
        return tuple(each for each in self.reservations if each.kind is not self.because[0].kind)

    @property
    def advice(self) -> str:
        """What to do next, for the whole."""
        if self.outcome is Outcome.NO_BETTER:
            return self.because[0].advice or NO_BETTER_ADVICE
        if self.outcome is Outcome.IMPROVED:
            first = self.reservations[0].advice
            return f"use the refined poses except for the frames named; then {first}"
        return "use the refined poses"

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
        options = replace(options, max_error_m=ALONE_FACTOR * options.max_error_m)
    against = _against(evidence, options)
    reservations = reservations_of(evidence, options)
    doubt, scale = evidence.tracking_doubt, evidence.other_scale
    if against and doubt is not None:
        outcome, because = Outcome.NO_BETTER, (doubt, *against)
    elif against and scale is not None:
        # A plan at a wrong scale explains all that follows from it.
        outcome, because = Outcome.NO_BETTER, (other_scale_finding(scale), *against)
    elif against:
        outcome, because = Outcome.NO_BETTER, against
    else:
        outcome = Outcome.IMPROVED if reservations else Outcome.REFINED
        because = _in_favour(evidence)
    return Verdict(
        outcome, because, reservations, evidence.predicted_error_m, is_tracked=doubt is None
    )


def is_apart(before_m: float, after_m: float) -> bool:
    """Whether places seen again came apart. A solve without a visit knows of it a little less well than poses
    that were right from the beginning."""
    return after_m > 1.1 * before_m + 0.02


def _in_favour(evidence: Evidence) -> tuple[Finding, ...]:
    """What was done, and what was kept out and agrees."""
    worst = evidence.worst_frame
    error = {"predicted_rms_m": evidence.predicted_rms_m}
    worst_m = float(evidence.predicted_error_m[worst])
    found = [
        Finding(ResultKind.CAMERAS_MOVED, {"moved_rms_m": evidence.correction_rms_m, **error}),
        Finding(ResultKind.ERROR_EXPECTED, {"worst_m": worst_m, **error}, ((worst, worst),)),
    ]
    if evidence.visit_distances_m:
        before, after = evidence.visit_distances_m
        found.append(Finding(ResultKind.REVISITS_AGREE, {"before_m": before, "after_m": after}))
    if evidence.near_shares:
        before, after = evidence.near_shares
        found.append(
            Finding(ResultKind.WALLS_ON_PLAN, {"before_share": before, "after_share": after})
        )
    return tuple(found)


def _against(evidence: Evidence, options: VerdictOptions) -> tuple[Finding, ...]:
    """Why the recorded poses are to be preferred."""
    if not evidence.is_measured:
        # What else there is to say compares the recorded poses with themselves.
        return (Finding(ResultKind.NOTHING_REFINED, {"has_plan": not evidence.is_alone}),)
    found = []
    if evidence.alignment is not None and evidence.alignment.doubt is not None:
        found.append(Finding(ResultKind.PLACE_NOT_CERTAIN, parts=(evidence.alignment.doubt,)))
    is_told = not evidence.is_alone or len(evidence.visits) >= MIN_VISITS_ALONE
    if evidence.visit_distances_m and is_told:
        before, after = evidence.visit_distances_m
        if is_apart(before, after):
            found.append(
                Finding(ResultKind.REVISITS_CAME_APART, {"before_m": before, "after_m": after})
            )
    if evidence.near_shares:
        before, after = evidence.near_shares
        if after < before - 0.05:
            shares = {"before_share": before, "after_share": after}
            found.append(Finding(ResultKind.WALLS_LEFT_PLAN, shares))
    moved, error = evidence.correction_rms_m, evidence.predicted_rms_m
    share = WORTH_SHARE_ALONE if evidence.is_alone else WORTH_SHARE
    rival = evidence.rival_error_m
    is_worthless = np.sqrt(max(error**2 - rival**2, 0.0)) > share * moved
    if error > options.max_error_m and (is_worthless or rival > WORTH_SHARE_OF_RIVALS * moved):
        facts = {"predicted_rms_m": error, "moved_rms_m": moved}
        found.append(Finding(ResultKind.ERROR_TOO_LARGE, facts))
    return tuple(found)
