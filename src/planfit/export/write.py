"""Files of poses: the results of a run, and trajectories for other programs (KITTI, g2o)."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from planfit.export.cloud import Cloud, place_cloud, write_ply
from planfit.pipeline.refine import RefineResult
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
    if result.walls.covariances is not None:
        np.savez(
            folder / "covariances.npz",
            frame_idx=result.solved_frame_idx,
            covariances=result.walls.covariances,
        )
    (folder / "run.json").write_text(json.dumps(record, indent=1, allow_nan=False) + "\n")


def write_kitti(path: Path, target_from_cams: Float[np.ndarray, "n 4 4"]) -> None:
    """Write poses, the upper three rows of each in a line."""
    lines = [" ".join(f"{v:.9e}" for v in pose[:3].ravel()) for pose in target_from_cams]
    path.write_text("\n".join(lines) + "\n")


def write_g2o(path: Path, target_from_cams: Float[np.ndarray, "n 4 4"], odometry: Odometry) -> None:
    """Write a pose graph: poses as vertices, the recorded steps as edges, the first pose fixed."""
    lines = [f"VERTEX_SE3:QUAT {i} {_numbers(pose)}" for i, pose in enumerate(target_from_cams)]
    lines.append("FIX 0")
    for i, step in enumerate(odometry.cam_from_next):
        # g2o's error is the translation and the vector part of the quaternion, which is half the angle: its
        # information is four times that of the angle.
        diagonal = [odometry.sigma_translation[i] ** -2.0] * 3 + [
            4 * odometry.sigma_rotation[i] ** -2.0
        ] * 3
        upper = np.diag(diagonal)[np.triu_indices(6)]
        information = " ".join(f"{v:.9g}" for v in upper)
        lines.append(f"EDGE_SE3:QUAT {i} {i + 1} {_numbers(step)} {information}")
    path.write_text("\n".join(lines) + "\n")


def _numbers(pose: np.ndarray) -> str:
    xyzw = Rotation.from_matrix(pose[:3, :3]).as_quat(canonical=True)
    return " ".join(f"{v:.12g}" for v in (*pose[:3, 3], *xyzw))
