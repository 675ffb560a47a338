"""The verdict: what the evidence says of a result, in plain words.

Three outcomes. *Refined*: use the poses. *Improved, with reservations*: better than recorded, but some
frames may be off by more than the rest, and it is said which and what to do. *No better*: use the recorded
poses.

The thresholds were chosen on ConSLAM and synthetic scans spoiled in known ways, with even seeds.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from jaxtyping import Float

from planfit.alignment import other_scale_finding
from planfit.findings import Finding, PlanKind, ResultKind
from planfit.pipeline.evidence import Evidence
from planfit.pipeline.reservations import is_vouched, reservations_of
from planfit.runtime import short_repr

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
    tolerance_m: float
    """Position error that is good enough, as it was asked for."""
    share_within: float
    """Share of the frames that are expected to be off by no more than that."""
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


def judge(evidence: Evidence, tolerance_m: float) -> Verdict:
    """Weigh the evidence, for a user to whom a position error of `tolerance_m` is good enough."""
    against = _against(evidence, tolerance_m)
    reservations = reservations_of(evidence, tolerance_m)
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
        because = _in_favour(evidence, tolerance_m)
    return Verdict(
        outcome,
        because,
        reservations,
        evidence.predicted_error_m,
        tolerance_m,
        evidence.share_within(tolerance_m),
        is_tracked=doubt is None,
    )


def is_apart(before_m: float, after_m: float) -> bool:
    """Whether places seen again came apart. A solve without a visit knows of it a little less well than poses
    that were right from the beginning."""
    return after_m > 1.1 * before_m + 0.02


def _in_favour(evidence: Evidence, tolerance_m: float) -> tuple[Finding, ...]:
    """What was done, and what was kept out and agrees."""
    worst = evidence.worst_frame
    error = {"predicted_rms_m": evidence.predicted_rms_m}
    worst_m = float(evidence.predicted_error_m[worst])
    within = {"within_share": evidence.share_within(tolerance_m), "tolerance_m": tolerance_m}
    found = [
        Finding(ResultKind.CAMERAS_MOVED, {"moved_rms_m": evidence.correction_rms_m, **error}),
        Finding(
            ResultKind.ERROR_EXPECTED, {"worst_m": worst_m, **error, **within}, ((worst, worst),)
        ),
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


def _against(evidence: Evidence, tolerance_m: float) -> tuple[Finding, ...]:
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
    # Right poses lie about as far from the recorded ones as these were moved, and from the refined ones as is
    # predicted.
    if error > moved and not is_vouched(evidence, tolerance_m):
        facts = {"predicted_rms_m": error, "moved_rms_m": moved}
        found.append(Finding(ResultKind.ERROR_TOO_LARGE, facts))
    return tuple(found)
