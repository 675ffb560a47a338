"""Time and memory of a solve against the number of frames, each in a process of its own.

python benchmarks/scaling.py N_FRAMES    one solve; prints its figures as JSON
"""

import json
import resource
import subprocess
import sys
import time
from pathlib import Path

from problems import make_problem
from records import Record, machine

from planfit.adjust import AdjustOptions
from planfit.adjust.solver import solve
from planfit.adjust.terms.walls import WallTerm

SIZES = (1000, 5000, 25_000)


def main() -> None:
    solve_problem(make_problem(60, frames_per_lap=30))  # compiles
    problem = make_problem(int(sys.argv[1]))
    before_gb = _peak_gb(since_reset=True)
    begin, cpu = time.perf_counter(), time.process_time()
    solution = solve_problem(problem)
    seconds, cpu_s = time.perf_counter() - begin, time.process_time() - cpu
    figures = {
        "seconds": seconds,
        "cpu_s": cpu_s,
        "rounds": solution.iterations,
        "stop": solution.stop.name,
        "peak_gb": _peak_gb(),
        "held_before_gb": before_gb,
        "whole_process_peak_gb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9,
        "n_matches": problem.evidence.matches.n_matches,
        "n_points": len(problem.evidence.structure.floor.points_cam)
        + len(problem.evidence.structure.walls.points_cam),
        "n_pairs": len(problem.evidence.matches.pairs),
        "before_m": _rms_m(problem, problem.initial_plan_from_cams),
        "after_m": _rms_m(problem, solution.target_from_cams),
    }
    print(json.dumps(figures))


def solve_problem(problem):
    options = AdjustOptions()
    evidence = problem.evidence
    walls = WallTerm(
        evidence.structure.walls, problem.floorplan, problem.association, options.walls
    )
    terms = [*evidence.terms(options), walls]
    return solve(terms, problem.initial_plan_from_cams, options.solver)


def measure(n_frames: int) -> dict:
    command = [sys.executable, __file__, str(n_frames)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return json.loads(done.stdout)


def records(sizes: tuple[int, ...] = SIZES) -> list[Record]:
    made = []
    for n_frames in sizes:
        f = measure(n_frames)
        conditions = (
            f"{n_frames} frames, {f['n_pairs']} pairs, {f['n_matches'] / 1e6:.1f} million matches, "
            f"{f['n_points'] / 1e6:.1f} million points, default terms and solver, {f['rounds']} rounds "
            f"({f['stop']}), position RMS {f['before_m']:.3f} -> {f['after_m']:.4f} m; one run, wall "
            f"({f['cpu_s']:.1f} s CPU), compiled before; {machine()}"
        )
        memory = (
            f"peak resident memory while solving, evidence included ({f['held_before_gb']:.2f} GB held "
            f"before; {f['whole_process_peak_gb']:.2f} GB peak with the making of the problem); "
        )
        label = f"{n_frames // 1000}k"
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
