"""Corrections by hand against the result: places, what each came to, and those that something contradicts."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from planfit.adjust import follow_keyframes
from planfit.alignment.options import (
    ControlPoint,
    disagreement_hint,
    read_control_points,
    worst_control_point,
)
from planfit.corrections import Contradiction, Correction, Corrections, Place
from planfit.errors import OptionError
from planfit.findings import Finding, PlanKind, SurveyKind
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.pipeline.by_hand import HandSeen
from planfit.pipeline.disagreements import Disagreement, EvidenceItem
from planfit.pipeline.evidence import CONTRADICTED_M
from planfit.pipeline.on_plan import PointsAgainstWalls, ScanOnPlan
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.places_and_walls import placed_by_walls
from planfit.pipeline.prepare import PreparedScan
from planfit.priors import DRIFT_SHARE
from planfit.units import in_units

STRAIN_SHARE = DRIFT_SHARE.value
"""A loop that bends a stretch of the recorded motion by more than this share of its length, and by
`CONTRADICTED_M` at least, is contradicted by it: no tracker loses as much."""


class ContradictedError(OptionError):
    """Corrections with which nothing can be solved; the message names each."""

    def __init__(self, name: str, contradictions: tuple[Contradiction, ...]) -> None:
        self.contradictions = contradictions
        """All of them."""
        sentences = "; ".join(each.sentence for each in contradictions)
        super().__init__(
            f"{name}: expected corrections that agree, found {len(contradictions)} contradicted: "
            f"{sentences}; mend the file, or solve without those by --without-contradicted"
        )


@dataclass(frozen=True)
class CorrectionOutcome:
    """A correction that was used, and how far the result is from it."""

    correction: Correction
    residual_m: float | None
    """m: of a place, how far its point ends from where it should be; of a loop that was added, the median
    distance between the two sightings of a point. None where there is nothing to measure."""

    @property
    def sentence(self) -> str:
        """For a user, without a full stop."""
        if self.residual_m is None:
            return self.correction.words
        return f"{self.correction.words}; {in_units(self.residual_m)} apart in the result"


@dataclass(frozen=True)
class ByHand:
    """What corrections by hand came to."""

    used: Corrections
    outcomes: tuple[CorrectionOutcome, ...]
    """Of those that were used."""
    contradictions: tuple[Contradiction, ...]
    """Of those that were used although something contradicts them."""
    left_out: tuple[Contradiction, ...] = ()
    """Those that were solved without, and why."""

    @property
    def sentence(self) -> str:
        """How many of what were used, and how many were left out."""
        words = self.used.sentence
        if self.left_out:
            words += f"; {len(self.left_out)} contradicted and left out"
        return words

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Each that is contradicted."""
        return tuple(
            Finding(kind, {"correction": each.correction.words}, parts=(each.reason,))
            for kind, those in (
                (SurveyKind.CORRECTION_CONTRADICTED, self.contradictions),
                (SurveyKind.CORRECTION_LEFT_OUT, self.left_out),
            )
            for each in those
        )


def with_places(
    options: RefineOptions, seen: HandSeen | None, prepared: PreparedScan, floorplan: Floorplan
) -> RefineOptions:
    """Options with places as control points; those picked in images stand where loops, closed, put them.

    Raises:
        ContradictedError: places disagree with each other.
        OptionError: a place lies outside of the plan.
    """
    if seen is None or not seen.corrections.places:
        return options
    texts = []
    world_from_level = se3.inverse(prepared.level_from_world)
    level_from_cams = follow_keyframes(prepared.level_from_keys, prepared.keyframes)
    places = seen.corrections.places
    for place, point_cam in zip(places, seen.place_points_cam, strict=True):
        world = np.array(place.scan if place.scan is not None else np.zeros(3))
        if point_cam is not None:
            assert place.frame is not None
            world = se3.transform(world_from_level @ level_from_cams[place.frame], point_cam[None])[
                0
            ]
        scan_side = ",".join(repr(float(v)) for v in world)
        plan_side = ",".join(repr(float(v)) for v in place.plan)
        texts.append(f"{scan_side}={'file:' if place.is_of_file else ''}{plan_side}")
    try:
        points = read_control_points(tuple(texts), prepared.level_from_world, floorplan)
    except OptionError as error:
        raise OptionError(f"{seen.corrections.name}: place: {error}") from error
    chosen = options.align
    _require_agreement(seen.corrections, points, prepared, floorplan, options)
    return replace(
        options,
        align=replace(chosen, control_points=(*chosen.control_points, *texts)),
    )


