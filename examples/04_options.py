"""Refine with options of your own: here, with walls of other weights on a plan that is wrong.

On the command line: `planfit refine SCAN -o OUT --adjust.walls.weight 4`; see docs/options.md.
Takes a few seconds; writes nothing.
"""

from dataclasses import replace

import numpy as np

import planfit
from planfit.evaluation import position_errors
from planfit.synth import BuildingOptions, CameraOptions, SynthOptions, WalkOptions, make_scan

synthetic = make_scan(
    SynthOptions(
        building=BuildingOptions(n_rooms=2),
        walk=WalkOptions(n_frames=30),
        camera=CameraOptions(width_px=160, height_px=120),
    )
)
scan, plan = synthetic.scan, synthetic.floorplan

# A plan with errors: every fifth face is drawn 0.25 m off.
ends = plan.ends.copy()
moved = np.arange(0, len(plan), 5)
ends[moved] += 0.25 * plan.normals[moved, None]
wrong = replace(plan, ends=ends, fingerprint="with moved faces")

errors = position_errors(scan.world_from_cams, synthetic.true_world_from_cams)
print(f"before: position error {errors.rms_m:.3f} m RMS")
default = planfit.RefineOptions()
for name, options in (
    ("default", default),
    ("walls of four times the weight", default.with_("adjust.walls.weight", 4.0)),
    ("without walls", default.with_("adjust.walls.weight", 0.0)),
):
    result = planfit.refine(scan, wrong, options)
    errors = position_errors(result.world_from_cams, synthetic.true_world_from_cams)
    print(f"after, {name}: position error {errors.rms_m:.3f} m RMS")
    for term, (before, after) in result.cost_by_term.items():
        print(f"  cost of {term}: {before:.1f} to {after:.1f}")
