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
from planfit.pipeline.evidence import CONTRADICTED_M, Evidence
from planfit.pipeline.on_plan import frame_runs
from planfit.runtime import short_repr

MIN_VISITS_ALONE = 3
"""Without a plan, the solve without one of fewer visits has next to nothing that closes loops: that it puts
what the visit saw where the tracker did says nothing of the result."""

NO_BETTER_ADVICE = (
    "use the recorded poses; check that it is the right plan, storey and unit, and see the report for where "
    "scan and plan part"
)
_VOUCHED_SHARE = 0.95
"""Share of the frames that must be expected to lie within the tolerance: what surveyors promise."""
_OF_FRAMES_ALONE = {"floor", "ceiling", "odometry"}
"""Terms that bring no two frames together but by the recorded motion."""
_HELD_BY_WALLS_SHARE = 0.5
"""Of the wall patches, kept out of the solve, that must lie on the plan where walls are all that holds the
recorded motion. Flats walked without matches, chosen on ten of even number: seven had less, six of them were
0.29 to 0.99 m off; of seven among ten others six were 0.25 to 0.98 m off."""
_CONTRADICTED_SHARE = 0.25
"""More contradicted visits than this share of them are no accident."""
_MAX_STRAIN = 1.25
"""Misfit of a term with the walls over that without, at least three a frame. Right plans: 1.00 to 1.07."""


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
        told = (*self.because, *self.reservations)
        kinds = {one.kind for each in told for one in (each, *each.parts)}
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
            if self.because[0].kind is ResultKind.PLACE_OF_SEVERAL:
                return f"{self.outcome.value}: {self.because[0].sentence}"
            return f"{self.outcome.value}: use the recorded poses, as {self.reasons[0]}"
        if self.outcome is Outcome.IMPROVED:
            first = self.reservations[0]
            return f"improved, with reservations: {first.words}; {first.advice}"
        return f"{self.outcome.value}: {self.reasons[0]}"


def judge(evidence: Evidence, tolerance_m: float) -> Verdict:
    """Weigh the evidence, for a user to whom a position error of `tolerance_m` is good enough."""
    against = _against(evidence, tolerance_m)
    reservations = _reservations_of(evidence, tolerance_m)
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
    aligned = evidence.alignment
    if aligned is not None and aligned.doubt is not None:
        kind = ResultKind.PLACE_OF_SEVERAL if aligned.is_tie else ResultKind.PLACE_NOT_CERTAIN
        found.append(Finding(kind, parts=(aligned.doubt,)))
    is_told = not evidence.is_alone or len(evidence.visits) >= MIN_VISITS_ALONE
    if evidence.visit_distances_m and is_told:
        before, after = evidence.visit_distances_m
        if is_apart(before, after):
            found.append(
                Finding(ResultKind.REVISITS_CAME_APART, {"before_m": before, "after_m": after})
            )
    moved, error = evidence.correction_rms_m, evidence.predicted_rms_m
    # Right poses lie about as far from the recorded ones as these were moved, and from the refined ones as is
    # predicted.
    if error > moved and not _is_vouched(evidence, tolerance_m):
        facts = {"predicted_rms_m": error, "moved_rms_m": moved}
        found.append(Finding(ResultKind.ERROR_TOO_LARGE, facts))
    return tuple(found)


def _is_vouched(evidence: Evidence, tolerance_m: float) -> bool:
    """Whether so many frames are expected to lie within a tolerance that the result can be used."""
    return evidence.share_within(tolerance_m) >= _VOUCHED_SHARE


def _reservations_of(evidence: Evidence, tolerance_m: float) -> tuple[Finding, ...]:
    """All reservations about a result, the gravest kinds first."""
    if not evidence.is_measured:  # of the whole it is said that nothing was refined
        return tuple(_of_doubted_tracking(evidence))
    found = [
        *_of_doubted_tracking(evidence),
        *_of_broken_path(evidence),
        *_of_other_scale(evidence),
        *_of_unsure_places(evidence, tolerance_m),
        *_of_walls_alone(evidence),
        *_of_contradicted_visits(evidence),
        *_of_strained_terms(evidence),
    ]
    found += [
        Finding(ResultKind.FRAMES_OFF_PLANS, {"storey": storey.name}, storey.frames)
        for storey in evidence.without_plan
    ]
    if not evidence.is_placed:
        found.append(Finding(ResultKind.NOT_PLACED, frames=_all_frames(evidence)))
    return tuple(found)


def _all_frames(evidence: Evidence) -> tuple[tuple[int, int]]:
    """One run."""
    return ((evidence.stretches[0].frames[0], evidence.stretches[-1].frames[1]),)


def _of_doubted_tracking(evidence: Evidence) -> list[Finding]:
    doubt = evidence.tracking_doubt
    return [] if doubt is None else [replace(doubt, frames=_all_frames(evidence))]


