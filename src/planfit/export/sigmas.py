"""How far each pose may be off: a table for people and programs, and the covariances behind it."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from planfit.adjust.uncertainty import radius_95

SIGMA_HEADER = "frame,timestamp,sigma_x_m,sigma_y_m,sigma_z_m,sigma_rotation_deg,radius_95_m"
"""Columns of `trajectory_sigma.csv`, as docs/outputs.md has them."""


def write_sigmas(
    folder: Path, timestamps: Float[np.ndarray, " n"], covariances: Float[np.ndarray, "n 6 6"]
) -> None:
    """Write `trajectory_sigma.csv` and `covariances.npz`.

    Args:
        folder: it is there.
        timestamps: of the frames, as in `trajectory.tum`.
        covariances: of their poses [rad^2, rad m, m^2], tangents (rotation, translation), axes of the plan.

    Raises:
        OSError: a file cannot be written.
    """
    variances = np.einsum("nii->ni", covariances)
    rotation_deg = np.rad2deg(np.sqrt(variances[:, :3].sum(axis=1)))
    table = np.column_stack(
        [np.sqrt(variances[:, 3:]), rotation_deg, radius_95(covariances[:, 3:, 3:])]
    )
    lines = [
        f"{k},{time:.9g}," + ",".join(f"{value:.6f}" for value in row)
        for k, (time, row) in enumerate(zip(timestamps, table, strict=True))
    ]
    text = "\n".join([SIGMA_HEADER, *lines]) + "\n"
    (folder / "trajectory_sigma.csv").write_text(text, encoding="utf-8")
    np.savez(folder / "covariances.npz", covariances=covariances)
