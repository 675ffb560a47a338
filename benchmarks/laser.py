"""A mobile laser scan made of a real scan's depth, refined to the plan: `python benchmarks/laser.py --help`.

ConSLAM's depth images become one LAZ: an instant of half a second each, its points where a drifted trajectory
puts them, at random times about its own, in an order that is not theirs. Errors are RMS over all instants, in
the plan's frame, without alignment to the truth.
"""

import json
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
import tyro
from faults.inputs import Inputs
from faults.scans import conslam, drifted
from jaxtyping import Float
from records import Record, machine
from scipy.spatial.transform import Rotation

from planfit.geometry import se3
from planfit.scan import read_tum

INSTANT_S, HALF_SPREAD_S = 0.5, 0.2
PIECE = 1_000_000
"""Points that are written at once."""


@dataclass(frozen=True)
class Arguments:
    """Which drifts, and how many points."""

    seeds: tuple[int, ...] = (0, 1, 2)
    """Of the drift."""
    million_points: float = 2.0
    """Of the cloud; more than there are pixels are drawn several times, each in its own place of a pixel."""


def main(arguments: Arguments) -> None:
    """Print the records as JSON."""
    for seed in arguments.seeds:
        for record in records(seed, int(1e6 * arguments.million_points)):
            print(json.dumps(vars(record)), flush=True)


def records(seed: int, n_points: int) -> list[Record]:
    """Error, wall seconds and peak memory of `planfit refine` with one drift; of several, the peak of all so
    far is told, as systems keep no other of processes that ended."""
    inputs = drifted(conslam(), seed)
    load = machine()
    with tempfile.TemporaryDirectory() as folder:
        cloud, trajectory = Path(folder) / "scan.laz", Path(folder) / "trajectory.txt"
        write_cloud(cloud, inputs, n_points, np.random.default_rng(seed))
        write_trajectory(trajectory, inputs)
        out = Path(folder) / "out"
        command = [
            sys.executable,
            "-m",
            "planfit",
            "refine",
            str(cloud),
            "--poses",
            str(trajectory),
        ]
        command += ["--plan", str(inputs.scan.floorplan_path), "-o", str(out)]
        begin = time.perf_counter()
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        wall_s = time.perf_counter() - begin
        if done.returncode not in (0, 1):
            raise RuntimeError(done.stderr)
        error_m = _error_m(out / "trajectory.tum", inputs)
        outcome = json.loads((out / "run.json").read_text())["verdict"]["outcome"]
    before_m = _rms(inputs.scan.world_from_cams[:, :3, 3] - inputs.true_world_from_cams[:, :3, 3])
    of_children = resource.getrusage(resource.RUSAGE_CHILDREN)
    conditions = (
        f"ConSLAM as a LAZ of {n_points / 1e6:.0f} million points, drift {seed}, {before_m:.3f} m before, "
        f"exit {done.returncode}, {outcome}; one run, nothing cached; {load}"
    )
    return [
        Record("laser_error", error_m, "m", conditions),
        Record("laser_wall", wall_s, "s", conditions),
        Record("laser_peak", of_children.ru_maxrss * 1024 / 1e9, "GB", conditions),
    ]


def write_cloud(path: Path, inputs: Inputs, n_points: int, rng: np.random.Generator) -> None:
    """Points of all depth images by the recorded poses, z up, in pieces of random instants."""
    files, cameras = inputs.scan.files, inputs.scan.cameras
    n = len(inputs.scan)
    level_from_cams = inputs.true_plan_from_world @ inputs.scan.world_from_cams
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [1e-4] * 3, [0.0] * 3
    order = rng.permutation(n)
    counts = np.bincount(np.arange(n_points) % n, minlength=n)
    with laspy.open(str(path), mode="w", header=header) as writer:
        for k in order:
            depth = files.depth(int(k))
            v, u = np.nonzero(depth > 0)
            drawn = rng.integers(0, len(u), counts[k]) if len(u) else np.zeros(0, int)
            at = np.stack([u[drawn], v[drawn]], axis=1) + rng.uniform(-0.5, 0.5, (len(drawn), 2))
            rays = cameras[int(k)].lift(at, np.ones(len(at)))
            points = se3.transform(level_from_cams[k], rays * depth[v[drawn], u[drawn], None])
            times = INSTANT_S * (k + 0.5) + rng.uniform(-HALF_SPREAD_S, HALF_SPREAD_S, len(points))
            for start in range(0, len(points), PIECE):
                piece = slice(start, start + PIECE)
                record = laspy.ScaleAwarePointRecord.zeros(len(points[piece]), header=header)
                record.x, record.y, record.z = points[piece].T
                record.gps_time = times[piece]
                writer.write_points(record)


def write_trajectory(path: Path, inputs: Inputs) -> None:
    """Where the scanner was recorded at each instant: `time x y z qx qy qz qw`."""
    level_from_cams = inputs.true_plan_from_world @ inputs.scan.world_from_cams
    quaternions = Rotation.from_matrix(level_from_cams[:, :3, :3]).as_quat()
    times = INSTANT_S * (np.arange(len(level_from_cams)) + 0.5)
    rows = np.column_stack([times, level_from_cams[:, :3, 3], quaternions])
    # The cloud reaches a little beyond the middles of the first instant and of the last.
    rows = np.concatenate([rows[:1], rows, rows[-1:]])
    rows[[0, -1], 0] += [-INSTANT_S / 2, INSTANT_S / 2]
    np.savetxt(path, rows, fmt="%.9f")


def _error_m(trajectory: Path, inputs: Inputs) -> float:
    times, plan_from_cams = read_tum(trajectory)
    true = (inputs.true_plan_from_world @ inputs.true_world_from_cams)[:, :3, 3]
    own_times = INSTANT_S * (np.arange(len(true)) + 0.5)
    at = np.stack([np.interp(times, own_times, axis) for axis in true.T], axis=1)
    return _rms(plan_from_cams[:, :3, 3] - at)


def _rms(off_m: Float[np.ndarray, "n 3"]) -> float:
    return float(np.sqrt(np.mean(np.sum(off_m**2, axis=1))))


if __name__ == "__main__":
    main(tyro.cli(Arguments, description=__doc__))
