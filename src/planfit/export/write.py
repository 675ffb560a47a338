"""Files of poses: the results of a run, and trajectories for other programs (KITTI, g2o)."""

import json
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
from planfit.scan import Scan, write_tum
from planfit.scan.odometry import Odometry


def write_results(
    folder: Path, scan: Scan, result: RefineResult, record: dict[str, Any], cloud: Cloud
) -> None:
    """Write poses, trajectory, clouds and the record; names as in docs/outputs.md.

    Raises:
        OSError: a file cannot be written.
    """
    poses = folder / "poses"
    poses.mkdir()
    scan.files.write_poses(poses, result.world_from_cams)
    write_tum(folder / "trajectory.tum", scan.timestamps, result.plan_from_cams)
    for name, plan_from_cams in (
        ("before", result.initial_plan_from_cams),
        ("after", result.plan_from_cams),
    ):
        points = place_cloud(cloud, plan_from_cams)
        write_ply(folder / f"cloud_{name}.ply", points, cloud.colors)
    write_matches(folder / MATCHES, result.matches)
    write_sigmas(folder, scan.timestamps, result.evidence.pose_covariances)
    write_registration(folder, result.registration)
    if result.survey is not None:
        write_survey(folder, result.survey)
    (folder / "run.json").write_text(json.dumps(record, indent=1, allow_nan=False) + "\n")


def write_kitti(path: Path, target_from_cams: Float[np.ndarray, "n 4 4"]) -> None:
    """Write poses, the upper three rows of each in a line."""
    lines = [" ".join(f"{v:.9e}" for v in pose[:3].ravel()) for pose in target_from_cams]
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
