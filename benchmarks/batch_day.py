"""A day of scans in one process: does its memory grow, does it leave files open?

    python benchmarks/batch_day.py FOLDER [--runs 200]

`planfit refine` is called again and again in this process, on a few small synthetic scans in turn, each time
into an empty folder. Memory is what the process holds after each run (its resident set), when Python has
collected its garbage. A batch starts a process for each scan, but notebooks and services do not.
"""

import argparse
import contextlib
import gc
import os
import shutil
from pathlib import Path

from batch_scans import write_jobs

from planfit.cli import run

N_SCANS = 5
WARM = 10
"""Runs that are held against as many at the end: what the allocator has not given back differs by 0.1 GB."""
PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--runs", type=int, default=200)
    arguments = parser.parse_args()
    write_jobs(arguments.folder, N_SCANS)
    held_gb, open_files = [], []
    for i in range(arguments.runs):
        out = arguments.folder / "day"
        shutil.rmtree(out, ignore_errors=True)
        scan = arguments.folder / "scans" / f"scan {i % N_SCANS}"
        with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere):  # noqa: PTH123
            run(["refine", str(scan), "-o", str(out), "--workers", "2"])
        gc.collect()
        held_gb.append(resident_gb())
        open_files.append(len(list(Path("/proc/self/fd").iterdir())))
        print(f"run {i + 1}: {held_gb[-1]:.4f} GB, {open_files[-1]} open files", flush=True)
    if arguments.runs >= 2 * WARM:
        first, last = min(held_gb[:WARM]), min(held_gb[-WARM:])
        print(
            f"least memory held after one of the first {WARM} runs {first:.4f} GB, of the last {WARM} "
            f"{last:.4f} GB ({last / first - 1:+.1%}); most {max(held_gb[:WARM]):.4f} and "
            f"{max(held_gb[-WARM:]):.4f} GB; open files {open_files[WARM - 1]} and {open_files[-1]}"
        )


def resident_gb() -> float:
    """What this process holds in memory."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE_BYTES / 1e9


if __name__ == "__main__":
    main()
