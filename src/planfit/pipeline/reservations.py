"""Reservations: which part of a result the evidence does not bear, and why."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np

from planfit.alignment import other_scale_finding
from planfit.findings import Finding, ResultKind
from planfit.pipeline.evidence import CONTRADICTED_M, Evidence

VOUCHED_SHARE = 0.95
"""Share of the frames that must be expected to lie within the tolerance: what surveyors promise."""
LIKELIER_WITHIN = 0.5
"""Of a vouched result, a stretch of the walk that is likelier to lie beyond the tolerance is named."""
OF_FRAMES_ALONE = {"floor", "ceiling", "odometry"}
"""Terms that bring no two frames together but by the recorded motion."""
HELD_BY_WALLS_SHARE = 0.5
"""Of the wall patches, kept out of the solve, that must lie on the plan where walls are all that holds the
recorded motion. Flats walked without matches, chosen on ten of even number: seven had less, six of them were
0.29 to 0.99 m off; of seven among ten others six were 0.25 to 0.98 m off."""
CONTRADICTED_SHARE = 0.25
"""More contradicted visits than this share of them are no accident."""
MAX_STRAIN = 1.25
"""Misfit of a term with the walls over that without, at least three a frame. Right plans: 1.00 to 1.07."""


def is_vouched(evidence: Evidence, tolerance_m: float) -> bool:
    """Whether so many frames are expected to lie within a tolerance that the result can be used."""
    return evidence.share_within(tolerance_m) >= VOUCHED_SHARE


def reservations_of(evidence: Evidence, tolerance_m: float) -> tuple[Finding, ...]:
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
    within, enough = evidence.probability_within(tolerance_m), is_vouched(evidence, tolerance_m)
    least = LIKELIER_WITHIN if enough else VOUCHED_SHARE

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
    for run in _runs(is_unsure):
        stretches = [evidence.stretches[k] for k in run]
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
    is_tied = bool(evidence.visits) or not set(evidence.scan_costs) <= OF_FRAMES_ALONE
    if near is None or is_tied or near[1] >= HELD_BY_WALLS_SHARE:
        return []
    return [Finding(ResultKind.WALLS_ALONE, {"near_share": near[1]}, _all_frames(evidence))]


def _of_contradicted_visits(evidence: Evidence) -> list[Finding]:
    bad = [visit for visit in evidence.visits if visit.after_m > CONTRADICTED_M]
    if len(bad) <= CONTRADICTED_SHARE * len(evidence.visits):
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
        if after > MAX_STRAIN * before
    ]


def _runs(holds: Sequence[bool]) -> list[list[int]]:
    """Runs of neighbours for which something holds."""
    groups = groupby(range(len(holds)), key=lambda k: holds[k])
    return [list(run) for held, run in groups if held]