def by_hand_outcome(
    seen: HandSeen,
    plan_from_cams: Poses,
    plan_from_world: Float[np.ndarray, "4 4"],
    on_plan: ScanOnPlan,
    tolerance_m: float,
) -> tuple[tuple[CorrectionOutcome, ...], tuple[Contradiction, ...]]:
    """How far a result is from each correction, and which it contradicts.

    Args:
        seen: corrections that were used.
        plan_from_world: of the result as a whole, for places in the scan's own axes.
        on_plan: where the scan stands, and whether its walls contradict that.
        tolerance_m: how far off a place may end.
    """
    residuals = _place_residuals(seen, plan_from_cams, plan_from_world, on_plan.floorplan)
    residuals |= _loop_residuals(seen, plan_from_cams)
    outcomes = tuple(
        CorrectionOutcome(each, residuals.get((each.kind, each.number)))
        for each in seen.corrections
    )
    found = _places_against_walls(seen.corrections, on_plan.against_points, tolerance_m)
    for each in outcomes:
        is_place = isinstance(each.correction, Place)
        most = tolerance_m if is_place else CONTRADICTED_M
        if each.residual_m is not None and each.residual_m > most:
            facts = {"residual_m": each.residual_m, "allowed_m": most, "is_place": is_place}
            off = Finding(SurveyKind.CORRECTION_ENDS_OFF, facts)
            found.append(Contradiction(each.correction, off))
    return outcomes, tuple(found)


def loops_against_motion(
    corrections: Corrections,
    disagreements: Sequence[Disagreement],
    recorded: Float[np.ndarray, "n 3"],
) -> tuple[Contradiction, ...]:
    """Loops that were added, and without which the recorded motion fits as no drift explains.

    No loss lets go of such a loop, so that the result ends on it, and its own residual tells nothing.

    Args:
        recorded: positions of the cameras.
    """
    steps_m = np.linalg.norm(np.diff(recorded, axis=0), axis=1)

    def most_m(motion: EvidenceItem) -> float:
        way_m = 0.0 if motion.first_frames is None else steps_m[slice(*motion.first_frames)].sum()
        return max(CONTRADICTED_M, STRAIN_SHARE * float(way_m))

    found = []
    for each in disagreements:
        first, last = each.item.first_frames, each.item.last_frames
        if each.item.kind != "loop by hand" or first is None or last is None:
            continue
        motions = (one for one in each.eased if one.item.kind == "recorded motion")
        bent = [one for one in motions if one.by_m > most_m(one.item)]
        if not bent or each.kept_out_m <= CONTRADICTED_M:
            continue
        facts = {"off_m": each.kept_out_m, "better_m": bent[0].by_m}
        run = bent[0].item.first_frames
        reason = Finding(SurveyKind.LOOP_BENDS_MOTION, facts, (run,) if run else ())
        found += [
            Contradiction(loop, reason)
            for loop in corrections.added
            if first[0] <= loop.frames[0] <= first[1] and last[0] <= loop.frames[1] <= last[1]
        ]
    return tuple(found)


def first_of_each(contradictions: tuple[Contradiction, ...]) -> tuple[Contradiction, ...]:
    """One of each correction: the first."""
    found: dict[tuple[str, int], Contradiction] = {}
    for each in contradictions:
        found.setdefault((each.correction.kind, each.correction.number), each)
    return tuple(found.values())


