"""The scan's alignment with the plan: what the search is given, and what its answer means."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from planfit.adjust import AdjustOptions, cost_on_plan, refit_scale
from planfit.adjust.association import wall_patches_in_plan
from planfit.alignment import (
    LOOK_WITHIN,
    Alignment,
    OtherScale,
    WallSamples,
    align_paper,
    find_half_thickness,
    find_plan_scale,
    find_unit,
    is_clearly_likelier,
    is_off,
    may_be_rescaled,
    metric_plan,
    read_control_points,
    sample_walls,
    thickness_finding,
)
from planfit.alignment import align as search_alignment
from planfit.alignment.options import AlignOptions, ControlPoint, RecordedAxes
from planfit.alignment.plan_scale import BETTER_SCORE
from planfit.alignment.selection import MIN_SCORE
from planfit.alignment.wall_thickness import THINNEST_M
from planfit.errors import FloorplanError, OptionError, ScanError
from planfit.findings import Finding, PlanKind
from planfit.floorplan import Floorplan
from planfit.floorplan.centre_lines import with_thickness
from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.pipeline.depth_unit import AS_READ, DepthUnit, in_unit
from planfit.pipeline.given import Given, require_given, running
from planfit.pipeline.observations import Observations, extract_observations
from planfit.pipeline.on_plan import ScanOnPlan
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.prepare import PreparedScan, prepare
from planfit.pipeline.storey_heights import settle_floors
from planfit.runtime import Runtime, StageTimer, short_repr
from planfit.scan import Scan
from planfit.segmentation import Structure
from planfit.tracking.numbered import MIN_DEPARTURE

UNKNOWN_SCALE_SIGMA = 0.05
"""Of a plan's scale that was searched, or found off: walls then say nothing of the metre. And of recorded
motion whose unit was found by images and depth."""
UNITS_AGREE = MIN_DEPARTURE
"""Factor within which two things that say how far depth is off say the same."""


@dataclass(frozen=True)
class AlignResult:
    """A scan's alignment with a plan, and the walls that it was found by."""

    alignment: Alignment
    walls: WallSamples
    plan_from_world: Float[np.ndarray, "4 4"]
    """To the plan in metres."""

    __repr__ = short_repr


def align(
    scan: Scan,
    floorplan: Floorplan,
    options: RefineOptions | None = None,
    runtime: Runtime | None = None,
    *,
    cache: str | Path | None = None,
    progress: bool = True,
) -> AlignResult:
    """Find where on the plan a scan is, without moving its poses against each other.

    The first half of `refine`: arguments and errors are the same.

    Raises:
        ScanError: a file of the scan cannot be used, or no wall was seen.
        FloorplanError: the plan is not in the unit that it claims, or its unit cannot be found.
        OptionError: an option has a value that cannot work.
    """
    require_given(scan, floorplan, options, runtime)
    with running(runtime, cache, progress) as runs:
        return _align(Given(scan, floorplan, options or RefineOptions(), runs), floorplan)


def _align(given: Given, floorplan: Floorplan) -> AlignResult:
    scan, chosen = given.scan, given.options
    timer = StageTimer(given.runtime)
    observations = extract_observations(scan, chosen, given.runtime, timer=timer)
    observations = observed_in_metres(given, observations, timer)
    scan = in_unit(scan, observations.depth_unit)
    _, prepared = settle_floors(scan, observations, chosen, timer)
    claimed = claimed_alignment(
        scan, floorplan, prepared.level_from_world, chosen.align.recorded_axes
    )
    alignment = find_alignment(prepared, floorplan, chosen, claimed)
    if alignment is None:
        raise ScanError(
            f"{scan.name}: expected walls to align the scan by, found none; give wall masks, or "
            "scan more of the walls"
        )
    _, alignment = with_thick_walls(prepared, floorplan, alignment, chosen, claimed)
    walls = wall_samples(prepared.measurements.structure, prepared.level_from_keys)
    return AlignResult(alignment, walls, alignment.plan_from_level @ prepared.level_from_world)


def observed_in_metres(given: Given, seen: Observations, timer: StageTimer) -> Observations:
    """What the scan shows, its depth in metres; the very same where nothing is in question.

    Where sizes and motion leave open whether depth or poses are in another unit, a plan in metres is asked:
    in the right unit its walls explain a fifth more of the scan.

    Args:
        seen: what the scan shows, depth as read.

    Raises:
        ScanError: it is open, and no plan in metres tells.
    """
    unit, floorplan = DepthUnit(seen.depth_unit.rival), given.floorplan
    if unit == AS_READ:
        return seen
    if not (isinstance(floorplan, Floorplan) and floorplan.is_metric):
        raise seen.depth_unit.undecided(given.scan)
    scan, options = in_unit(given.scan, unit), given.options
    other = extract_observations(
        scan, options, given.runtime, timer=timer, corrections=given.corrections
    )
    more = _explained(scan, other, floorplan, options) - _explained(
        given.scan, seen, floorplan, options
    )
    if abs(more) < BETTER_SCORE:
        raise seen.depth_unit.undecided(given.scan)
    return replace(other, depth_unit=unit) if more > 0 else replace(seen, depth_unit=AS_READ)


