"""Write the results of a run into a folder."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from planfit.export.cloud import Cloud, place_cloud, write_ply
from planfit.pipeline.refine import RefineResult
from planfit.scan import Scan, write_tum


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
