"""Position error of a scan without a plan: drift of our own put on its poses, closed by matches and floor.

    python benchmarks/no_plan.py [--scan FOLDER] [--seeds 5] [--json FILE]

The given poses (of 7-Scenes: KinectFusion's) stand for the truth; a random walk goes on top of them, of
0.15 deg about the vertical and 0.02 m a frame, 0.3 of both about and along the other axes, as measured
on the project's real scan. Gravity, floor and walls are found by geometry; walls are not used. Errors
are RMS over all frames after rigid alignment, as nothing but a plan tells where the scan is.
"""

import argparse
import dataclasses
import json
import os
import tempfile
import time
from pathlib import Path

import numpy as np

import planfit
from planfit.evaluation import position_errors
from planfit.runtime import Runtime
from planfit.segmentation import SegmentationOptions, find_gravity
from planfit.synth import DriftOptions, drift_poses

DEFAULT = Path(os.environ.get("PLANFIT_SHARED", "../shared/data")) / "kitchen"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scan", type=Path, default=DEFAULT)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    scan = planfit.read_scan(arguments.scan)
    options = planfit.RefineOptions(segmentation=SegmentationOptions(back_end="geometry"))
    given = scan.world_from_cams
    rows = []
    print("seed   before m   after m   falls by   seconds")
    for seed in range(arguments.seeds):
        # A cache a seed: neither gravity nor matches may know the poses before drift.
        with tempfile.TemporaryDirectory() as cache:
            runtime = Runtime(cache_dir=Path(cache))
            up = find_gravity(scan, runtime).up_world
            drifted = drift_poses(given, DriftOptions(), np.random.default_rng(seed), up)
            begin = time.perf_counter()
            spoiled = dataclasses.replace(scan, world_from_cams=drifted)
            result = planfit.refine(spoiled, None, options, runtime)
            seconds = time.perf_counter() - begin
        before = position_errors(drifted, given).aligned_rms_m
        after = position_errors(result.world_from_cams, given).aligned_rms_m
        rows.append(
            {
                "seed": seed,
                "before_m": before,
                "after_m": after,
                "outcome": result.verdict.outcome.value,
                "seconds": seconds,
            }
        )
        print(
            f"{seed:4} {before:10.3f} {after:9.3f} {100 * (1 - after / before):8.0f} % {seconds:9.1f}",
            flush=True,
        )
    falls = [1 - row["after_m"] / row["before_m"] for row in rows]
    print(f"falls by {100 * np.mean(falls):.0f} % on average, {100 * min(falls):.0f} % at least")
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
