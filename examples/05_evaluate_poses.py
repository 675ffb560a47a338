"""Tell how good poses are: against true ones, against the plan, and by the map that they make.

On the command line: `planfit evaluate OUT --truth FILE`; docs/metrics.md defines each figure. Takes a few
seconds; writes nothing.
"""

import numpy as np

import planfit
from planfit.evaluate import MapOptions, Truth, map_figures, surface_figures, trajectory_figures
from planfit.runtime import Runtime
from planfit.synth import BuildingOptions, CameraOptions, SynthOptions, WalkOptions, make_scan

synthetic = make_scan(
    SynthOptions(
        building=BuildingOptions(n_rooms=2),
        walk=WalkOptions(n_frames=30),
        camera=CameraOptions(width_px=160, height_px=120),
    )
)
scan = synthetic.scan
result = planfit.refine(scan, synthetic.floorplan)

before, after = scan.world_from_cams, result.world_from_cams  # any two sets of poses would do
truth = Truth(np.arange(len(scan)), synthetic.true_world_from_cams)
figures = [
    *trajectory_figures(before, after, truth, delta_m=2.0),
    *surface_figures(
        result.structure, result.floorplan, result.initial_plan_from_cams, result.plan_from_cams
    ),
    *map_figures(scan, before, after, MapOptions(stride_px=4), Runtime()),
]
for figure in figures:  # lower is better in all of them
    print(f"{figure.meaning:45} {figure.before:9.3f} to {figure.after:9.3f} {figure.unit}")
for check in result.checks:  # what planfit knows without any truth
    print(f"check {check.name}: {check.before:.3g} to {check.after:.3g} {check.unit}")
