"""What the metrics cost on ten million points: time on the clock and of the processors, and memory.

PYTHONPATH=src python benchmarks/metrics.py [--points N] [--json FILE]
"""

import argparse
import dataclasses
import json
import resource
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from records import Record, machine

from planfit.evaluation import (
    MapSample,
    find_orthogonal_sets,
    floor_heights,
    make_true_cloud,
    map_quality,
    mom_m2,
    nearest_neighbours,
    wall_distances,
    wall_layers,
)
from planfit.floorplan import Floorplan
from planfit.geometry import segments
from planfit.segmentation import (
    LevelPoints,
    Structure,
    WallPatches,
    no_level_points,
    no_wall_patches,
)

THREADS = 2
RADIUS_M = 0.2
SPARSE = 40.0, 10
DENSE = 12.0, 4
"""Side (m) and rooms each way of two square storeys: at ten million points 240 and 2,200 neighbours."""


def storey(n: int, side_m: float, rooms: int, rng: np.random.Generator) -> np.ndarray:
    """Points (n, 3) m, with 1 cm of noise, evenly on floor, ceiling and walls of square rooms."""
    areas = np.array([side_m**2] * 2 + [2.7 * side_m] * (2 * (rooms + 1)))
    which = rng.choice(len(areas), n, p=areas / areas.sum())
    u, v = rng.random((2, n))
    off = 0.01 * rng.standard_normal(n)
    line = (which - 2) % (rooms + 1) * side_m / rooms
    is_flat, is_x = which < 2, which - 2 < rooms + 1
    x = np.where(is_flat | ~is_x, u * side_m, line + off)
    y = np.where(is_flat, v * side_m, np.where(is_x, u * side_m, line + off))
    z = np.where(is_flat, 2.7 * which + off, 2.7 * v)
    return np.stack([x, y, z], axis=1)


def corners(n_frames: int, n_points: int, rng: np.random.Generator) -> MapSample:
    """Depth maps that look into a corner of a room, half a metre before each of its planes."""
    points = rng.uniform(0, 3.0, (n_frames * n_points, 3))
    row = np.arange(len(points))
    points[row, row % 3] = 0.005 * rng.standard_normal(len(points))
    return MapSample((points - 0.5).astype(np.float32), np.arange(0, len(points) + 1, n_points))


def walls_and_floor(
    n: int, n_frames: int, rng: np.random.Generator
) -> tuple[Structure, Floorplan, np.ndarray]:
    """n wall points in patches of 150, n floor points, a plan of 400 faces, and poses."""
    side = 40.0
    at = rng.uniform(0, side, (400, 2))
    yaw = rng.integers(0, 4, 400) * np.pi / 2
    ends = np.stack([at, at + 3.0 * np.stack([np.cos(yaw), np.sin(yaw)], axis=1)], axis=1)
    plan = Floorplan("benchmark", ends, segments.left_normals(ends), np.ones(400, dtype=bool))
    poses = np.tile(np.eye(4), (n_frames, 1, 1))
    poses[:, :2, 3] = rng.uniform(0, side, (n_frames, 2))
    n_patches = n // 150
    frames = np.sort(rng.integers(0, n_frames, n_patches))
    face = rng.integers(0, 400, n_patches)
    t = rng.random((n_patches, 150, 1))
    xy = ends[face, None, 0] * (1 - t) + ends[face, None, 1] * t - poses[frames, None, :2, 3]
    points = np.concatenate([xy, rng.uniform(0, 2.5, (n_patches, 150, 1))], axis=2)
    normals = np.concatenate([plan.normals[face], np.zeros((n_patches, 1))], axis=1)
    patches = WallPatches(
        points.reshape(-1, 3),
        np.arange(0, 150 * n_patches + 1, 150),
        frames,
        normals,
        np.zeros((n_patches, 2, 3)),
    )
    floor = rng.uniform(0, 5, (n, 3))
    floor[:, 2] = 0.01 * rng.standard_normal(n)
    structure = Structure(
        floor=LevelPoints(floor, np.linspace(0, n, n_frames + 1).astype(int)),
        floor_heights_m=np.zeros(n_frames),
        walls=patches,
        unassigned_points_cam=np.zeros((0, 3)),
        unassigned_frame_idx=np.zeros(0, dtype=int),
        ceiling=no_level_points(n_frames),
        columns=no_wall_patches(),
        back_end="masks",
        floor_height_m=0.0,
    )
    return structure, plan, poses