def _explained(
    scan: Scan, seen: Observations, floorplan: Floorplan, options: RefineOptions
) -> float:
    """Share of the scan's wall that the plan explains, at the scale that both have."""
    try:
        found = find_alignment(prepare(scan, seen, options), floorplan.used(), options)
    except (FloorplanError, ScanError):  # the plan fits in another unit than this
        return 0.0
    return 0.0 if found is None else found.score


def align_to_plan(
    scan: Scan,
    prepared: PreparedScan,
    floorplan: Floorplan,
    options: RefineOptions,
    timer: StageTimer,
    surveyed: Sequence[ControlPoint] = (),
) -> ScanOnPlan:
    """Align, bring the plan to metres, and refit a scale that was searched by all measurements.

    A plan in metres keeps its scale, exactly, unless the options allow another (`alignment/plan_scale.py`).

    Raises:
        FloorplanError: the plan fits in another unit than it claims, or its unit cannot be found.
    """
    with timer.stage("align"):
        claimed = claimed_alignment(
            scan, floorplan, prepared.level_from_world, options.align.recorded_axes
        )
        found = find_alignment(prepared, floorplan.used(), options, claimed, surveyed)
    if found is None:
        fallback = np.eye(4) if claimed is None else claimed
        return ScanOnPlan(floorplan, fallback, None, claimed)
    with timer.stage("align"):
        floorplan, found = with_thick_walls(prepared, floorplan, found, options, claimed, surveyed)
    if not floorplan.is_metric and found.is_sure and found.scale_sigma > 0:
        with timer.stage("refit scale"):
            found = with_refitted_scale(prepared, floorplan.used(), found, options.adjust)
    metric = metric_plan(floorplan, found.scale_xy)
    return ScanOnPlan(metric, found.plan_from_level, found, claimed)


def with_thick_walls(
    prepared: PreparedScan,
    floorplan: Floorplan,
    drawn: Alignment,
    options: RefineOptions,
    claimed: Float[np.ndarray, "4 4"] | None = None,
    surveyed: Sequence[ControlPoint] = (),
) -> tuple[Floorplan, Alignment]:
    """Plan and alignment, walls given the thickness that the scan shows where they are drawn by centre lines.

    The very same ones where they are not, or where that explains no more of the scan.

    Args:
        floorplan: as drawn, in its own unit.
        drawn: the alignment with it as drawn.
    """
    if options.align.method == "paper":
        return floorplan, drawn
    walls = wall_samples(prepared.measurements.structure, prepared.level_from_keys)

    def thickened(align_options: AlignOptions) -> tuple[Floorplan, Alignment] | None:
        half = find_half_thickness(walls, floorplan.used(), drawn, align_options)
        if half is None:
            return None
        thick = with_thickness(
            floorplan, half.half_m / half.metres_per_unit, THINNEST_M / half.metres_per_unit
        )
        held = replace(options, align=align_options)
        found = find_alignment(prepared, thick.used(), held, claimed, surveyed)
        if found is None:
            return None
        if floorplan.is_metric and not found.is_plan_rescaled and half.metres_per_unit != 1.0:
            # All measurements take the plan as drawn: so must the thickness.
            return thickened(replace(align_options, metric_scale_tolerance=0.0))
        if found.score < drawn.score and not drawn.is_plan_rescaled:
            return None
        told = (*found.findings, thickness_finding(half))
        return thick, replace(found, findings=told, half_thickness=half)

    return thickened(options.align) or (floorplan, drawn)


def with_refitted_scale(
    prepared: PreparedScan, floorplan: Floorplan, found: Alignment, options: AdjustOptions
) -> Alignment:
    """The alignment at the scale of the plan at which the walls strain all measurements least."""
    metric = metric_plan(floorplan, found.scale_xy)
    on_plan = found.plan_from_level @ prepared.level_from_keys
    refit = refit_scale(prepared.measurements, metric, on_plan, options)
    return found.rescaled(refit.factor, refit.sigma, on_plan[:, :2, 3].mean(axis=0))


def _with_other_scale(
    prepared: PreparedScan,
    floorplan: Floorplan,
    drawn: Alignment,
    scaled: Alignment,
    options: AdjustOptions,
) -> Alignment:
    """The alignment as drawn, told of another scale where all measurements find that clearly likelier."""
    cost_drawn, cost_scaled = (
        cost_on_plan(
            prepared.measurements,
            metric_plan(floorplan, found.scale_xy),
            found.plan_from_level @ prepared.level_from_keys,
            options,
        )
        for found in (drawn, scaled)
    )
    gain = cost_drawn - cost_scaled
    if not is_clearly_likelier(gain):
        return drawn
    other = OtherScale(scaled.metres_per_unit, scaled.scale_sigma, gain)
    return replace(drawn, other_scale=other)


