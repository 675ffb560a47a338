"""The way a user would go without planfit: Open3D's pose graph, then ICP of walls and floor to the plan.

    python benchmarks/without_planfit.py [--only conslam kitchen synthetic] [--json FILE]

Both get the same: recorded steps with their sigmas, and the same verified pairs. Open3D's global
optimisation with its line process switches off pairs that do not agree (Choi, Zhou, Koltun 2015); each
pair is an edge with the rigid motion of its matches and their information, each recorded step one that is
certain. Of the preferences for loop closures that Open3D's own reconstruction system has, 0.1 and 5, the
better one by truth is taken. Then the points of walls and floor, all frames as one cloud, are registered
with the plan, extruded to a storey's height, and its floor: ICP, point to plane, within 1, 0.5 and 0.2 m.
ICP begins where planfit's result is: the pose graph's trajectory laid upon it, so that nothing is held
against it that a search would find.

The kitchen has no plan: the pose graph alone against `refine` without a plan, both after rigid alignment,
and drift of our own (seed 0, as `benchmarks/no_plan.py`). Synthetic scans are the first of each set of the
paper's tables. Times are CPU seconds of the process from verified pairs on; planfit's search of the
alignment and its verdict, which the other way has not, stand apart.
"""

import argparse
import json
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import open3d as o3d
from inputs import CONSLAM
from records import Record, cpu_seconds, machine

import planfit
from paper_tables.measure import load_case
from paper_tables.scans import paper_scans
from planfit.adjust import adjust_to_plan
from planfit.evaluation import position_errors
from planfit.floorplan import Floorplan
from planfit.geometry import se3, segments
from planfit.pipeline.align import align_to_plan
from planfit.pipeline.observations import Observations, extract_observations
from planfit.pipeline.on_plan import STANDS_ALONE
from planfit.pipeline.prepare import prepare
from planfit.runtime import Runtime, StageTimer
from planfit.scan import Scan, read_tum
from planfit.scan.formats.facap import PLAN_FROM_WORLD
from planfit.segmentation import SegmentationOptions, Structure, find_gravity
from planfit.synth import DriftOptions, drift_poses

registration = o3d.pipelines.registration
PREFERENCES = (0.1, 5.0)
MAX_CORRESPONDENCE_M = 0.07
"""Of the line process: 1.4 voxels of 5 cm, as Open3D's reconstruction system has it."""
ICP_DISTANCES_M = (1.0, 0.5, 0.2)
VOXEL_M = 0.05
HEIGHT_M = 2.6


@dataclass(frozen=True)
class Case:
    """A scan, its plan or none, and the truth: in the plan's frame, or in any where there is no plan."""

    name: str
    scan: Scan
    floorplan: Floorplan | None
    true_poses: np.ndarray  # (n, 4, 4)
    observations: Observations


@dataclass(frozen=True)
class Way:
    """Poses, and the CPU time that they took."""

    poses: np.ndarray  # (n, 4, 4)
    cpu_s: float


def conslam() -> Case:
    scan = planfit.read_scan(CONSLAM)
    assert scan.floorplan_path is not None
    _, true = read_tum(CONSLAM / "groundtruth.tum")
    floorplan = planfit.read_floorplan(scan.floorplan_path)
    return _case("ConSLAM", scan, floorplan, PLAN_FROM_WORLD @ true, planfit.RefineOptions())


def kitchen() -> Case:
    scan = planfit.read_scan(CONSLAM.parent / "kitchen")
    options = planfit.RefineOptions(segmentation=SegmentationOptions(back_end="geometry"))
    up = find_gravity(scan, Runtime()).up_world
    given = scan.world_from_cams
    drifted = drift_poses(given, DriftOptions(), np.random.default_rng(0), up)
    return _case("kitchen", replace(scan, world_from_cams=drifted), None, given, options)


def synthetic(set_name: str) -> Case:
    first = next(scan for scan in paper_scans() if scan.set_name == set_name)
    found = load_case(first, Runtime())
    truth = found.true_plan_from_cams
    return Case(first.name, found.scan, found.floorplan, truth, found.observations)


CASES: dict[str, tuple[Callable[[], Case], ...]] = {
    "conslam": (conslam,),
    "kitchen": (kitchen,),
    "synthetic": (lambda: synthetic("redwood-like"), lambda: synthetic("phone-like")),
}


