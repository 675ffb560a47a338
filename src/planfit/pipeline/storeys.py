"""Several storeys in one walk, each with a plan of its own, chosen among those given.

Each storey that was walked is aligned alone with its plan. Then all faces are brought into the frame of the
lowest one, each with its storey, so that what follows sees one plan (docs/adr/0011-several-storeys.md).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, permutations

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.adjust import follow_keyframes
from planfit.alignment import (
    AdjustedAlignment,
    AlignmentHypothesis,
    AlignOptions,
    WallSamples,
    judge_adjusted,
)
from planfit.alignment import align as search_alignment
from planfit.alignment.plan_scale import CLEAR_GAIN, SAME_SCORE
from planfit.alignment.selection import AS_RECORDED_SHARE, NULL_SCORE, SameWithin, is_same
from planfit.errors import FloorplanError, ScanError, require
from planfit.floorplan import Floorplan
from planfit.floorplan.plans_on_sheet import join_storeys
from planfit.geometry import se3
from planfit.pipeline.align import align_to_plan, wall_samples
from planfit.pipeline.observations import Observations
from planfit.pipeline.on_plan import ScanOnPlan, Storey, StoreyOnPlan, Storeys, frame_runs
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.prepare import PreparedScan
from planfit.pipeline.storey_heights import (
    refit_floors,
    structure_with_floors,
    with_floors,
)
from planfit.runtime import StageTimer
from planfit.scan import Scan
from planfit.segmentation import Structure, number_storeys

SHARED_M, SHARED_DEG = 1.0, 3.0
"""Plans in metres whose alignments agree so nearly share their axes: drift on the stairs between is less, and
the origins of drawings that were made apart are metres apart."""
_SWAPPED_BY = CLEAR_GAIN
"""By so much more of the wall (mean over storeys) plans fit in another order where they were swapped."""
_MAX_PAIRS = 6
"""Of storeys with plans in any order that are tried: orders grow as the factorial."""

_Pairs = tuple[tuple[int, int], ...]
"""Storeys and plans, by index."""


@dataclass(frozen=True)
class ScanOnStoreys:
    """A scan where each storey has its plan: heights are above the floor of the lowest of these, and the
    walls are those that frames on them see."""

    observations: Observations
    prepared: PreparedScan
    on_plan: ScanOnPlan


def place_on_storeys(
    scan: Scan,
    observations: Observations,
    prepared: PreparedScan,
    plans: Mapping[int, Floorplan],
    options: RefineOptions,
    timer: StageTimer,
) -> ScanOnStoreys:
    """Align each storey with its plan, and bring all plans into the frame of the lowest one.

    Args:
        plans: by number; of two storeys the higher one has the higher number.

    Raises:
        ScanError: no wall was seen.
        FloorplanError: plans fit in another order, or one is not in the unit that it claims, or its unit
            cannot be found.
        OptionError: there is no plan, or an option is for one plan alone.
    """
    _require_possible(plans, options)
    level_from_cams = follow_keyframes(prepared.level_from_keys, prepared.keyframes)
    floors_m, of_frames = number_storeys(
        observations.structure.floor_heights_m,
        level_from_cams[:, 2, 3],
    )
    of_keys = of_frames[prepared.keyframes.frame_idx]
    with timer.stage("floors of storeys"):
        found_m, floors_m = floors_m, refit_floors(prepared, floors_m, options.adjust)
        prepared = with_floors(prepared, found_m, floors_m)
    walls = [_wall_samples(_only(prepared, of_keys == k)) for k in range(len(floors_m))]
    _require_walls(scan.name, walls)
    with timer.stage("align"):
        numbers = _choose_plans(walls, plans, options.align)
    lowest = min(numbers)
    heights_m = floors_m - floors_m[lowest]
    prepared = _lowered(prepared, float(floors_m[lowest]))
    aligned = {
        k: align_to_plan(scan, _only(prepared, of_keys == k), plans[number], options, timer)
        for k, number in numbers.items()
    }
    aligned, sharing = in_shared_axes(aligned, dict(enumerate(walls)))
    owns = _own_plans(numbers, aligned, sharing, heights_m)
    walked = tuple(
        Storey(float(heights_m[k]), frame_runs(of_frames == k), owns.get(k))
        for k in range(len(heights_m))
    )
    not_walked = tuple(sorted(set(plans) - set(numbers.values())))
    structure = structure_with_floors(observations.structure, found_m, heights_m)
    return _joined(
        replace(observations, structure=structure),
        prepared,
        aligned[lowest],
        Storeys(walked, of_frames, not_walked),
    )


def _joined(
    observations: Observations, prepared: PreparedScan, lowest: ScanOnPlan, storeys: Storeys
) -> ScanOnStoreys:
    """All plans as one in the frame of the lowest; frames know their storeys."""
    owns = storeys.with_plan
    joined = join_storeys({k: own.floorplan.placed(own.plan_from_own) for k, own in owns.items()})
    of_frames, measured = storeys.of_frames, prepared.measurements
    of_keys = of_frames[prepared.keyframes.frame_idx]
    on_storeys = _on_storeys(measured.structure, of_keys, storeys)
    return ScanOnStoreys(
        replace(observations, structure=_on_storeys(observations.structure, of_frames, storeys)),
        replace(prepared, measurements=replace(measured, structure=on_storeys)),
        replace(lowest, floorplan=joined, storeys=storeys),
    )


def judge_storeys(
    structure: Structure,
    storeys: Storeys,
    solved: Float[np.ndarray, "k 4 4"],
    options: AlignOptions,
) -> AdjustedAlignment:
    """Judge adjusted walls on the plan of their storey, as `judge_adjusted` does; of the storey least sure.

    Args:
        structure: of the k frames that were solved for, which know their storeys.
        storeys: that were walked.
        solved: plan_from_cams.
        options: what counts as another alignment.
    """
    assert structure.storeys is not None
    judged = []
    for k, own in storeys.with_plan.items():
        part = structure.with_walls_of(structure.storeys == k)
        walls = wall_samples(part, se3.inverse(own.plan_from_own) @ solved)
        found = judge_adjusted(walls, own.floorplan, own.alignment, options)
        if found.doubt is not None:
            found = replace(found, doubt=found.doubt.about(storeys.walked[k].name))
        judged.append(found)
    least = min(judged, key=lambda each: (each.doubt is None, each.score - each.runner_up_score))
    others = (each.other_scale for each in judged if each.other_scale is not None)
    return replace(least, other_scale=next(others, None))


def in_shared_axes(
    aligned: Mapping[int, ScanOnPlan], walls: Mapping[int, WallSamples]
) -> tuple[dict[int, ScanOnPlan], frozenset[int]]:
    """Alignments where storeys whose plans share axes lie as drawn, and which storeys these are.

    The alignment that is surest is held to. Another plan that is in metres as drawn shares its axes where
    the storey fits it there too: as it was aligned, or as a candidate that explains nearly as much.

    Args:
        walls: by storey, level frame.
    """
    surest = max(aligned, key=lambda k: _surety(aligned[k]))
    anchor, found, sharing = aligned[surest], dict(aligned), set()
    there = AlignmentHypothesis.from_transform(anchor.plan_from_level)
    within = SameWithin(SHARED_M, SHARED_DEG, 0.0)
    for k, own in aligned.items():
        if k == surest or not (_is_as_drawn(anchor) and _is_as_drawn(own)):
            continue
        alignment = own.alignment
        assert alignment is not None
        fitting = [
            each
            for each in alignment.candidates
            if each.score >= AS_RECORDED_SHARE * alignment.score
        ]
        if not is_same(fitting, there, walls[k], within).any():
            continue
        sharing |= {surest, k}
        if _surety(anchor)[0]:
            # What fitted elsewhere as well is settled.
            alignment = replace(alignment, is_as_recorded=True, is_sure=True, findings=())
        alignment = replace(alignment, plan_from_level=anchor.plan_from_level)
        found[k] = replace(own, plan_from_level=anchor.plan_from_level, alignment=alignment)
    return found, frozenset(sharing)


def _surety(own: ScanOnPlan) -> tuple[bool, float]:
    assert own.alignment is not None  # storeys without walls have no plan
    return own.alignment.is_sure, own.alignment.score + own.alignment.margin


def _is_as_drawn(own: ScanOnPlan) -> bool:
    """Whether a plan has the scale that it is drawn at."""
    return own.alignment is not None and own.alignment.scale_xy == (1.0, 1.0)


def _own_plans(
    numbers: Mapping[int, int],
    aligned: Mapping[int, ScanOnPlan],
    sharing: frozenset[int],
    heights_m: Float[np.ndarray, " k"],
) -> dict[int, StoreyOnPlan]:
    """Each storey's plan in the frame of the lowest one, its floor at its height (m)."""
    lowest, owns = aligned[min(aligned)], {}
    for k, own in aligned.items():
        assert own.floorplan is not None
        assert own.alignment is not None
        plan_from_own = np.eye(4)
        if not np.array_equal(own.plan_from_level, lowest.plan_from_level):
            plan_from_own = lowest.plan_from_level @ se3.inverse(own.plan_from_level)
        plan_from_own[2, 3] = heights_m[k]
        owns[k] = StoreyOnPlan(
            numbers[k], own.floorplan, own.alignment, plan_from_own, k in sharing
        )
    return owns