def _of_broken_path(evidence: Evidence) -> list[Finding]:
    """Frames without a place, torn steps and leaps."""
    found = []
    if evidence.unplaced:
        found.append(Finding(ResultKind.FRAMES_WITHOUT_PLACE, frames=evidence.unplaced))
    if evidence.torn:
        worst = max(evidence.torn, key=lambda step: step.departure_m)
        facts = {"departure_m": worst.departure_m, "departure_deg": worst.departure_deg}
        found.append(
            Finding(ResultKind.PATH_TORN, facts, tuple(step.frames for step in evidence.torn))
        )
    if evidence.leaps:
        found.append(Finding(ResultKind.WALK_LEAPS, frames=evidence.leaps))
    return found


def _of_other_scale(evidence: Evidence) -> list[Finding]:
    """A plan in metres that was taken as drawn and would fit clearly better at another scale."""
    if evidence.other_scale is None:
        return []
    return [replace(other_scale_finding(evidence.other_scale), frames=_all_frames(evidence))]


def _of_unsure_places(evidence: Evidence, tolerance_m: float) -> list[Finding]:
    """Stretches of the walk that may lie beyond the tolerance; of the whole, whether in another optimum."""
    within, enough = evidence.probability_within(tolerance_m), _is_vouched(evidence, tolerance_m)
    # Of a vouched result, a stretch of the walk that is likelier to lie beyond the tolerance is named.
    least = 0.5 if enough else _VOUCHED_SHARE

    def share_of(first: int, last: int) -> float:
        return float(within[first : last + 1].mean())

    is_unsure = [share_of(*stretch.frames) < least for stretch in evidence.stretches]
    rival_m, error_m = evidence.rival_error_m, evidence.predicted_rms_m
    if not enough and 2 * rival_m**2 > error_m**2:  # most of what is not known is which optimum
        return [_of_rivals(evidence)]
    if all(is_unsure):
        facts = {"predicted_rms_m": error_m, "within_share": evidence.share_within(tolerance_m)}
        facts |= {"tolerance_m": tolerance_m}
        return [Finding(ResultKind.ALL_MAY_BE_OFF, facts, _all_frames(evidence))]
    found = []
    for run in frame_runs(np.array(is_unsure)):
        stretches = evidence.stretches[run[0] : run[1] + 1]
        frames = stretches[0].frames[0], stretches[-1].frames[1]
        worst = max(stretches, key=lambda s: s.predicted_m)
        facts = {"predicted_m": worst.predicted_m, "direction": worst.open_direction}
        facts |= {"within_share": share_of(*frames), "tolerance_m": tolerance_m}
        found.append(Finding(ResultKind.FRAMES_NOT_FIXED, facts, (frames,)))
    return found


def _of_rivals(evidence: Evidence) -> Finding:
    """The scan fits the plan in another way about as well, depending on which walls were moved."""
    walls = evidence.moved_walls
    return Finding(
        ResultKind.FITS_ELSEWHERE,
        {"rival_rms_m": evidence.rival_error_m},
        _all_frames(evidence),
        faces=tuple(face for wall in walls for face in wall.faces),
        parts=walls,
    )


def _of_walls_alone(evidence: Evidence) -> list[Finding]:
    """Walls that hold the recorded motion alone, and do not confirm themselves."""
    near = evidence.near_shares
    is_tied = bool(evidence.visits) or not set(evidence.scan_costs) <= _OF_FRAMES_ALONE
    if near is None or is_tied or near[1] >= _HELD_BY_WALLS_SHARE:
        return []
    return [Finding(ResultKind.WALLS_ALONE, {"near_share": near[1]}, _all_frames(evidence))]


def _of_contradicted_visits(evidence: Evidence) -> list[Finding]:
    bad = [visit for visit in evidence.visits if visit.after_m > CONTRADICTED_M]
    if len(bad) <= _CONTRADICTED_SHARE * len(evidence.visits):
        return []
    frames = tuple(dict.fromkeys(f for v in bad for f in (v.first_frames, v.last_frames)))
    facts = {"revisit_count": len(evidence.visits), "contradicted_count": len(bad)}
    facts |= {"distance_m": float(np.median([visit.after_m for visit in bad]))}
    return [Finding(ResultKind.REVISITS_CONTRADICT_RESULT, facts, frames)]


def _of_strained_terms(evidence: Evidence) -> list[Finding]:
    """Terms that the walls of the plan made worse than correcting drift explains."""
    return [
        Finding(
            ResultKind.PLAN_STRAINS_TERM,
            {"term": name, "misfit_ratio": after / before},
            _all_frames(evidence),
        )
        for name, (before, after) in evidence.scan_costs.items()
        if after > _MAX_STRAIN * before
    ]
