"""Trajectories as files of other programs: TUM, KITTI, Open3D log, g2o."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from planfit.scan.odometry import Odometry


def write_kitti(path: Path, target_from_cams: np.ndarray) -> None:
    """Poses (n, 4, 4), the upper three rows of each in a line."""
    lines = [" ".join(f"{v:.9e}" for v in pose[:3].ravel()) for pose in target_from_cams]
    path.write_text("\n".join(lines) + "\n")


def write_g2o(path: Path, target_from_cams: np.ndarray, odometry: Odometry) -> None:
    """A pose graph: poses (n, 4, 4) as vertices, the recorded steps as edges, the first pose fixed.

    g2o's information is that of the shift and of the vector part of the quaternion, half the angle.
    """
    lines = [f"VERTEX_SE3:QUAT {i} {_numbers(pose)}" for i, pose in enumerate(target_from_cams)]
    lines.append("FIX 0")
    for i, step in enumerate(odometry.cam_from_next):
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