def both_nsd(structure: Structure, plan: Floorplan, poses: np.ndarray) -> tuple[float, float]:
    """NSD and oriented NSD, m."""
    found = wall_distances(structure, plan, poses, THREADS)
    assert found is not None
    return found.nsd_m, found.oriented_nsd_m


def flatness(structure: Structure, poses: np.ndarray) -> tuple[float, float]:
    """RMS of the floor about its plane and about its mean height, m."""
    found = floor_heights(structure, poses)
    assert found is not None
    return found.plane_rms_m, found.height_rms_m


def records(n: int = 10_000_000) -> list[Record]:
    """Each metric on n points, in seconds of the processors: other load on the machine changes them least.

    All in one process, so the memory is the most that anything before took, too.
    """
    rng = np.random.default_rng(0)
    made: list[Record] = []

    def measure(name: str, what: str, run: Callable[[], object]) -> None:
        wall, cpu = time.perf_counter(), time.process_time()
        run()
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
        conditions = (
            f"{what}; {wall:.1f} s on the clock, {cpu:.1f} s of the processors, {THREADS} threads, at most "
            f"{memory:.2f} GB so far, inputs included; {machine()}"
        )
        made.append(Record(name, cpu, "s", conditions))
        print(f"{name}: {conditions}", flush=True)

    map_quality(rng.random((1000, 3)), RADIUS_M)
    for word, (side, rooms) in (("sparse", SPARSE), ("dense", DENSE)):
        points = storey(n, side, rooms, rng)
        quality = map_quality(points[:: max(1, n // 200_000)], RADIUS_M)
        around = quality.n_neighbours.mean() * max(1, n // 200_000)
        measure(
            f"mme_mpv_{word}_cpu_s",
            f"MME and MPV of {n / 1e6:g} million points, about {around:.0f} neighbours each",
            lambda points=points: map_quality(points, RADIUS_M, THREADS),
        )
    sample = corners(60, 5000, rng)
    quality = map_quality(sample.points_cam.astype(float), RADIUS_M, THREADS)
    measure(
        "mom_cpu_s",
        "orthogonal planes of 60 depth maps of 5,000 points, and MOM",
        lambda: mom_m2(find_orthogonal_sets(sample, RADIUS_M, 60), quality),
    )
    points = storey(n, *DENSE, rng)
    truth = make_true_cloud(storey(n // 5, *DENSE, rng), 0.1)
    measure(
        "nnd_cpu_s",
        f"NND of {n / 1e6:g} million points to {n / 5e6:g} million, registration included",
        lambda: nearest_neighbours(points, truth, workers=THREADS),
    )
    structure, plan, poses = walls_and_floor(n, max(2, n // 1500), rng)
    for name, what, run in (
        ("nsd_cpu_s", "NSD and oriented NSD of {0} million wall points to 400 faces",
         lambda: both_nsd(structure, plan, poses)),
        ("floor_cpu_s", "flatness of {0} million floor points", lambda: flatness(structure, poses)),
        ("double_walls_cpu_s", "doubled walls among {0} million wall points",
         lambda: wall_layers(structure.walls, poses)),
    ):  # fmt: skip
        measure(name, what.format(f"{n / 1e6:g}"), run)
    return made


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=10_000_000)
    parser.add_argument("--json", type=Path, help="write the records to this file")
    arguments = parser.parse_args()
    rows = [dataclasses.asdict(record) for record in records(arguments.points)]
    if arguments.json:
        arguments.json.write_text(json.dumps(rows))
