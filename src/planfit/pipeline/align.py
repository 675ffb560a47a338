"""The scan's place on the plan: what the alignment is given, and what its answer means."""

import dataclasses

import numpy as np

from planfit.adjust.association import wall_patches_in_plan
from planfit.align import (
    Alignment,
    AlignOptions,
    WallSamples,
    align,
    align_paper,
    find_unit,
    place_control_points,
    sample_walls,
)
from planfit.errors import FloorplanError, require_plain_numbers
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.prepare import Prepared, extract_observations, prepare
from planfit.runtime import Runtime, StageTimer
from planfit.scan import Scan
from planfit.segmentation import Structure


def align_scan(
    scan: Scan,
    floorplan: Floorplan,
    options: RefineOptions | None = None,
    runtime: Runtime | None = None,
) -> tuple[Alignment, WallSamples] | None:
    """The scan's place on the plan and the walls that it was found by; None where no wall was seen.

    The first half of `refine`: arguments and errors are the same.
    """
    options, runtime = options or RefineOptions(), runtime or Runtime()
    require_plain_numbers(options)
    if not scan.fingerprint:
        runtime = dataclasses.replace(runtime, cache_dir=None)
    timer = StageTimer(runtime)
    prepared = prepare(scan, extract_observations(scan, options, runtime, timer), options, timer)
    claimed = claimed_alignment(scan, floorplan, prepared.level_from_world)
    alignment = place(prepared, floorplan, options.align, claimed)
    if alignment is None:
        return None
    return alignment, wall_samples(prepared.measurements.structure, prepared.level_from_keys)


def place(
    prepared: Prepared,
    floorplan: Floorplan,
    options: AlignOptions,
    claimed: np.ndarray | None = None,
) -> Alignment | None:
    """The scan's place on the plan, by its walls; None where it shows none and the plan is in metres.

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
    control_points = place_control_points(
        options.control_points, prepared.level_from_world, floorplan
    )
    alignment = align(walls, floorplan, options, claimed, control_points)
    found = find_unit(walls, floorplan, alignment, options)
    if found is not None:
        raise FloorplanError(
            f"{floorplan.name}: expected metres, found a plan of {floorplan.size[0]:.4g} x "
            f"{floorplan.size[1]:.4g} that fits the scan in {found[0]}; "
            f"multiply its coordinates by {found[1]:g}"
        )
    return alignment


def claimed_alignment(
    scan: Scan, floorplan: Floorplan, level_from_world: np.ndarray
) -> np.ndarray | None:
    """plan_from_level (4, 4) where the scan's format records poses in the plan's axes.

    That says nothing of a plan whose unit is unknown, or which is not taken as it was drawn.
    """
    if scan.plan_from_world_axes is None or not floorplan.is_metric or floorplan.source.is_mirrored:
        return None
    claimed = scan.plan_from_world_axes @ se3.inverse(level_from_world)
    claimed[2, 3] = 0.0  # the floor is at z = 0 in both frames
    return claimed


def wall_samples(structure: Structure, level_from_cams: np.ndarray) -> WallSamples:
    """What the alignment is given: pieces of wall, seen from above, and from where."""
    normals, ends = wall_patches_in_plan(structure.walls, level_from_cams)
    eyes = level_from_cams[structure.walls.frame_idx][:, :2, 3]
    return sample_walls(normals, ends, seen_from=eyes)


def scan_points(structure: Structure, level_from_cams: np.ndarray) -> np.ndarray:
    """All points (n, 3) m of floor and walls, level frame, for the paper's alignment."""
    parts = (
        (structure.floor.points_cam, structure.floor.frame_idx),
        (structure.walls.points_cam, structure.walls.point_frame_idx),
        (structure.unassigned_points_cam, structure.unassigned_frame_idx),
    )
    return np.concatenate(
        [se3.transform_each(level_from_cams[frame], points) for points, frame in parts]
    )