def compare(case: Case) -> dict[str, float | str]:
    """Errors (m) and CPU times (s) of both ways."""
    ours, search_s = _with_planfit(case)
    graphs = [_pose_graph(case.observations, preference) for preference in PREFERENCES]
    graph = min(graphs, key=lambda way: _aligned_m(way.poses, case))
    row: dict[str, float | str] = {
        "scan": case.name,
        "frames": len(case.scan),
        "pairs": len(case.observations.matches.pairs),
        "recorded_aligned_m": _aligned_m(case.scan.world_from_cams, case),
        "graph_aligned_m": _aligned_m(graph.poses, case),
        "graph_s": graph.cpu_s,
        "planfit_aligned_m": _aligned_m(ours.poses, case),
        "planfit_s": ours.cpu_s,
        "planfit_search_s": search_s,
    }
    if case.floorplan is not None:
        laid = se3.fit_rigid(graph.poses[:, :3, 3], ours.poses[:, :3, 3])
        icp = _icp(case.observations.structure, case.floorplan, laid @ graph.poses)
        row |= {
            "icp_m": position_errors(icp.poses, case.true_poses).rms_m,
            "icp_s": icp.cpu_s,
            "planfit_m": position_errors(ours.poses, case.true_poses).rms_m,
        }
    return row


def records() -> list[Record]:
    """Of every scan that is at hand."""
    made = []
    for name, makers in CASES.items():
        if name != "synthetic" and not CONSLAM.exists():
            print(f"open3d: {name} left out, {CONSLAM.parent} is absent (set PLANFIT_SHARED)")
            continue
        for make in makers:
            made += _records_of(compare(make()))
    return made


def _records_of(row: dict) -> list[Record]:
    conditions = (
        f"{row['scan']}: {row['frames']} frames, {row['pairs']} pairs; {row['recorded_aligned_m']:.3f} m as "
        f"recorded, after rigid alignment; search of the alignment and all before it apart "
        f"({row['planfit_search_s']:.1f} s CPU); {machine()}"
    )
    units = {"m": "m", "s": "s"}
    skipped = ("scan", "frames", "pairs", "recorded_aligned_m", "planfit_search_s")
    return [
        Record(f"{name}, {row['scan']}", value, units[name[-1]], conditions)
        for name, value in row.items()
        if name not in skipped
    ]


def _case(
    name: str,
    scan: Scan,
    floorplan: Floorplan | None,
    true_poses: np.ndarray,
    options: planfit.RefineOptions,
) -> Case:
    with tempfile.TemporaryDirectory() as cache:
        observations = extract_observations(scan, options, Runtime(cache_dir=Path(cache)))
    return Case(name, scan, floorplan, true_poses, observations)


def _aligned_m(poses: np.ndarray, case: Case) -> float:
    return position_errors(poses, case.true_poses).aligned_rms_m


def _with_planfit(case: Case) -> tuple[Way, float]:
    """planfit's poses from the same observations, and the CPU time (s) of the alignment's search."""
    options, timer = planfit.RefineOptions(), StageTimer(Runtime())
    loops_s, prepared = cpu_seconds(lambda: prepare(case.scan, case.observations, options, timer))
    search_s, on_plan = 0.0, STANDS_ALONE
    floorplan = case.floorplan
    if floorplan is not None:
        search_s, on_plan = cpu_seconds(
            lambda: align_to_plan(case.scan, prepared, floorplan, options, timer)
        )
    start = on_plan.plan_from_level @ prepared.level_from_keys
    adjust_s, adjusted = cpu_seconds(
        lambda: adjust_to_plan(
            prepared.measurements, on_plan.floorplan, start, options.adjust
        )
    )  # fmt: skip
    return Way(adjusted.solution.target_from_cams, loops_s + adjust_s), search_s