def _require_agreement(
    corrections: Corrections,
    points: tuple[ControlPoint, ...],
    prepared: PreparedScan,
    floorplan: Floorplan,
    options: RefineOptions,
) -> None:
    """Raise where places disagree; named are those that walls, where they surely tell, put elsewhere."""
    tolerance_m = options.align.control_point_tolerance_m
    scale = 1.0 if floorplan.is_metric else options.align.metres_per_unit or None
    if worst_control_point(points, scale, tolerance_m) is None:
        return
    hint = disagreement_hint(points, scale, tolerance_m)
    hints = () if hint is None else (hint,)
    alone = placed_by_walls(prepared, floorplan, options, None, points)
    found: list[Contradiction] = []
    if alone is not None and alone.alignment.is_sure:
        for k in np.flatnonzero(alone.off_m > tolerance_m):
            off = {"off_m": float(alone.off_m[k])}
            reason = Finding(SurveyKind.PLACE_OFF_BY_WALLS_ALONE, off, parts=hints)
            found.append(Contradiction(corrections.places[k], reason, prevents=True))
    if not found:
        left = list(range(len(points)))
        while worst := worst_control_point([points[k] for k in left], scale, tolerance_m):
            k = left.pop(worst[0])
            off = {"off_m": worst[1]}
            reason = Finding(SurveyKind.PLACE_OFF_BY_OTHERS, off, parts=hints)
            found.append(Contradiction(corrections.places[k], reason, prevents=True))
    raise ContradictedError(corrections.name, tuple(found))


def _places_against_walls(
    corrections: Corrections, against: PointsAgainstWalls | None, tolerance_m: float
) -> list[Contradiction]:
    """Places that hold the scan where its walls do not fit: those that are off where these do."""
    if against is None:
        return []
    places = corrections.places
    # Those of the options come before them.
    off_m = against.off_m[len(against.off_m) - len(places) :]
    return [
        Contradiction(
            place, Finding(PlanKind.PLACE_OFF_BY_WALLS, {"off_m": float(off), **against.facts})
        )
        for place, off in zip(places, off_m, strict=True)
        if off > tolerance_m
    ]


def _place_residuals(
    seen: HandSeen,
    plan_from_cams: Poses,
    plan_from_world: Float[np.ndarray, "4 4"],
    floorplan: Floorplan | None,
) -> dict[tuple[str, int], float]:
    found: dict[tuple[str, int], float] = {}
    if floorplan is None:
        return found
    source = floorplan.source
    for place, point_cam in zip(seen.corrections.places, seen.place_points_cam, strict=True):
        there_from_plan = source.rim_from_plan
        if place.is_of_file and source.file_from_plan is not None:
            there_from_plan = source.file_from_plan
        given = np.linalg.inv(there_from_plan) @ np.array([*place.plan, 1.0])
        if point_cam is not None and place.frame is not None:
            at = se3.transform(plan_from_cams[place.frame], point_cam[None])[0]
        else:
            at = se3.transform(plan_from_world, np.array([place.scan]))[0]
        found[place.kind, place.number] = float(np.linalg.norm(at[:2] - given[:2] / given[2]))
    return found


def _loop_residuals(seen: HandSeen, plan_from_cams: Poses) -> dict[tuple[str, int], float]:
    matches = seen.matches.matches
    found = {}
    for loop in seen.corrections.added:
        for k in np.flatnonzero((matches.pairs == loop.frames).all(axis=1)):
            own = slice(matches.start[k], matches.start[k + 1])
            i, j = loop.frames
            a = se3.transform(plan_from_cams[i], matches.points_a[own])
            b = se3.transform(plan_from_cams[j], matches.points_b[own])
            found[loop.kind, loop.number] = float(np.median(np.linalg.norm(a - b, axis=1)))
    return found
