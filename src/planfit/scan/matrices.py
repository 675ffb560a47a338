"""Poses as text files of one 4x4 matrix."""

from pathlib import Path

import numpy as np

from planfit.scan.source import Source
from planfit.scan.tables import read_matrix
from planfit.scan.types import check_pose


def read_pose(source: Source, name: str) -> np.ndarray:
    """A 4x4 pose; NaN throughout where the tracker was lost (NaN or infinity in the file).

    Raises:
        ScanError: the file is no 4x4 pose.
    """
    pose = read_matrix(source, name, "a 4x4 matrix of numbers")
    if pose.shape == (4, 4) and not np.isfinite(pose).all():
        return np.full((4, 4), np.nan)
    check_pose(pose, str(source.path / name))
    return pose


def write_pose(path: Path, world_from_cam: np.ndarray) -> None:
    """Write one 4x4 pose as text."""
    path.write_text("\n".join(" ".join(f"{v:.9f}" for v in row) for row in world_from_cam) + "\n")
