"""One scan of the benchmark, made ready to be refined in many ways, and the metrics of each."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from drawn_plans.habits import drawn_plan
from jaxtyping import Float

from paper_tables.results import Measured
from paper_tables.scans import BenchScan
from paper_tables.variants import Variant
from planfit.adjust import adjust_to_plan
from planfit.errors import PlanfitError, ScanError
from planfit.evaluation import (
    MapJudge,
    MapOptions,
    floor_heights,
    make_map_judge,
    make_true_cloud,
    position_errors,
    sample_depth_maps,
    wall_distances,
    wall_layers,
)
from planfit.evaluation.map_quality import thin
from planfit.floorplan import Floorplan, read_floorplan
from planfit.pipeline.align import align_to_plan
from planfit.pipeline.observations import Observations, extract_observations
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.prepare import prepare
from planfit.pipeline.refine import refine
from planfit.runtime import Runtime, StageTimer
from planfit.scan import Scan, read_scan, read_tum
from planfit.synth import NoDepthNoise, make_scan

MAP = MapOptions(frame_step=2)
"""Points that maps are judged by: of every second frame, one in a voxel of 5 cm, radius 0.2 m."""
_TRUE_FRAME_STEP = 5
_TRUE_SPACING_M = 0.03


@dataclass(frozen=True)
class Case:
    """A scan, what was extracted from it, and the truth about it."""

    set_name: str
    name: str
    scan: Scan
    floorplan: Floorplan
    lambda_walls: float
    true_plan_from_cams: Float[np.ndarray, "n 4 4"]
    observations: Observations
    judge: MapJudge


def load_case(bench_scan: BenchScan, runtime: Runtime) -> Case:
    """Render a synthetic scan, extract its observations, and sample the points its map is judged by."""
    synthetic = make_scan(bench_scan.synth)
    plan = synthetic.floorplan
    if bench_scan.habits is not None:
        rng = np.random.default_rng([bench_scan.synth.seed, 1])
        plan = drawn_plan(synthetic.building, bench_scan.habits, rng)
    clean = make_scan(replace(bench_scan.synth, depth_noise=NoDepthNoise()))
    true_map = replace(MAP, frame_step=_TRUE_FRAME_STEP, voxel_m=_TRUE_SPACING_M)
    points = sample_depth_maps(clean.scan, true_map, runtime).at(synthetic.true_plan_from_cams)
    cloud = make_true_cloud(thin(points, _TRUE_SPACING_M), normal_radius_m=0.1)
    scan = synthetic.scan
    return Case(
        set_name=bench_scan.set_name,
        name=bench_scan.name,
        scan=scan,
        floorplan=plan,
        lambda_walls=bench_scan.lambda_walls,
        true_plan_from_cams=synthetic.true_plan_from_cams,
        observations=extract_observations(scan, RefineOptions(), runtime),
        judge=make_map_judge(scan, MAP, runtime, cloud),
    )


def load_real_case(folder: Path, runtime: Runtime) -> Case:
    """A scan in files whose format records poses in the plan's axes, with its plan and `groundtruth.tum`.

    Raises:
        ScanError: a file is missing, or the scan's axes are not those of its plan.
        FloorplanError: the plan cannot be read.
    """
    scan = read_scan(folder)
    if scan.floorplan_path is None or scan.plan_from_world_axes is None:
        raise ScanError(
            f"{folder}: expected a scan with its floorplan, in the plan's axes (FACaP layout), found "
            "another; give a folder with floorplan.npy and poses in its axes"
        )
    times, poses = read_tum(folder / "groundtruth.tum")
    if len(times) != len(scan):
        raise ScanError(
            f"{folder / 'groundtruth.tum'}: expected a pose of each of {len(scan)} frames, found "
            f"{len(times)}"
        )
    return Case(
        set_name="real",
        name=folder.name,
        scan=scan,
        floorplan=read_floorplan(scan.floorplan_path),
        lambda_walls=0.5,
        true_plan_from_cams=scan.plan_from_world_axes @ poses,
        observations=extract_observations(scan, RefineOptions(), runtime),
        judge=make_map_judge(scan, replace(MAP, frame_step=1), runtime),
    )


def measure(case: Case, variant: Variant, runtime: Runtime) -> Measured:
    """Refine a scan in one way, and take all metrics. A run that refuses is recorded with its reason."""
    if variant.has_true_poses:
        metrics = _of_map(case, case.true_plan_from_cams, runtime.workers)
        return Measured(case.set_name, case.name, variant.key, metrics)
    if variant.is_descent:
        return _measure_descent(case, variant, runtime)
    try:
        result = refine(
            case.scan,
            case.floorplan,
            variant.options(case.lambda_walls),
            runtime,
            case.observations,
        )
    except PlanfitError as error:
        return Measured(case.set_name, case.name, variant.key, {}, failed=str(error))
    metrics: dict[str, float] = {}
    poses = result.initial_plan_from_cams
    if variant.change is not None:
        poses = result.plan_from_cams
        metrics["solve_s"] = result.seconds_by_stage["adjust"]
        metrics["step_ms"] = 1e3 * metrics["solve_s"] / max(1, result.adjustment.iterations)
        metrics["solve_s"] += result.seconds_by_stage.get("close loops", 0.0)
    metrics |= _of_map(case, poses, runtime.workers)
    errors = position_errors(poses, case.true_plan_from_cams)
    metrics |= {"ate": errors.rms_m, "ate_aligned": errors.aligned_rms_m}
    return Measured(case.set_name, case.name, variant.key, metrics, result.warnings)


def _measure_descent(case: Case, variant: Variant, runtime: Runtime) -> Measured:
    """The stages of a run but for its verdict, whose solves would be five more descents of minutes each."""
    options, timer = variant.options(case.lambda_walls), StageTimer(runtime)
    try:
        prepared = prepare(case.scan, case.observations, options, timer)
        on_plan = align_to_plan(case.scan, prepared, case.floorplan, options, timer)
        with timer.stage("adjust"):
            start = on_plan.plan_from_level @ prepared.level_from_keys
            adjusted = adjust_to_plan(
                prepared.measurements, on_plan.floorplan, start, options.adjust
            )
    except PlanfitError as error:
        return Measured(case.set_name, case.name, variant.key, {}, failed=str(error))
    seconds, poses = timer.seconds["adjust"], adjusted.solution.target_from_cams
    errors = position_errors(poses, case.true_plan_from_cams)
    metrics = _of_map(case, poses, runtime.workers) | {
        "solve_s": seconds,
        "step_ms": 1e3 * seconds / max(1, adjusted.iterations),
        "ate": errors.rms_m,
        "ate_aligned": errors.aligned_rms_m,
    }
    return Measured(case.set_name, case.name, variant.key, metrics)


def _of_map(case: Case, poses: Float[np.ndarray, "n 4 4"], workers: int) -> dict[str, float]:
    """Metrics that need no true poses; those that could not be taken are absent."""
    metrics = case.judge.values(poses, workers) | _against_plan(case, poses, workers)
    return {name: float(value) for name, value in metrics.items() if np.isfinite(value)}


def _against_plan(case: Case, poses: Float[np.ndarray, "n 4 4"], workers: int) -> dict[str, float]:
    structure = case.observations.structure
    walls = wall_distances(structure, case.floorplan, poses, workers)
    floor = floor_heights(structure, poses)
    metrics = {"double_walls": 100 * wall_layers(structure.walls, poses).double_share}
    if walls is not None:
        metrics |= {"nsd": 100 * walls.nsd_m, "nsd_oriented": 100 * walls.oriented_nsd_m}
    if floor is not None:
        metrics["floor_plane_rms"] = 100 * floor.plane_rms_m
    return metrics