def find_alignment(
    prepared: PreparedScan,
    floorplan: Floorplan,
    options: RefineOptions,
    claimed: Float[np.ndarray, "4 4"] | None = None,
    surveyed: Sequence[ControlPoint] = (),
) -> Alignment | None:
    """The scan's alignment by its walls; None where it shows none and the plan is in metres.

    Its scale is refitted here only where the plan claims metres. `surveyed` are control points besides those
    of the options.

    Raises:
        FloorplanError: the plan fits in another unit than it claims, or its unit cannot be found.
        ScanError: recorded motion and a plan in metres agree, and depth is in another unit.
    """
    walls = wall_samples(prepared.measurements.structure, prepared.level_from_keys)
    if len(walls.xy) == 0:
        if not floorplan.is_metric:
            raise FloorplanError(
                f"{floorplan.name}: expected a plan with a unit, as the scan shows no wall to find it "
                "by; give it with --unit or --scale"
            )
        return None
    chosen = options.align
    if chosen.method == "paper":
        points = scan_points(prepared.measurements.structure, prepared.level_from_keys)
        return align_paper(points, walls, floorplan, np.random.default_rng(0))
    control_points = (
        *read_control_points(chosen.control_points, prepared.level_from_world, floorplan),
        *surveyed,
    )
    drawn = search_alignment(walls, floorplan, chosen, claimed, control_points)
    slack = chosen.metric_scale_tolerance or LOOK_WITHIN
    scaled = find_plan_scale(walls, floorplan, drawn, chosen, slack, claimed, control_points)
    if scaled is not None:
        scaled = with_refitted_scale(prepared, floorplan, scaled, options.adjust)
        if is_off(scaled) and may_be_rescaled(chosen, scaled.metres_per_unit):
            return scaled
        if is_off(scaled):
            drawn = _with_other_scale(prepared, floorplan, drawn, scaled, options.adjust)
    unit = find_unit(walls, floorplan, drawn, chosen)
    if unit is not None:
        own = prepared.metres_per_pose_unit
        if own != 1.0 and 1 / UNITS_AGREE < unit[1] / own < UNITS_AGREE:
            raise ScanError(
                f"the scan's depth: expected metres, found it {own:.3g} times as long as both the recorded "
                f"motion and {floorplan.name} say: give --depth-scale (metres of one stored unit) "
                f"{1 / own:.3g} times what it is"
            )
        raise FloorplanError(
            f"{floorplan.name}: expected metres, found a plan of {floorplan.size[0]:.4g} x "
            f"{floorplan.size[1]:.4g} that fits the scan in {unit[0]}; "
            f"multiply its coordinates by {unit[1]:g}"
        )
    if control_points and drawn.score < MIN_SCORE:
        little = Finding(PlanKind.POINTS_LEAVE_LITTLE_WALL, {"wall_share": drawn.score})
        return replace(drawn, findings=(*drawn.findings, little))
    return drawn


def claimed_alignment(
    scan: Scan,
    floorplan: Floorplan,
    level_from_world: Float[np.ndarray, "4 4"],
    recorded_axes: RecordedAxes = "auto",
) -> Float[np.ndarray, "4 4"] | None:
    """plan_from_level where recorded poses are in the plan's axes, up to drift.

    Where only the scan's format says so, that is of its own plan, as drawn and in metres, or of arrays that
    the caller made: a picture or a drawing from elsewhere has an origin of its own.

    Raises:
        OptionError: the user says so of a scan or a plan that cannot have it.
    """
    axes, source = scan.plan_from_world_axes, floorplan.source
    cannot = axes is None or not floorplan.is_metric or source.is_mirrored
    if recorded_axes == "plan" and cannot:
        raise OptionError(
            "align.recorded-axes plan: expected poses of the FACaP layout and a plan in metres, not "
            f"mirrored, found {scan.name} and {floorplan.name}; give --align.start instead"
        )
    own = scan.floorplan_path
    is_own = own is not None and Path(floorplan.name).resolve() == own.resolve()
    is_elsewhere = bool(source.kind) and not is_own and recorded_axes == "auto"
    if axes is None or cannot or is_elsewhere or recorded_axes == "own":
        return None
    claimed = axes @ se3.inverse(level_from_world)
    claimed[2, 3] = 0.0  # the floor is at z = 0 in both frames
    return claimed


def wall_samples(structure: Structure, level_from_cams: Poses) -> WallSamples:
    """What the search is given: wall patches, seen from above, and from where."""
    normals, ends = wall_patches_in_plan(structure.walls, level_from_cams)
    eyes = level_from_cams[structure.walls.frame_idx][:, :2, 3]
    return sample_walls(normals, ends, seen_from=eyes)


def scan_points(structure: Structure, level_from_cams: Poses) -> Float[np.ndarray, "m 3"]:
    """All points of floor and walls, m, level frame, for the paper's alignment."""
    parts = (
        (structure.floor.points_cam, structure.floor.frame_idx),
        (structure.walls.points_cam, structure.walls.point_frame_idx),
        (structure.unassigned_points_cam, structure.unassigned_frame_idx),
    )
    return np.concatenate(
        [se3.transform_each(level_from_cams[frame], points) for points, frame in parts]
    )
