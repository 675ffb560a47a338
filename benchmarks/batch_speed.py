"""`planfit batch` over many small scans: how much faster two workers are than one, and what a scan costs.

    python benchmarks/batch_speed.py FOLDER [--jobs 50] [--workers 1 2]

Wall time counts on a machine that does nothing else. CPU time (of the batch and all its jobs) tells on any
whether workers get into each other's way: two workers that need no more of it than one are twice as fast
where there are two processors.
"""

import argparse
import json
import resource
import shutil
import subprocess
import sys
import time
from pathlib import Path

from batch_scans import write_jobs
from records import machine


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--jobs", type=int, default=50)
    parser.add_argument("--scans", type=int, default=5, help="different ones, shared by the jobs")
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    arguments = parser.parse_args()
    jobs = write_jobs(arguments.folder, arguments.jobs, arguments.scans)
    walls = {}
    for workers in arguments.workers:
        print(f"{workers} workers on {machine()}", flush=True)
        walls[workers], cpu_s, peak_gb = run(jobs, arguments.folder / f"out_{workers}", workers)
        print(
            f"{arguments.jobs} scans, {workers} workers: {walls[workers]:.1f} s of wall time, {cpu_s:.1f} s "
            f"of CPU time ({cpu_s / arguments.jobs:.2f} a scan), peak of a job {peak_gb:.2f} GB",
            flush=True,
        )
    first = arguments.workers[0]
    for workers in arguments.workers[1:]:
        print(f"{workers} workers are {walls[first] / walls[workers]:.2f} times as fast as {first}")


def run(jobs: Path, out: Path, workers: int) -> tuple[float, float, float]:
    """Wall and CPU seconds of a batch into an empty folder, and the largest peak of its jobs."""
    shutil.rmtree(out, ignore_errors=True)
    words = [sys.executable, "-m", "planfit", "batch", str(jobs), "-o", str(out)]
    begin, before = time.perf_counter(), children_cpu_s()
    subprocess.run([*words, "--workers", str(workers)], stdout=subprocess.DEVNULL, check=False)
    wall_s, cpu_s = time.perf_counter() - begin, children_cpu_s() - before
    states = [json.loads(path.read_text()) for path in (out / "batch").glob("*.json")]
    assert all(state["end"] == "done" for state in states)
    return wall_s, cpu_s, max(state["peak_bytes"] for state in states) / 1e9


def children_cpu_s() -> float:
    """Of all that ended, with what they started."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


if __name__ == "__main__":
    main()
