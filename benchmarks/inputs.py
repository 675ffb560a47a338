"""What the benchmarks solve: the real scan where it is present, and a synthetic one of its size."""

import dataclasses
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from problems import make_problem

import planfit
from planfit.adjust import paper_options
from planfit.adjust.association import Association, associate
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.matching import Matches
from planfit.runtime import Runtime
from planfit.scan import read_tum
from planfit.scan.formats.facap import PLAN_FROM_WORLD
from planfit.segmentation import LevelPoints, Structure
from planfit.synth import DriftOptions

CONSLAM = Path(os.environ.get("PLANFIT_SHARED", "../shared/data")) / "conslam"
CACHE = Path(os.environ.get("PLANFIT_BENCH_CACHE", Path(tempfile.gettempdir()) / "planfit-bench"))
"""Keypoints, matches and structure of the real scan are kept here between runs."""
N_MATCHES, N_WALL, N_FLOOR = 41_158, 21_060, 23_852
"""Points that the paper's authors' code was given on this scan (design notes)."""


@dataclass(frozen=True)
class Case:
    """One adjustment: measurements, plan, association, where it begins, and where the truth is."""

    name: str
    matches: Matches
    structure: Structure
    floorplan: Floorplan
    association: Association
    initial_plan_from_cams: np.ndarray  # (n, 4, 4)
    true_plan_from_cams: np.ndarray  # (n, 4, 4)

    @property
    def paper_inputs(self) -> tuple[Matches, Structure, Floorplan, Association]:
        """Arguments of `paper_terms` and of `descend`."""
        return self.matches, self.structure, self.floorplan, self.association

    @property
    def size(self) -> str:
        """Frames and points, for a record's conditions."""
        on_face = np.diff(self.structure.walls.start)[self.association.face_idx >= 0].sum()
        return (
            f"{self.name}: {len(self.initial_plan_from_cams)} frames, {self.matches.n_matches} matches, "
            f"{on_face} wall and {len(self.structure.floor.points_cam)} floor points"
        )


def real_case() -> Case | None:
    """The ConSLAM scan as shipped, recorded poses placed on the plan; None where it is absent."""
    if not CONSLAM.exists():
        return None
    scan = planfit.read_scan(CONSLAM)
    assert scan.floorplan_path is not None
    floorplan = planfit.read_floorplan(scan.floorplan_path)
    run = planfit.refine(scan, floorplan, planfit.RefineOptions(), Runtime(cache_dir=CACHE))
    _, true_world_from_cams = read_tum(CONSLAM / "groundtruth.tum")
    structure = thinned(run.structure, N_FLOOR, N_WALL)
    paper = paper_options()
    return Case(
        "ConSLAM scan",
        run.matches,
        structure,
        floorplan,
        associate(
            structure.walls,
            floorplan,
            run.initial_plan_from_cams,
            paper.wall_distances_m[-1],
            paper.association,
        ),
        run.initial_plan_from_cams,
        PLAN_FROM_WORLD @ true_world_from_cams,
    )


def synthetic_case(n_frames: int = 250, seed: int = 0) -> Case:
    """Two laps of a ring corridor, about as many points as the real scan is given, 1 m of drift."""
    problem = make_problem(
        n_frames,
        seed,
        frames_per_lap=n_frames // 2,
        matches_per_pair=35,
        points_per_frame=180,
        drift=DriftOptions(yaw_deg=0.15, translation_m=0.02),
    )
    measurements = problem.measurements
    return Case(
        "synthetic scan",
        measurements.matches,
        measurements.structure,
        problem.floorplan,
        problem.association,
        problem.initial_plan_from_cams,
        problem.true_plan_from_cams,
    )


def thinned(structure: Structure, n_floor: int, n_wall: int) -> Structure:
    """The same with about this many floor and wall points, evenly left out."""
    floor, floor_start = _every(structure.floor.start, n_floor)
    wall, wall_start = _every(structure.walls.start, n_wall)
    walls = dataclasses.replace(
        structure.walls, points_cam=structure.walls.points_cam[wall], start=wall_start
    )
    kept = LevelPoints(structure.floor.points_cam[floor], floor_start)
    return dataclasses.replace(structure, floor=kept, walls=walls)


def _every(start: np.ndarray, n_kept: int) -> tuple[np.ndarray, np.ndarray]:
    """Indices of `n_kept` points evenly spread over groups, and where the groups then start."""
    n = int(start[-1])
    kept = np.unique(np.linspace(0, n - 1, min(n_kept, n)).round().astype(int))
    return kept, np.searchsorted(kept, start)


def position_rms_m(case: Case, plan_from_cams: np.ndarray) -> float:
    """RMS distance of the cameras from the truth, plan frame, no alignment, m."""
    apart = plan_from_cams[:, :3, 3] - case.true_plan_from_cams[:, :3, 3]
    return float(np.sqrt(np.mean(np.sum(apart**2, axis=1))))


def largest_difference(a: np.ndarray, b: np.ndarray) -> tuple[float, float]:
    """Largest translation (m) and rotation (rad) between poses (n, 4, 4)."""
    apart = se3.difference(a, b)
    return (
        float(np.linalg.norm(apart[:, 3:], axis=1).max()),
        float(np.linalg.norm(apart[:, :3], axis=1).max()),
    )
