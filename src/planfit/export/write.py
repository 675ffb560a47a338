"""Files of poses: the results of a run, and trajectories for other programs (KITTI, g2o)."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from planfit.export.cloud import Cloud, place_cloud, write_ply
from planfit.export.matches_file import MATCHES, loop_edges, write_matches
from planfit.export.tables import write_registration, write_sigmas, write_survey
from planfit.lsq.g2o import PoseGraph, write_g2o
from planfit.matching import Matches
from planfit.pipeline.result import RefineResult
from planfit.runtime.run_folder import RECORD
from planfit.scan import Scan, write_tum
from planfit.scan.odometry import Odometry


@dataclass(frozen=True)
class Finished:
    """A run, as its files are written of it."""

    scan: Scan
    result: RefineResult
    record: dict[str, Any]
    """What `run.json` says."""


def _write_poses(path: Path, run: Finished) -> None:
    path.mkdir()
    run.scan.files.write_poses(path, run.result.world_from_cams)


def _write_control_points(path: Path, run: Finished) -> None:
    if run.result.survey is not None:
        write_survey(path, run.result.survey)


def record_text(record: dict[str, Any]) -> str:
    """`run.json` of a record."""
    return json.dumps(record, indent=1, allow_nan=False) + "\n"


FILES: dict[str, Callable[[Path, Finished], object]] = {
    "poses": _write_poses,
    "trajectory.tum": lambda path, run: write_tum(
        path, run.scan.timestamps, run.result.plan_from_cams
    ),
    MATCHES: lambda path, run: write_matches(path, run.result.matches),
    "trajectory_sigma.csv": lambda path, run: write_sigmas(
        path, run.scan, run.result.evidence.pose_covariances, run.result.solved_frame_idx
    ),
    "covariances.npz": lambda path, run: np.savez(
        path, covariances=run.result.evidence.pose_covariances
    ),
    "registration.csv": lambda path, run: write_registration(path, run.result.registration),
    "control_points.csv": _write_control_points,
    RECORD: lambda path, run: path.write_text(record_text(run.record)),
}
"""Files and folders of a run beside its clouds and pages, by name, in the order in which they are written;
what each holds is said in docs/outputs.md. Control points are written where there are any, the rest always.
"""


def write_results(folder: Path, scan: Scan, result: RefineResult, record: dict[str, Any]) -> None:
    """Write all of `FILES` into a folder that has none of them.

    Raises:
        OSError: a file cannot be written.
    """
    run = Finished(scan, result, record)
    for name, write in FILES.items():
        write(folder / name, run)


def write_clouds(folder: Path, result: RefineResult, cloud: Cloud) -> None:
    """Write the points of a run at its poses before and after.

    Raises:
        OSError: a file cannot be written.
    """
    for name, poses in (
        ("before", result.initial_plan_from_cams),
        ("after", result.plan_from_cams),
    ):
        write_ply(folder / f"cloud_{name}.ply", place_cloud(cloud, poses), cloud.colors)


def write_kitti(path: Path, target_from_cams: Float[np.ndarray, "n 4 4"]) -> None:
    """Write poses, the upper three rows of each in a line."""
    lines = [" ".join(f"{v:.15g}" for v in pose[:3].ravel()) for pose in target_from_cams]
    path.write_text("\n".join(lines) + "\n")


def write_pose_graph(
    path: Path,
    target_from_cams: Float[np.ndarray, "n 4 4"],
    odometry: Odometry,
    matches: Matches | None = None,
) -> None:
    """g2o's file: poses as vertices, the recorded steps and the motions that matches give as edges, the first
    pose fixed."""
    steps = np.arange(len(odometry.cam_from_next))
    sigma = np.repeat(
        [odometry.sigma_rotation, odometry.sigma_translation], 3, axis=0
    ).T  # (n - 1, 6)
    information = sigma[:, :, None] ** -2.0 * np.eye(6)
    pairs, motions = np.stack([steps, steps + 1], axis=1), odometry.cam_from_next
    if matches is not None:
        loops = loop_edges(matches)
        pairs = np.concatenate([pairs, loops.pairs])
        motions = np.concatenate([motions, loops.first_from_second])
        information = np.concatenate([information, loops.information])
    write_g2o(path, PoseGraph(target_from_cams, pairs, motions, information))