def _require_walls(scan_name: str, walls: Sequence[WallSamples]) -> None:
    if not any(len(each.xy) > 1 for each in walls):
        raise ScanError(
            f"{scan_name}: expected walls to place each storey on its plan by, found none; give wall masks, "
            "or scan more of the walls"
        )


def _wall_samples(prepared: PreparedScan) -> WallSamples:
    return wall_samples(prepared.measurements.structure, prepared.level_from_keys)


def _only(prepared: PreparedScan, frames: Bool[np.ndarray, " k"]) -> PreparedScan:
    """The scan with the walls that some keyframes see."""
    measured = prepared.measurements
    structure = measured.structure.with_walls_of(frames)
    return replace(prepared, measurements=replace(measured, structure=structure))


def _on_storeys(
    structure: Structure, of_frames: Int[np.ndarray, " n"], storeys: Storeys
) -> Structure:
    """Frames know their storeys; walls seen from stairs and from storeys without a plan are left out."""
    has_plan = np.isin(of_frames, list(storeys.with_plan))
    return replace(structure.with_walls_of(has_plan), storeys=of_frames)


def _lowered(prepared: PreparedScan, by_m: float) -> PreparedScan:
    """Heights above another floor."""
    down = se3.make_transform(np.eye(3), np.array([0.0, 0.0, -by_m]))
    measured = prepared.measurements
    heights_m = measured.structure.floor_heights_m - by_m
    structure = replace(measured.structure, floor_heights_m=heights_m)
    return replace(
        prepared,
        measurements=replace(measured, structure=structure),
        level_from_world=down @ prepared.level_from_world,
        level_from_cams=down @ prepared.level_from_cams,
        level_from_keys=down @ prepared.level_from_keys,
    )


