"""Position error on the real ConSLAM scan: as shipped, and for drifts of our own of the same size.

    python benchmarks/real_scan.py [--seeds 10] [--scan FOLDER] [--back-end masks|geometry] [--json FILE]

The scan's truth takes a random walk on top (0.15 deg about the vertical and 0.02 m a frame, 0.3 of both
about and along the other axes), as the shipped poses have it. Errors are RMS over all frames, in the
plan's frame, without any alignment to the truth.
"""

import argparse
import dataclasses
import json
import os
import resource
import tempfile
import time
from pathlib import Path

import numpy as np

import planfit
from planfit.evaluation import position_errors
from planfit.geometry import se3
from planfit.runtime import Runtime
from planfit.scan import read_tum
from planfit.scan.formats.facap import PLAN_FROM_WORLD
from planfit.segmentation import SegmentationOptions
from planfit.synth import DriftOptions, drift_poses

DEFAULT = Path(os.environ.get("PLANFIT_SHARED", "../shared/data")) / "conslam"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--scan", type=Path, default=DEFAULT)
    parser.add_argument("--back-end", default="masks")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    scan = planfit.read_scan(arguments.scan)
    assert scan.floorplan_path is not None
    assert scan.up_world is not None
    floorplan = planfit.read_floorplan(scan.floorplan_path)
    _, true_world_from_cams = read_tum(arguments.scan / "groundtruth.tum")
    options = planfit.RefineOptions(segmentation=SegmentationOptions(back_end=arguments.back_end))
    drift = DriftOptions(yaw_deg=0.15, translation_m=0.02)
    print("seed      before m   after m   aligned m    rot deg   seconds")
    rows = []
    with tempfile.TemporaryDirectory() as cache:
        runtime = Runtime(cache_dir=Path(cache))
        for seed in [None, *range(arguments.seeds)]:
            drifted = scan.world_from_cams
            if seed is not None:
                rng = np.random.default_rng(seed)
                drifted = drift_poses(true_world_from_cams, drift, rng, scan.up_world)
            begin = time.perf_counter()
            run = planfit.refine(
                dataclasses.replace(scan, world_from_cams=drifted), floorplan, options, runtime
            )
            seconds = time.perf_counter() - begin
            true_plan = PLAN_FROM_WORLD @ true_world_from_cams
            after = position_errors(run.plan_from_cams, true_plan)
            before = position_errors(PLAN_FROM_WORLD @ drifted, true_plan)
            rotation = se3.rotation_angle(
                np.swapaxes(true_plan[:, :3, :3], 1, 2) @ run.plan_from_cams[:, :3, :3]
            )
            row = {
                "seed": "shipped" if seed is None else seed,
                "before_m": before.rms_m,
                "after_m": after.rms_m,
                "aligned_m": after.aligned_rms_m,
                "rotation_deg": float(np.rad2deg(rotation).mean()),
                "seconds": seconds,
                "peak_gb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6,
                "warnings": run.warnings,
            }
            rows.append(row)
            print(
                f"{row['seed']!s:8} {row['before_m']:9.3f} {row['after_m']:9.3f} "
                f"{row['aligned_m']:10.3f} {row['rotation_deg']:10.2f} {seconds:9.1f}  "
                + "; ".join(run.warnings),
                flush=True,
            )
    own = np.array([row["after_m"] for row in rows[1:]])
    if len(own):
        print(f"own seeds: worst {own.max():.3f} m, median {np.median(own):.3f} m")
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
