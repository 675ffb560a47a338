"""Trajectories as files of other programs: TUM, KITTI, Open3D log, g2o."""

from pathlib import Path

import numpy as np

from planfit.lsq.g2o import PoseGraph, write_g2o
from planfit.scan.odometry import Odometry


def write_kitti(path: Path, target_from_cams: np.ndarray) -> None:
    """Poses (n, 4, 4), the upper three rows of each in a line."""
    lines = [" ".join(f"{v:.9e}" for v in pose[:3].ravel()) for pose in target_from_cams]
    path.write_text("\n".join(lines) + "\n")


def write_pose_graph(path: Path, target_from_cams: np.ndarray, odometry: Odometry) -> None:
    """g2o's file: poses (n, 4, 4) as vertices, the recorded steps as edges, the first pose fixed."""
    steps = np.arange(len(odometry.cam_from_next))
    sigma = np.repeat(
        [odometry.sigma_rotation, odometry.sigma_translation], 3, axis=0
    ).T  # (n - 1, 6)
    information = sigma[:, :, None] ** -2.0 * np.eye(6)
    pairs = np.stack([steps, steps + 1], axis=1)
    write_g2o(path, PoseGraph(target_from_cams, pairs, odometry.cam_from_next, information))
