"""Time and memory of a solve against the number of frames, each in a process of its own.

python benchmarks/scaling.py N_FRAMES [keyframes]    one solve; prints its numbers as JSON
"""

import json
import resource
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from problems import make_problem
from records import Record, machine

from planfit.adjust import (
    AdjustOptions,
    build_problem,
    follow_keyframes,
    hold_to_keyframes,
    reduce_measurements,
)
from planfit.adjust.terms.walls import WallTerm
from planfit.lsq import Problem
from planfit.tracking import KeyframeOptions, choose_keyframes

SIZES = (1000, 5000, 25_000)
N_LAPS = 10  # at every size, so that a fifth of the pairs are revisits


def main() -> None:
    solve = solve_keyframes if "keyframes" in sys.argv else solve_problem
    solve(make_problem(60, frames_per_lap=30))  # compiles
    problem = make_problem(int(sys.argv[1]), frames_per_lap=int(sys.argv[1]) // N_LAPS)
    before_gb = _peak_gb(since_reset=True)
    begin, cpu = time.perf_counter(), time.process_time()
    solution = solve(problem)
    seconds, cpu_s = time.perf_counter() - begin, time.process_time() - cpu
    numbers = {
        "seconds": seconds,
        "cpu_s": cpu_s,
        "rounds": solution.iterations,
        "stop": solution.stop.name,
        "peak_gb": _peak_gb(),
        "held_before_gb": before_gb,
        "whole_process_peak_gb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9,
        "n_matches": problem.measurements.matches.n_matches,
        "n_points": len(problem.measurements.structure.floor.points_cam)
        + len(problem.measurements.structure.walls.points_cam),
        "n_pairs": len(problem.measurements.matches.pairs),
        "before_m": _rms_m(problem, problem.initial_plan_from_cams),
        "after_m": _rms_m(problem, solution.target_from_cams),
    }
    print(json.dumps(numbers))


def solve_problem(problem):
    """All frames as unknowns."""
    return _solve(problem.measurements, problem, problem.initial_plan_from_cams)


def solve_keyframes(problem):
    """Choose keyframes, move the measurements into their axes, solve for them, carry the others along."""
    recorded = problem.initial_plan_from_cams
    times, spaced = np.arange(float(len(recorded))), KeyframeOptions(min_frames=0, max_step_m=0.3)
    keyframes = hold_to_keyframes(recorded, choose_keyframes(recorded, times, spaced))
    measurements = reduce_measurements(problem.measurements, keyframes)
    solution = _solve(measurements, problem, recorded[keyframes.frame_idx])
    every_frame = follow_keyframes(solution.target_from_cams, keyframes)
    return replace(solution, target_from_cams=every_frame)


def _solve(measurements, problem, initial_plan_from_cams):
    options, patches = AdjustOptions(), measurements.structure.walls
    walls = WallTerm(patches, problem.floorplan, problem.association, options.model("walls"))
    terms = [*build_problem(measurements, options, initial_plan_from_cams).scan_terms, walls]
    return Problem(terms, initial_plan_from_cams).solve(options.solver)


def measure(n_frames: int, *way: str) -> dict:
    command = [sys.executable, __file__, str(n_frames), *way]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return json.loads(done.stdout)


def records(sizes: tuple[int, ...] = SIZES) -> list[Record]:
    made = []
    ways = [(n_frames, "") for n_frames in sizes] + [(sizes[-1], "keyframes")]
    for n_frames, way in ways:
        f = measure(n_frames, *way.split())
        conditions = (
            f"{n_frames} frames in {N_LAPS} laps, {f['n_pairs']} pairs, "
            f"{f['n_matches'] / 1e6:.1f} million matches, "
            f"{f['n_points'] / 1e6:.1f} million points, default terms and solver, "
            f"{'through keyframes every 0.3 m or 10 deg' if way else 'all frames as unknowns'}, "
            f"{f['rounds']} rounds "
            f"({f['stop']}), position RMS {f['before_m']:.3f} -> {f['after_m']:.4f} m; one run, wall "
            f"({f['cpu_s']:.1f} s CPU), compiled before; {machine()}"
        )
        memory = (
            f"peak resident memory while solving, measurements included ({f['held_before_gb']:.2f} GB held "
            f"before; {f['whole_process_peak_gb']:.2f} GB peak with the making of the problem); "
        )
        label = f"{n_frames // 1000}k" + (f"_{way}" if way else "")
        made.append(Record(f"solve_{label}_s", f["seconds"], "s", conditions))
        made.append(Record(f"solve_{label}_peak_gb", f["peak_gb"], "GB", memory + conditions))
    return made


def _rms_m(problem, plan_from_cams) -> float:
    apart = plan_from_cams[:, :3, 3] - problem.true_plan_from_cams[:, :3, 3]
    return float((apart**2).sum(axis=1).mean() ** 0.5)


def _peak_gb(since_reset: bool = False) -> float:
    """Peak resident memory since the last reset; Linux only, else of the whole process."""
    status = Path("/proc/self/status")
    if not status.exists():
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
    if since_reset:
        Path("/proc/self/clear_refs").write_text("5")
    line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
    return int(line.split()[1]) * 1024 / 1e9


if __name__ == "__main__":
    main()
