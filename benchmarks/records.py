"""What a benchmark writes down, and how it takes times."""

import os
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

Result = TypeVar("Result")


@dataclass(frozen=True)
class Record:
    """One number, and what it was measured under."""

    name: str
    value: float
    unit: str
    conditions: str


def median_times(run: Callable[[], object], repeats: int) -> tuple[float, float]:
    """Median wall and CPU seconds of a call; one call before, not counted, compiles and warms."""
    run()
    times = []
    for _ in range(repeats):
        wall, cpu = time.perf_counter(), time.process_time()
        run()
        times.append((time.perf_counter() - wall, time.process_time() - cpu))
    wall_s, cpu_s = np.median(times, axis=0)
    return float(wall_s), float(cpu_s)


def cpu_seconds(run: Callable[[], Result]) -> tuple[float, Result]:
    """CPU seconds of the process in a call, and what the call returned."""
    begin = time.process_time()
    found = run()
    return time.process_time() - begin, found


def machine() -> str:
    """Processor, cores and load, for a record's conditions."""
    model = platform.processor() or platform.machine()
    try:
        with Path("/proc/cpuinfo").open() as file:
            model = next(line.split(":")[1].strip() for line in file if "model name" in line)
    except (OSError, StopIteration):
        pass
    load = os.getloadavg()[0]
    return f"{model}, {os.cpu_count()} cores, load average {load:.1f} before the run"


def memory_gb_per_s() -> float:
    """Best rate of copying arrays larger than the caches on one thread, bytes read and written."""
    source = np.ones(32_000_000)
    target = np.zeros_like(source)
    best = np.inf
    for _ in range(5):
        begin = time.perf_counter()
        np.copyto(target, source)
        best = min(best, time.perf_counter() - begin)
    return 2 * source.nbytes / best / 1e9
