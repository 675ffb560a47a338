"""Small synthetic scans for the benchmarks of `planfit batch`, and the list of jobs over them."""

from dataclasses import replace
from pathlib import Path

from planfit.synth import (
    BuildingOptions,
    CameraOptions,
    DriftOptions,
    SynthOptions,
    WalkOptions,
    make_scan,
    write_facap,
)

SMALL = SynthOptions(
    building=BuildingOptions(n_rooms=2),
    walk=WalkOptions(n_frames=30),
    camera=CameraOptions(width_px=160, height_px=120),
    drift=DriftOptions(yaw_deg=0.4, translation_m=0.03),
)


def write_jobs(folder: Path, n_jobs: int, n_scans: int | None = None) -> Path:
    """Scans with their plans, where they are not there yet, and a list of jobs; gives its path.

    Args:
        folder: for all of it.
        n_jobs: lines of the list.
        n_scans: scans that they share; by default each has its own.
    """
    n_scans = n_jobs if n_scans is None else n_scans
    for seed in range(n_scans):
        scan = folder / "scans" / f"scan {seed}"
        if not (scan / "groundtruth.tum").exists():
            write_facap(scan, make_scan(replace(SMALL, seed=seed)))
    lines = [f"job {i},scans/scan {i % n_scans}" for i in range(n_jobs)]
    path = folder / f"jobs_{n_jobs}.csv"
    path.write_text("\n".join(["name,scan", *lines, ""]))
    return path