def _require_possible(plans: Mapping[int, Floorplan], options: RefineOptions) -> None:
    """Raise `OptionError` for what only one plan can have."""
    require(
        len(plans) > 0,
        "plans: expected one for each storey, found none; give plans by their number",
    )
    for number in plans:
        require(
            isinstance(number, int),
            f"plans: expected whole numbers of storeys (0, 1, ...), found {number!r}",
        )
    chosen, defaults = options.align, AlignOptions()
    for name in ("method", "start", "control_points", "candidate", "metres_per_unit"):
        require(
            getattr(chosen, name) == getattr(defaults, name),
            f"align.{name.replace('_', '-')}: expected one plan for it, found plans by storey; leave it out, "
            "or refine against one plan",
        )
    require(
        options.adjust.wall_strategy == "fixed",
        f"adjust.wall-strategy: expected fixed with plans by storey, found {options.adjust.wall_strategy}",
    )


def _choose_plans(
    walls: Sequence[WallSamples], plans: Mapping[int, Floorplan], options: AlignOptions
) -> dict[int, int]:
    """Number of the plan of each storey that has one, by the storey's index from the lowest.

    Args:
        walls: of each storey that was walked, from the lowest, level frame; one of them at least shows some.
        plans: by number.

    Raises:
        FloorplanError: plans fit clearly better in another order than that of their numbers.
    """
    numbers = sorted(plans)
    seen = np.array([k for k, each in enumerate(walls) if len(each.xy) > 1])
    fits = np.array(
        [[search_alignment(walls[k], plans[i], options).score for i in numbers] for k in seen]
    )
    as_numbered = seen[:, None] == np.array(numbers) - numbers[0]
    # A storey is better left without a plan than given one that explains no more than others would; and where
    # storeys are alike, plans are numbered from the lowest one walked.
    worth = fits - NULL_SCORE + SAME_SCORE * as_numbered
    chosen = _best(worth, in_order=True)
    best = _best(worth, in_order=False)
    gain = (_worth(worth, best) - _worth(worth, chosen)) / max(len(best), 1)
    if gain > _SWAPPED_BY:
        raise FloorplanError(_swapped_words(fits, numbers, best, plans))
    return {int(seen[k]): numbers[plan] for k, plan in chosen}


def _best(worth: Float[np.ndarray, "k p"], in_order: bool) -> _Pairs:
    """The pairs that are worth most; with none worth anything, as many as there can be."""
    n_storeys, n_plans = worth.shape
    found: list[_Pairs] = []
    most = min(n_storeys, n_plans)
    for size in range(1, most + 1):
        for storeys in combinations(range(n_storeys), size):
            some = combinations(range(n_plans), size)
            if not in_order and size <= _MAX_PAIRS:
                some = permutations(range(n_plans), size)
            found += [tuple(zip(storeys, plans, strict=True)) for plans in some]
    best = max(found, key=lambda pairs: _worth(worth, pairs))
    if _worth(worth, best) > 0:
        return best
    return max((each for each in found if len(each) == most), key=lambda p: _worth(worth, p))


def _worth(worth: Float[np.ndarray, "k p"], pairs: _Pairs) -> float:
    return float(sum(worth[pair] for pair in pairs))


def _swapped_words(
    fits: Float[np.ndarray, "k p"],
    numbers: Sequence[int],
    best: _Pairs,
    plans: Mapping[int, Floorplan],
) -> str:
    """What was found, and which numbers to give."""
    upwards = sorted(best)
    in_order = sorted(plan for _, plan in best)
    found = ", ".join(
        f"{plans[numbers[plan]].name} explains {fits[k, plan]:.0%} of the wall of storey {k + 1} from below "
        f"({plans[numbers[expected]].name} {fits[k, expected]:.0%})"
        for (k, plan), expected in zip(upwards, in_order, strict=True)
    )
    again = " ".join(
        f"--plan {numbers[expected]}={plans[numbers[plan]].name}"
        for (_, plan), expected in zip(upwards, in_order, strict=True)
    )
    return (
        f"plans by storey: expected the lower storey's plan to have the lower number, found that {found}; "
        f"give {again}"
    )
