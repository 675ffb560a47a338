"""What a user should know before trusting a result: each warning in plain words, with what to do."""

import numpy as np
from jaxtyping import Int

from planfit.adjust import PlanAdjustment, TornStep, describe_moved
from planfit.adjust.observability import frame_ranges
from planfit.alignment import Alignment, told_of
from planfit.matching import Matches, SurfacePairs
from planfit.pipeline.on_plan import Storeys
from planfit.pipeline.validation import Check
from planfit.scan import Scan
from planfit.segmentation import Gravity, Structure

MIN_NEAR_SHARE = {"masks": 0.75, "geometry": 0.5, "learned": 0.5}
"""Share of wall points that should lie near the plan in the end, by where labels come from. Right plans
leave 0.86 to 1.00 with masks; geometry takes tall furniture for wall and leaves 0.64 to 0.90."""

MAX_TORN_STEPS = 3
"""Torn steps that are named one by one."""


NO_SURFACES = SurfacePairs.none()


def scan_warnings(
    scan: Scan,
    gravity: Gravity,
    structure: Structure,
    matches: Matches,
    neighbours: int,
    has_plan: bool = True,
    surfaces: SurfacePairs = NO_SURFACES,
    keyframe_idx: Int[np.ndarray, " k"] | None = None,
) -> tuple[str, ...]:
    """Warnings about what the scan shows; walls are missed only where there is a plan to hold them to."""
    warnings = []
    if len(scan) < 20:
        warnings.append(
            f"only {len(scan)} frames: there is little to hold the poses together; "
            "more frames that see the same places give a surer result"
        )
    if gravity.confidence < 0.05:
        warnings.append(
            f"gravity is unsure (from {gravity.source}); check that the floor is level in the report"
        )
    if not structure.has_floor:
        warnings.append(
            "no floor was seen: height and tilt follow the recorded poses; "
            "tilt the camera down while scanning, or give floor masks"
        )
    if structure.drifted_floors_m:
        heights = " and ".join(f"{height:+.1f} m" for height in structure.drifted_floors_m)
        warnings.append(
            f"the recorded poses drift in height: the floor was recorded at {heights} as well, and matches "
            "and motion show that it is the same; if there are stairs, scan them with images that overlap"
        )
    if has_plan and not structure.has_walls:
        warnings.append(
            "no wall was seen: the scan cannot be aligned with the plan by its walls, and only the "
            "matches and the floor were used; give wall masks, or scan more of the walls"
        )
    others = "walls and floor" if has_plan else "the floor"
    if not scan.has_color:
        warnings.append(f"the scan has no colour: {surfaces.sentence}")
    if matches.n_matches == 0 and len(surfaces) == 0:
        check = (
            "colour images are sharp and belong to the depth"
            if scan.has_color
            else "frames that follow each other show the same surfaces"
        )
        warnings.append(
            f"no two frames could be matched: poses were refined by {others} alone; check that {check}"
        )
    elif sum(found.n_loops(neighbours, keyframe_idx) for found in (matches, surfaces)) == 0:
        warnings.append(
            "no place was seen to be visited again (no loop closure): drift along the path is corrected by "
            f"{others} only"
        )
    return tuple(warnings)


def alignment_warnings(
    alignment: Alignment | None,
    is_alignment_claimed: bool,
    plan_adjustment: PlanAdjustment,
    structure: Structure,
    checks: tuple[Check, ...],
    is_place_sure: bool,
) -> tuple[str, ...]:
    """Warnings about how scan and plan came together.

    What was said of a deformed scan before the adjustment is left out where the adjusted walls surely lie on
    the plan (`is_place_sure`).
    """
    warnings = []
    if alignment is not None:
        mended = alignment.bent if is_place_sure else ()
        warnings += [words for words in told_of(alignment) if words not in mended]
    if alignment is None and not is_alignment_claimed:
        warnings.append("the scan is not aligned with the plan: its own axes were kept, levelled")
    near = next((check.after for check in checks if check.unit == "share"), 1.0)
    if near < MIN_NEAR_SHARE[structure.back_end]:
        n_patches, n_associated = len(structure.walls), plan_adjustment.association.n_associated
        warnings.append(
            f"only {near:.0%} of the wall points lie near the plan in the end ({n_associated} of "
            f"{n_patches} wall patches found a face): parts of the plan may be missing, moved or "
            "out of date, or it is the plan of another place; look at the overlay"
        )
    if plan_adjustment.moved_walls and plan_adjustment.correspondences is not None:
        floorplan = plan_adjustment.correspondences.floorplan
        warnings.append(describe_moved(plan_adjustment.moved_walls, floorplan))
    return (*warnings, *adjustment_warnings(plan_adjustment))


def storey_warnings(storeys: Storeys) -> tuple[str, ...]:
    """Warnings about plans by storey: which were not used, which are missed, and what their alignments say
    (that of the lowest one aside, which `alignment_warnings` tells)."""
    warnings = [
        f"no frame stands on storey {number}: its plan was not used; check its number"
        for number in storeys.not_walked
    ]
    warnings += [
        f"frames {frame_ranges(storey.frames)} stand on {storey.name}: they are held by matches, recorded "
        "motion and floor alone"
        for storey in storeys.without_plan
    ]
    for k in list(storeys.with_plan)[1:]:
        own = storeys.with_plan[k]
        warnings += [f"{storeys.walked[k].name}: {words}" for words in told_of(own.alignment)]
    return tuple(warnings)


def adjustment_warnings(plan_adjustment: PlanAdjustment) -> tuple[str, ...]:
    """Warnings about how the solve went."""
    warnings = list(plan_adjustment.weakly_constrained)
    warnings += _torn_step_warnings(plan_adjustment.torn_steps)
    if not plan_adjustment.converged:
        warnings.append(
            "correspondences of walls and faces were still changing when the rounds ran out; "
            "raise adjust.max-alternations"
        )
    return tuple(warnings)


def _torn_step_warnings(torn: tuple[TornStep, ...]) -> list[str]:
    """A sentence for each of the worst steps that the result does not keep, and one for the others."""
    warnings = [
        f"the step from frame {step.frames[0]} to {step.frames[1]} was changed from "
        f"{step.recorded_m:.2f} m as recorded to {step.solved_m:.2f} m ({step.sigmas:.0f} sigmas): "
        "tracking may have failed there, or matches or walls were mistaken; look at these frames"
        for step in torn[:MAX_TORN_STEPS]
    ]
    if len(torn) > MAX_TORN_STEPS:
        warnings.append(f"{len(torn) - MAX_TORN_STEPS} more steps were changed as much")
    return warnings
