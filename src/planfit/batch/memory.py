"""Memory: what this machine may give, what a process needed, what a job is expected to need."""

import os
import sys
from dataclasses import dataclass, field
from pathlib import Path

from planfit.batch.jobs import Stamp

GB = 10**9
SHARE_OF_FREE = 0.8
"""Of what is free when a batch begins, so much is given to its jobs where nothing is said."""
_BASE_BYTES = 650 * 10**6
"""With all libraries, compiled kernels and the report: 0.65 GB for 249 frames of 516 x 386, 0.67 GB for 1,000
of 640 x 480."""
_BYTES_A_FILE = 40 * 10**3
"""A run of 25,000 frames of 640 x 480 took 2.3 GB; they come as colour and depth at least."""
_BYTES_A_BYTE = 3.0
"""Of a scan that is one file (a bag, a cloud), whose frames are not counted: its chunks are unpacked."""
_MARGIN = 1.15
"""A measured peak may be exceeded by so much."""


def free_bytes(root: Path = Path("/")) -> int | None:
    """Memory that can be had now: of the machine, or of the control group that this process is in (a
    container, a job of Slurm); None where the system does not tell.
    """
    limits = []
    try:
        lines = (root / "proc/meminfo").read_text().splitlines()
        values = {line.split(":")[0]: int(line.split()[1]) * 1024 for line in lines if ":" in line}
        limits.append(values["MemAvailable"])
    except (OSError, ValueError, KeyError, IndexError):
        if sys.platform == "darwin":  # what is free is not told without a library
            limits.append(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    for folder in _control_groups(root):
        for most, used in (
            ("memory.max", "memory.current"),
            ("memory.limit_in_bytes", "memory.usage_in_bytes"),
        ):
            try:
                limit, taken = (int((folder / name).read_text()) for name in (most, used))
            except (OSError, ValueError):  # "max": no limit
                continue
            # Files that were read are counted as taken, and given back when needed.
            limits.append(max(limit - taken + _cached_files(folder), 0))
    return min(limits) if limits else None


def _control_groups(root: Path) -> list[Path]:
    """Folders of this process's groups and of those above, of both versions."""
    folders = []
    try:
        lines = (root / "proc/self/cgroup").read_text().splitlines()
    except OSError:
        return []
    for line in lines:
        _, controllers, path = line.split(":", 2)
        base = root / "sys/fs/cgroup"
        if "memory" in controllers.split(","):
            base = base / "memory"
        elif controllers:
            continue
        own = base / path.lstrip("/")
        folders += [own, *(up for up in own.parents if up == base or base in up.parents)]
    return folders


def _cached_files(folder: Path) -> int:
    try:
        lines = (folder / "memory.stat").read_text().splitlines()
        values = dict(line.split() for line in lines)
        return int(values.get("inactive_file") or values.get("total_inactive_file") or 0)
    except (OSError, ValueError):
        return 0


def own_peak_bytes() -> int | None:
    """The most memory that this process ever had; None where the system does not tell (Windows)."""
    try:
        import resource
    except ImportError:
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


@dataclass
class Expectation:
    """What jobs are expected to need; learns from those that ended."""

    _more_bytes: int = field(default=0, init=False)
    """By which the worst job exceeded its guess."""

    def of(self, scan: Stamp | None, known_gb: float | None, measured: int | None) -> int:
        """Bytes of a job.

        Args:
            scan: its files; None where they cannot be looked at, and the job will be refused.
            known_gb: what the user says.
            measured: its peak of another time.
        """
        if known_gb is not None:
            return int(known_gb * GB)
        if measured is not None:
            return int(measured * _MARGIN)
        return guess_bytes(scan) + self._more_bytes

    def learn(self, scan: Stamp | None, peak: int | None) -> None:
        """A job of this scan had this peak."""
        if peak is not None and scan is not None:
            self._more_bytes = max(self._more_bytes, int(peak * _MARGIN) - guess_bytes(scan))


def guess_bytes(scan: Stamp | None) -> int:
    """By the number of files, or the size where they are few."""
    if scan is None:
        return _BASE_BYTES
    by_files, by_size = scan.n_files * _BYTES_A_FILE, 0
    if scan.n_files < 10:
        by_size = min(scan.n_bytes * _BYTES_A_BYTE, 8 * GB)
    return int(_BASE_BYTES + max(by_files, by_size))
