"""Files of poses and matches: the results of a run, and trajectories for other programs (KITTI, g2o)."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from jaxtyping import Float, Int

from planfit.errors import OutputError
from planfit.export.cloud import Cloud, place_cloud, write_ply
from planfit.export.tables import write_registration, write_sigmas, write_survey
from planfit.geometry import se3
from planfit.lsq.g2o import PoseGraph, write_g2o
from planfit.matching import Matches
from planfit.pipeline.result import RefineResult
from planfit.priors import SURE_SIGMAS
from planfit.runtime.run_folder import RECORD
from planfit.scan import Scan, write_tum
from planfit.scan.odometry import Odometry

MATCHES = "matches.npz"


def write_matches(path: Path, matches: Matches) -> None:
    """`pairs` (p, 2) frames, `start` (p + 1,), `points_a`, `points_b` (m, 3) [m, cameras of the pair's first
    and second frame], `sigma` (m,) [m]: matches of pair k are start[k]:start[k + 1].
    """
    np.savez_compressed(
        path,
        pairs=matches.pairs.astype(np.int32),
        start=matches.start.astype(np.int64),
        points_a=matches.points_a.astype(np.float32),
        points_b=matches.points_b.astype(np.float32),
        sigma=matches.sigma.astype(np.float32),
    )


def read_matches(folder: Path) -> Matches | None:
    """Those of the run in a folder; None where it wrote none, as runs of older versions.

    Raises:
        OutputError: the file is damaged.
    """
    path = folder / MATCHES
    if not path.is_file():
        return None
    try:
        # numpy leaves a file open that it cannot read.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            pairs, start = stored["pairs"], stored["start"]
            points = [stored[name].astype(float) for name in ("points_a", "points_b", "sigma")]
        if start.shape != (len(pairs) + 1,) or {len(p) for p in points} != {int(start[-1])}:
            raise ValueError("tables of different lengths")
    except (OSError, ValueError, KeyError, EOFError, IndexError, BadZipFile) as error:
        raise OutputError(
            f"{path}: expected the matches of a run, found a damaged file ({error}); run planfit "
            "refine again"
        ) from error
    return Matches(pairs, start, *points, n_tried=len(pairs), n_keypoints=0)


MIN_MATCHES = 6
FLOOR_DEG, FLOOR_M = 0.1, 0.005
"""What all matches of a pair err by together (depth, lens, clock): their number does not average it out."""
N_REWEIGHTS = 5
OUTLIER_SIGMAS = SURE_SIGMAS.value
"""Matches further off than this lose weight (Cauchy)."""


@dataclass(frozen=True)
class LoopEdges:
    """Motions between frames that do not follow each other."""

    pairs: Int[np.ndarray, "e 2"]
    first_from_second: Float[np.ndarray, "e 4 4"]
    information: Float[np.ndarray, "e 6 6"]
    """Of (rotation, translation) [1/rad^2, 1/m^2], axes of the second camera."""


def loop_edges(matches: Matches) -> LoopEdges:
    """An edge for each matched pair of frames that are no neighbours and have enough matches."""
    chosen, motions, information = [], [], []
    for k, (i, j) in enumerate(matches.pairs):
        span = slice(matches.start[k], matches.start[k + 1])
        if j - i < 2 or span.stop - span.start < MIN_MATCHES:
            continue
        ends = (matches.points_a[span], matches.points_b[span], matches.sigma[span])
        motion, hold = _fit(*(each.astype(float) for each in ends))
        chosen.append((i, j))
        motions.append(motion)
        information.append(hold)
    n = len(chosen)
    return LoopEdges(
        np.array(chosen, dtype=int).reshape(n, 2),
        np.array(motions).reshape(n, 4, 4),
        np.array(information).reshape(n, 6, 6),
    )


def _fit(
    points_a: Float[np.ndarray, "k 3"],
    points_b: Float[np.ndarray, "k 3"],
    sigma: Float[np.ndarray, " k"],
) -> tuple[Float[np.ndarray, "4 4"], Float[np.ndarray, "6 6"]]:
    """a_from_b by weighted least squares, and its information."""
    weights = sigma**-2.0
    a_from_b = se3.fit_rigid(points_b, points_a, weights)
    for _ in range(N_REWEIGHTS):
        off = np.linalg.norm(se3.transform(a_from_b, points_b) - points_a, axis=1) / sigma
        weights = sigma**-2.0 / (1.0 + (off / OUTLIER_SIGMAS) ** 2)
        a_from_b = se3.fit_rigid(points_b, points_a, weights)
    # A motion of the second camera by (w, v) moves a point b in it by w x b + v.
    jacobian = np.concatenate(
        [-se3.skew(points_b), np.tile(np.eye(3), (len(points_b), 1, 1))], axis=2
    )
    own = np.einsum("k,kri,krj->ij", weights, jacobian, jacobian)
    floor = np.repeat([np.deg2rad(FLOOR_DEG), FLOOR_M], 3) ** 2
    # (own^-1 + floor)^-1, where own may not hold every direction (points on a line).
    return a_from_b, np.linalg.solve(np.eye(6) + own * floor, own)


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
