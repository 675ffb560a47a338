"""What a user should know before trusting a result, from the scan, the alignment and the solve."""

import numpy as np
from jaxtyping import Int

from planfit.adjust import PlanAdjustment, TornStep, moved_wall_findings
from planfit.alignment import MENDED_BY_WALLS, Alignment
from planfit.findings import Finding, PlanKind, ResultKind, ScanKind
from planfit.findings.finding import FEW_NAMED
from planfit.matching import Matches, SurfacePairs
from planfit.pipeline.on_plan import Storeys
from planfit.pipeline.validation import Check
from planfit.scan import Scan
from planfit.segmentation import Gravity, Structure

MIN_NEAR_SHARE = {"masks": 0.75, "geometry": 0.5, "learned": 0.5}
"""Share of wall points that should lie near the plan in the end, by where labels come from. Right plans
leave 0.86 to 1.00 with masks; geometry takes tall furniture for wall and leaves 0.64 to 0.90."""

MAX_TORN_STEPS = FEW_NAMED
"""Torn steps that are named one by one."""


NO_SURFACES = SurfacePairs.none()


def scan_findings(
    scan: Scan,
    gravity: Gravity,
    structure: Structure,
    matches: Matches,
    neighbours: int,
    has_plan: bool = True,
    surfaces: SurfacePairs = NO_SURFACES,
    keyframe_idx: Int[np.ndarray, " k"] | None = None,
) -> tuple[Finding, ...]:
    """What the scan shows; walls are missed only where there is a plan to hold them to."""
    found = []
    if len(scan) < 20:
        found.append(Finding(ScanKind.FEW_FRAMES, {"frame_count": len(scan)}))
    if gravity.confidence < 0.05:
        facts = {"confidence": gravity.confidence, "source": gravity.source}
        found.append(Finding(ScanKind.GRAVITY_UNSURE, facts))
    if not structure.has_floor:
        found.append(Finding(ScanKind.NO_FLOOR))
    if structure.floor_pieces:
        heights_m, slopes = zip(*structure.floor_pieces, strict=True)
        facts = {"heights_m": heights_m, "slopes": slopes}
        found.append(Finding(ScanKind.FLOOR_NOT_LEVEL, facts))
    if structure.drifted_floors_m:
        found.append(Finding(ScanKind.FLOOR_DRIFTED, {"floors_m": structure.drifted_floors_m}))
    if has_plan and not structure.has_walls:
        found.append(Finding(ScanKind.NO_WALL))
    if not scan.has_color:
        found.append(Finding(ScanKind.NO_COLOUR, parts=(surfaces.finding,)))
    if matches.n_matches == 0 and len(surfaces) == 0:
        facts = {"has_plan": has_plan, "has_colour": scan.has_color}
        found.append(Finding(ScanKind.NO_MATCHES, facts))
    elif sum(seen.n_loops(neighbours, keyframe_idx) for seen in (matches, surfaces)) == 0:
        found.append(Finding(ScanKind.NO_LOOPS, {"has_plan": has_plan}))
    return tuple(found)


def alignment_findings(
    alignment: Alignment | None,
    is_alignment_claimed: bool,
    plan_adjustment: PlanAdjustment,
    structure: Structure,
    checks: tuple[Check, ...],
    is_place_sure: bool,
    has_rival: bool,
) -> tuple[Finding, ...]:
    """How scan and plan came together.

    What was said of a deformed scan before the adjustment is left out where the adjusted walls surely lie on
    the plan (`is_place_sure`). Where the scan fits elsewhere about as well, if other walls were moved
    (`has_rival`), no wall is said to be: the verdict tells both.
    """
    found: list[Finding] = []
    if alignment is not None:
        mended = MENDED_BY_WALLS if is_place_sure else ()
        found += [each for each in alignment.all_findings if each.kind not in mended]
    if alignment is None and not is_alignment_claimed:
        found.append(Finding(PlanKind.NOT_ALIGNED))
    near = next((check.after for check in checks if check.unit == "share"), 1.0)
    if near < MIN_NEAR_SHARE[structure.back_end]:
        facts = {"near_share": near, "patch_count": len(structure.walls)}
        facts |= {"associated_count": plan_adjustment.association.n_associated}
        found.append(Finding(ResultKind.FEW_WALLS_NEAR_PLAN, facts))
    are_moved = plan_adjustment.moved_walls and not has_rival
    if are_moved and plan_adjustment.correspondences is not None:
        floorplan = plan_adjustment.correspondences.floorplan
        found.append(walls_moved(moved_wall_findings(plan_adjustment.moved_walls, floorplan)))
    return (*found, *adjustment_findings(plan_adjustment))


def walls_moved(walls: tuple[Finding, ...]) -> Finding:
    """All moved walls as one finding."""
    faces = tuple(face for wall in walls for face in wall.faces)
    return Finding(ResultKind.WALLS_MOVED, faces=faces, parts=walls)


def storey_findings(storeys: Storeys) -> tuple[Finding, ...]:
    """Plans by storey: which were not used, which are missed, and what their alignments say (that of the
    lowest one aside, which `alignment_findings` has)."""
    found = [
        Finding(ResultKind.STOREY_NOT_WALKED, {"storey_number": number})
        for number in storeys.not_walked
    ]
    found += [
        Finding(ResultKind.STOREY_WITHOUT_PLAN, {"storey": storey.name}, storey.frames)
        for storey in storeys.without_plan
    ]
    for k in list(storeys.with_plan)[1:]:
        own, name = storeys.with_plan[k], storeys.walked[k].name
        found += [each.about(name) for each in own.alignment.all_findings]
    return tuple(found)


def adjustment_findings(plan_adjustment: PlanAdjustment) -> tuple[Finding, ...]:
    """How the solve went."""
    found = [*plan_adjustment.weakly_constrained, *_changed_steps(plan_adjustment.torn_steps)]
    if not plan_adjustment.converged:
        found.append(Finding(ResultKind.ROUNDS_RAN_OUT))
    return tuple(found)


def _changed_steps(torn: tuple[TornStep, ...]) -> list[Finding]:
    """Each of the worst steps that the result does not keep, and how many others there are."""
    found = [
        Finding(
            ResultKind.STEP_CHANGED,
            {"recorded_m": step.recorded_m, "solved_m": step.solved_m, "sigmas": step.sigmas},
            (step.frames,),
        )
        for step in torn[:MAX_TORN_STEPS]
    ]
    if len(torn) > MAX_TORN_STEPS:
        more = {"step_count": len(torn) - MAX_TORN_STEPS}
        found.append(Finding(ResultKind.MORE_STEPS_CHANGED, more))
    return found
