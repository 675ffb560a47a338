"""Reservations: which part of a result the evidence does not bear, why, and what to do about it."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from planfit.adjust.observability import frame_ranges
from planfit.alignment import OTHER_SCALE_ADVICE, other_scale_words
from planfit.pipeline.evidence import CONTRADICTED_M, Evidence, Stretch
from planfit.pipeline.verdict_options import VerdictOptions

WITNESSED_SHARE = 0.25
"""A stretch is confirmed by the plan where at least this share of its wall patches lies on it."""
UNEXPLAINED_SHARE = 0.2
"""A run of stretches is unexplained whose wall lies on the plan less than this times as often as
elsewhere."""
UNEXPLAINED_PATCHES = 8
"""So many wall patches at least tell that."""
NOWHERE_SHARE = 0.5
"""Between confirmed stretches, walls are missed where less than this times as much is on the plan or
beside."""
ELSEWHERE_SHARE = 0.5
"""Where even elsewhere less of the wall lies on the plan, the plan says little of where a stretch is."""
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
RIVAL_SHARE = 1.0
"""Other optima are named from this share of the predicted error that is allowed on."""
MAX_NAMED_WALLS = 3
"""Walls that a sentence names."""


@dataclass(frozen=True)
class Reservation:
    """Frames that are less sure than the rest, why, and what to do."""

    frames: tuple[tuple[int, int], ...]
    """Runs of frames, first and last as numbered in the scan."""
    words: str
    """A sentence without its full stop, the frames named in it."""
    advice: str
    """What to do."""
    walls: tuple[str, ...] = ()
    """Walls of the plan that it hangs on: where they are drawn, how far they stand off, which way."""


def reservations_of(evidence: Evidence, options: VerdictOptions) -> tuple[Reservation, ...]:
    """All reservations about a result, the gravest kinds first."""
    found = [
        *_of_doubted_tracking(evidence),
        *_of_unplaced_frames(evidence),
        *_of_torn_steps(evidence),
        *_of_leaps(evidence),
        *_of_other_scale(evidence),
        *_of_rivals(evidence, options),
        *_of_unsure_stretches(evidence, options),
        *_of_unexplained_stretches(evidence),
        *_of_walls_alone(evidence),
        *_of_contradicted_visits(evidence),
        *_of_strained_terms(evidence),
        *_of_storeys_without_plan(evidence),
    ]
    stretches, error = evidence.stretches, evidence.predicted_rms_m
    everything = (stretches[0].frames[0], stretches[-1].frames[1])
    if not evidence.is_placed:
        found.append(
            Reservation(
                (everything,),
                "the scan is not placed on the plan: no wall was seen, and its poses only agree with each "
                "other",
                "give wall masks, or scan more of the walls",
            )
        )
    if error > options.max_error_m and not found:
        found.append(
            Reservation(
                (everything,),
                f"all frames may be off by {error:.2f} m (RMS): solves without a part of the evidence differ "
                "by that much",
                "scan again so that the walk comes back to places seen before",
            )
        )
    return tuple(found)


def _of_doubted_tracking(evidence: Evidence) -> list[Reservation]:
    doubt = evidence.tracking_doubt
    if doubt is None:
        return []
    everything = (evidence.stretches[0].frames[0], evidence.stretches[-1].frames[1])
    return [Reservation((everything,), doubt.what, doubt.advice)]


def _of_unplaced_frames(evidence: Evidence) -> list[Reservation]:
    if not evidence.unplaced:
        return []
    return [
        Reservation(
            evidence.unplaced,
            f"frames {frame_ranges(evidence.unplaced)} have no place: tracking was lost there, neighbouring "
            "images do not match, and no place of theirs is surely seen again",
            "leave these frames out, or scan that part again",
        )
    ]


def _of_torn_steps(evidence: Evidence) -> list[Reservation]:
    if not evidence.torn:
        return []
    frames = tuple(step.frames for step in evidence.torn)
    worst = max(evidence.torn, key=lambda step: step.departure_m)
    return [
        Reservation(
            frames,
            f"the path is torn at frames {frame_ranges(frames)}: the result departs from the recorded motion "
            f"by up to {worst.departure_m:.1f} m and {worst.departure_deg:.0f} deg in one step",
            "look at those frames: either the tracker jumped there, or places were confused",
        )
    ]


def _of_leaps(evidence: Evidence) -> list[Reservation]:
    if not evidence.leaps:
        return []
    return [
        Reservation(
            evidence.leaps,
            f"the walk leaps at frames {frame_ranges(evidence.leaps)}, further than any walk does in a step: "
            "the tracker jumped there, and what follows was put at a place that may only look alike",
            "look at those frames, delete the loops that are wrong (planfit view), or scan that part again",
        )
    ]


def _of_other_scale(evidence: Evidence) -> list[Reservation]:
    """A plan in metres that was taken as drawn and would fit clearly better at another scale."""
    if evidence.other_scale is None:
        return []
    everything = (evidence.stretches[0].frames[0], evidence.stretches[-1].frames[1])
    return [Reservation((everything,), other_scale_words(evidence.other_scale), OTHER_SCALE_ADVICE)]


def _of_rivals(evidence: Evidence, options: VerdictOptions) -> list[Reservation]:
    """The scan fits the plan in another way about as well, depending on which walls were moved."""
    if evidence.rival_error_m <= RIVAL_SHARE * options.max_error_m:
        return []
    stretches, walls = evidence.stretches, evidence.moved_walls
    taken, check = "", "check the plan"
    if walls:
        shown = [*walls[:MAX_NAMED_WALLS]]
        if len(walls) > MAX_NAMED_WALLS:
            shown.append(f"{len(walls) - MAX_NAMED_WALLS} more")
        taken = f", other walls being drawn wrongly then; taken for moved were {'; '.join(shown)}"
        check = "measure one of these walls in the building and correct the plan there"
    return [
        Reservation(
            ((stretches[0].frames[0], stretches[-1].frames[1]),),
            f"the scan fits the plan about as well with its frames {evidence.rival_error_m:.2f} m (RMS) "
            f"elsewhere{taken}",
            f"{check}, or give control points",
            walls,
        )
    ]


def _of_unsure_stretches(evidence: Evidence, options: VerdictOptions) -> list[Reservation]:
    """Runs of stretches whose predicted error is large."""
    found = []
    for run in _runs([s.predicted_m > options.max_stretch_error_m for s in evidence.stretches]):
        stretches = [evidence.stretches[k] for k in run]
        frames = stretches[0].frames[0], stretches[-1].frames[1]
        worst = max(stretches, key=lambda s: s.predicted_m)
        along = ""
        if worst.open_direction is not None:
            x, y = worst.open_direction
            along = f" along the plan's direction ({x:.2f}, {y:.2f})"
        found.append(
            Reservation(
                (frames,),
                f"frames {frame_ranges([frames])} are not fixed{along}: they may be off by "
                f"{worst.predicted_m:.2f} m",
                "scan that part again with places that were seen before and walls of both directions in "
                "view, or give control points there",
            )
        )
    return found


def _of_unexplained_stretches(evidence: Evidence) -> list[Reservation]:
    """Runs of stretches whose walls are not on the plan though walls elsewhere are, and that nothing else
    confirms."""
    agreeing = {
        frames
        for visit in evidence.visits
        if visit.kept_out_m < CONTRADICTED_M
        for frames in (visit.first_frames, visit.last_frames)
    }
    is_alone = [
        s.frames not in agreeing and not s.near_kept_out >= WITNESSED_SHARE
        for s in evidence.stretches
    ]
    found = []
    for run in _runs(is_alone):
        if not _is_unexplained(evidence, run):
            continue
        own = [evidence.stretches[k] for k in run]
        frames = own[0].frames[0], own[-1].frames[1]
        walls = _walls_of(own)
        found.append(
            Reservation(
                (frames,),
                f"frames {frame_ranges([frames])} are confirmed by nothing: {walls.near:.0%} of their "
                f"{walls.n_patches} wall patches lie on the plan, {_walls_of(_rest(evidence, run)).near:.0%} "
                "elsewhere, and no place of theirs is seen again",
                "check the plan there: its walls may have been moved or not been built; else the tracker "
                "jumped",
            )
        )
    return found


def _of_walls_alone(evidence: Evidence) -> list[Reservation]:
    """Walls that hold the recorded motion alone, and do not confirm themselves."""
    near = evidence.near_shares
    is_tied = bool(evidence.visits) or not set(evidence.scan_costs) <= OF_FRAMES_ALONE
    if near is None or is_tied or near[1] >= HELD_BY_WALLS_SHARE:
        return []
    everything = (evidence.stretches[0].frames[0], evidence.stretches[-1].frames[1])
    return [
        Reservation(
            (everything,),
            "nothing but walls corrects the recorded motion, as no images match, and only "
            f"{near[1]:.0%} of the wall patches lie on the plan in solves that did without them",
            "scan again where images show more, with more light or a wider view, or give control points",
        )
    ]


def _is_unexplained(evidence: Evidence, run: Sequence[int]) -> bool:
    """Whether the walls of a run that is confirmed by nothing are missed on the plan.

    At an end of the walk, a run hangs at one side only: walls beside the drawn ones tell as well, as it may
    have drifted off as a whole. Between stretches that are confirmed, walls beside the drawn ones were
    moved; but where several stretches are near no wall at all, the path between may go anywhere."""
    own = _walls_of([evidence.stretches[k] for k in run])
    rest = _walls_of(_rest(evidence, run))
    if min(own.n_patches, rest.n_patches) < UNEXPLAINED_PATCHES or rest.near < ELSEWHERE_SHARE:
        return False
    if own.near > UNEXPLAINED_SHARE * rest.near:
        return False
    if 0 in run or len(evidence.stretches) - 1 in run:
        return True
    is_nowhere = own.near + own.beside <= NOWHERE_SHARE * rest.near
    return is_nowhere and len(run) > 1 and own.n_patches >= 2 * UNEXPLAINED_PATCHES


def _rest(evidence: Evidence, run: Sequence[int]) -> list[Stretch]:
    return [stretch for k, stretch in enumerate(evidence.stretches) if k not in run]


def _of_contradicted_visits(evidence: Evidence) -> list[Reservation]:
    bad = [visit for visit in evidence.visits if visit.after_m > CONTRADICTED_M]
    if len(bad) <= CONTRADICTED_SHARE * len(evidence.visits):
        return []
    frames = tuple(dict.fromkeys(f for v in bad for f in (v.first_frames, v.last_frames)))
    return [
        Reservation(
            frames,
            f"of {len(evidence.visits)} times that a place is seen again, {len(bad)} contradict the result, "
            f"by {np.median([visit.after_m for visit in bad]):.1f} m: frames {frame_ranges(frames)}",
            "look whether these frames show the same place; places that look alike are confused",
        )
    ]


def _of_strained_terms(evidence: Evidence) -> list[Reservation]:
    """Terms that the walls of the plan made worse than correcting drift explains."""
    everything = (evidence.stretches[0].frames[0], evidence.stretches[-1].frames[1])
    return [
        Reservation(
            (everything,),
            f"scan and plan contradict each other: the misfit of the {name} rises {after / before:.1f} times "
            "when the walls of the plan pull",
            "the plan may differ from the building where the report shows large distances, or be of another "
            "place or scale",
        )
        for name, (before, after) in evidence.scan_costs.items()
        if after > MAX_STRAIN * before
    ]


def _of_storeys_without_plan(evidence: Evidence) -> list[Reservation]:
    return [
        Reservation(
            storey.frames,
            f"frames {frame_ranges(storey.frames)} are on {storey.name}: matches, recorded motion and floor "
            "alone hold them",
            "give the plan of that storey too (--plan NUMBER=FILE)",
        )
        for storey in evidence.without_plan
    ]


@dataclass(frozen=True)
class _Walls:
    """Wall of some stretches, kept out of the solve."""

    n_patches: int
    near: float
    """Share of the patches on the plan."""
    beside: float
    """Share of them beside it."""


def _walls_of(stretches: Sequence[Stretch]) -> _Walls:
    seen = [s for s in stretches if s.n_patches]
    n_patches = sum(s.n_patches for s in seen)
    near = sum(s.near_kept_out * s.n_patches for s in seen)
    beside = sum(s.beside * s.n_patches for s in seen)
    return _Walls(n_patches, near / max(n_patches, 1), beside / max(n_patches, 1))


def _runs(holds: Sequence[bool]) -> list[list[int]]:
    """Runs of neighbours for which something holds."""
    groups = groupby(range(len(holds)), key=lambda k: holds[k])
    return [list(run) for held, run in groups if held]
