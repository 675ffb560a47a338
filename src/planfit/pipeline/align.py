"""The scan's alignment with the plan: what the search is given, and what its answer means."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from planfit.adjust import refit_scale
from planfit.adjust.association import wall_patches_in_plan
from planfit.alignment import (
    Alignment,
    AlignOptions,
    WallSamples,
    align_paper,
    find_unit,
    metric_plan,
    read_control_points,
    sample_walls,
)
from planfit.alignment import align as search_alignment
from planfit.errors import FloorplanError, ScanError
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.prepare import PreparedScan, extract_observations, prepare
from planfit.runtime import Runtime, StageTimer
from planfit.scan import Scan
from planfit.segmentation import Structure


@dataclass(frozen=True)
class ScanOnPlan:
    """Where a prepared scan stands on its plan; or without one, in the level frame."""

    floorplan: Floorplan | None
    """In metres, at the scale that was found where it had no unit; None where the scan stands alone."""
    plan_from_level: Float[np.ndarray, "4 4"]
    """The identity where there is no plan, or the scan shows no wall and its format claims nothing."""
    alignment: Alignment | None
    """None where no wall was seen."""
    claimed_plan_from_level: Float[np.ndarray, "4 4"] | None
    """What the scan's format claims, if it does."""

    @property
    def recorded_plan_from_level(self) -> Float[np.ndarray, "4 4"]:
        """For the poses as recorded: what the format claims where nothing contradicts it."""
        is_as_recorded = self.alignment is None or self.alignment.is_as_recorded
        if self.claimed_plan_from_level is not None and is_as_recorded:
            return self.claimed_plan_from_level
        return self.plan_from_level


STANDS_ALONE = ScanOnPlan(None, np.eye(4), None, None)
"""Where there is no plan: what is called the plan frame elsewhere is then the level frame."""


@dataclass(frozen=True)
class AlignResult:
    """A scan's alignment with a plan, and the walls that it was found by."""

    alignment: Alignment
    walls: WallSamples
    plan_from_world: Float[np.ndarray, "4 4"]
    """To the plan in metres."""


def align(
    scan: Scan,
    floorplan: Floorplan,
    options: RefineOptions | None = None,
    runtime: Runtime | None = None,
) -> AlignResult:
    """Find where on the plan a scan is, without moving its poses against each other.

    The first half of `refine`: arguments and errors are the same.

    Raises:
        ScanError: a file of the scan cannot be used, or no wall was seen.
        FloorplanError: the plan is not in the unit that it claims, or its unit cannot be found.
        OptionError: an option has a value that cannot work.
    """
    chosen = options or RefineOptions()
    timer = StageTimer(runtime or Runtime())
    observations = extract_observations(scan, chosen, runtime, timer=timer)
    prepared = prepare(scan, observations, chosen, timer)
    claimed = claimed_alignment(scan, floorplan, prepared.level_from_world)
    alignment = find_alignment(prepared, floorplan, chosen.align, claimed)
    if alignment is None:
        raise ScanError(
            f"{scan.name}: expected walls to align the scan by, found none; give wall masks, or "
            "scan more of the walls"
        )
    walls = wall_samples(prepared.measurements.structure, prepared.level_from_keys)
    return AlignResult(alignment, walls, alignment.plan_from_level @ prepared.level_from_world)


def align_to_plan(
    scan: Scan,
    prepared: PreparedScan,
    floorplan: Floorplan,
    options: RefineOptions,
    timer: StageTimer,
) -> ScanOnPlan:
    """Align, bring the plan to metres, and refit a scale that was searched by all measurements.

    Raises:
        FloorplanError: the plan fits in another unit than it claims, or its unit cannot be found.
    """
    with timer.stage("align"):
        claimed = claimed_alignment(scan, floorplan, prepared.level_from_world)
        found = find_alignment(prepared, floorplan, options.align, claimed)
    if found is None:
        fallback = np.eye(4) if claimed is None else claimed
        return ScanOnPlan(floorplan, fallback, None, claimed)
    metric = floorplan if floorplan.is_metric else metric_plan(floorplan, found.scale_xy)
    if not (found.is_sure and found.scale_sigma > 0):
        return ScanOnPlan(metric, found.plan_from_level, found, claimed)
    with timer.stage("refit scale"):
        on_plan = found.plan_from_level @ prepared.level_from_keys
        refit = refit_scale(prepared.measurements, metric, on_plan, options.adjust)
        middle = on_plan[:, :2, 3].mean(axis=0)
        rescaled = found.rescaled(refit.factor, refit.sigma, middle)
    return ScanOnPlan(metric.scaled(refit.factor), rescaled.plan_from_level, rescaled, claimed)


def find_alignment(
    prepared: PreparedScan,
    floorplan: Floorplan,
    options: AlignOptions,
    claimed: Float[np.ndarray, "4 4"] | None = None,
) -> Alignment | None:
    """The scan's alignment by its walls; None where it shows none and the plan is in metres.

    Raises:
        FloorplanError: the plan fits in another unit than it claims, or its unit cannot be found.
    """
    walls = wall_samples(prepared.measurements.structure, prepared.level_from_keys)
    if len(walls.xy) == 0:
        if not floorplan.is_metric:
            raise FloorplanError(
                f"{floorplan.name}: expected a plan with a unit, as the scan shows no wall to find it "
                "by; give it with --unit or --scale"
            )
        return None
    if options.method == "paper":
        points = scan_points(prepared.measurements.structure, prepared.level_from_keys)
        return align_paper(points, walls, floorplan, options, np.random.default_rng(0))
    control_points = read_control_points(
        options.control_points, prepared.level_from_world, floorplan
    )
    alignment = search_alignment(walls, floorplan, options, claimed, control_points)
    unit = find_unit(walls, floorplan, alignment, options)
    if unit is not None:
        raise FloorplanError(
            f"{floorplan.name}: expected metres, found a plan of {floorplan.size[0]:.4g} x "
            f"{floorplan.size[1]:.4g} that fits the scan in {unit[0]}; "
            f"multiply its coordinates by {unit[1]:g}"
        )
    return alignment


def claimed_alignment(
    scan: Scan, floorplan: Floorplan, level_from_world: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "4 4"] | None:
    """plan_from_level where the scan's format records poses in the plan's axes.

    That says nothing of a plan whose unit is unknown, or which is not taken as it was drawn.
    """
    if scan.plan_from_world_axes is None or not floorplan.is_metric or floorplan.source.is_mirrored:
        return None
    claimed = scan.plan_from_world_axes @ se3.inverse(level_from_world)
    claimed[2, 3] = 0.0  # the floor is at z = 0 in both frames
    return claimed


def wall_samples(structure: Structure, level_from_cams: Float[np.ndarray, "n 4 4"]) -> WallSamples:
    """What the search is given: wall patches, seen from above, and from where."""
    normals, ends = wall_patches_in_plan(structure.walls, level_from_cams)
    eyes = level_from_cams[structure.walls.frame_idx][:, :2, 3]
    return sample_walls(normals, ends, seen_from=eyes)


def scan_points(
    structure: Structure, level_from_cams: Float[np.ndarray, "n 4 4"]
) -> Float[np.ndarray, "m 3"]:
    """All points of floor and walls, m, level frame, for the paper's alignment."""
    parts = (
        (structure.floor.points_cam, structure.floor.frame_idx),
        (structure.walls.points_cam, structure.walls.point_frame_idx),
        (structure.unassigned_points_cam, structure.unassigned_frame_idx),
    )
    return np.concatenate(
        [se3.transform_each(level_from_cams[frame], points) for points, frame in parts]
    )