def _pose_graph(observations: Observations, preference: float) -> Way:
    """Open3D's global optimisation; making the edges' motions and information counts."""
    tracking, matches = observations.tracking, observations.matches
    assert tracking is not None
    cpu, graph = time.process_time(), registration.PoseGraph()
    for pose in tracking.world_from_cams:
        graph.nodes.append(registration.PoseGraphNode(pose))
    odometry = tracking.odometry
    for k, step in enumerate(odometry.cam_from_next):
        sigmas = np.repeat([odometry.sigma_rotation[k], odometry.sigma_translation[k]], 3)
        certain = registration.PoseGraphEdge(k + 1, k, step, np.diag(sigmas**-2.0), False)
        graph.edges.append(certain)
    for k, (i, j) in enumerate(matches.pairs.tolist()):
        part = slice(matches.start[k], matches.start[k + 1])
        a, b = matches.points_a[part].astype(float), matches.points_b[part].astype(float)
        weights = matches.sigma[part].astype(float) ** -2.0
        edge = se3.fit_rigid(b, a, weights), _information(a, weights)
        graph.edges.append(registration.PoseGraphEdge(j, i, *edge, True))
    registration.global_optimization(
        graph,
        registration.GlobalOptimizationLevenbergMarquardt(),
        registration.GlobalOptimizationConvergenceCriteria(),
        registration.GlobalOptimizationOption(
            max_correspondence_distance=MAX_CORRESPONDENCE_M,
            edge_prune_threshold=0.25,
            preference_loop_closure=preference,
            reference_node=0,
        ),
    )
    poses = np.stack([node.pose for node in graph.nodes])
    return Way(poses, time.process_time() - cpu)


def _information(points: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Sum of w G^T G (6, 6), G = [-[p]x, I], rotation first: as Open3D's own, with sigmas."""
    rows = np.zeros((len(points), 3, 6))
    rows[:, :, :3] = -se3.skew(points)
    rows[:, :, 3:] = np.eye(3)
    return np.einsum("kia,k,kib->ab", rows, weights, rows)


def _icp(structure: Structure, floorplan: Floorplan, plan_from_cams: np.ndarray) -> Way:
    """The whole scan moved onto the plan."""
    cpu = time.process_time()
    walls = se3.transform_each(
        plan_from_cams[structure.walls.point_frame_idx], structure.walls.points_cam
    )
    floor = se3.transform_each(
        plan_from_cams[structure.floor.frame_idx], structure.floor.points_cam
    )
    source = _cloud(np.concatenate([walls, floor])).voxel_down_sample(VOXEL_M)
    target, moved = _extruded(floorplan), np.eye(4)
    for distance_m in ICP_DISTANCES_M:
        moved = registration.registration_icp(
            source,
            target,
            distance_m,
            moved,
            registration.TransformationEstimationPointToPlane(),
        ).transformation
    return Way(moved @ plan_from_cams, time.process_time() - cpu)


def _extruded(floorplan: Floorplan) -> o3d.geometry.PointCloud:
    """Points on the plan's faces up to a storey's height, and on the floor between them, with normals."""
    xy, face = segments.sample(floorplan.ends, VOXEL_M)
    heights = np.arange(0.1, HEIGHT_M, 0.2)
    walls = np.column_stack([np.repeat(xy, len(heights), axis=0), np.tile(heights, len(xy))])
    across = np.repeat(floorplan.normals[face], len(heights), axis=0)
    low, high = floorplan.ends.min(axis=(0, 1)), floorplan.ends.max(axis=(0, 1))
    grid = np.meshgrid(*(np.arange(a, b, 0.1) for a, b in zip(low, high, strict=True)))
    floor = np.column_stack([grid[0].ravel(), grid[1].ravel(), np.zeros(grid[0].size)])
    normals = np.concatenate(
        [
            np.column_stack([across, np.zeros(len(across))]),
            np.tile([0.0, 0.0, 1.0], (len(floor), 1)),
        ]
    )
    return _cloud(np.concatenate([walls, floor]), normals)


def _cloud(points: np.ndarray, normals: np.ndarray | None = None) -> o3d.geometry.PointCloud:
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points.astype(float)))
    if normals is not None:
        cloud.normals = o3d.utility.Vector3dVector(normals)
    return cloud


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=list(CASES), default=list(CASES))
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    rows = []
    for name in arguments.only:
        for make in CASES[name]:
            rows.append(compare(make()))
            for key, value in rows[-1].items():
                print(
                    f"{key:>20}: {value if isinstance(value, str) else round(value, 4)}", flush=True
                )
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
