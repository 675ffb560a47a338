"""Tell how good poses are: against true ones, against the plan, and by the map that they make.

On the command line: `planfit evaluate OUT --truth FILE`; docs/metrics.md defines each metric. Takes a few
seconds; writes nothing.
"""

import numpy as np

import planfit
from planfit.evaluation import EvaluateOptions, MapOptions, Truth
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

truth = Truth(np.arange(len(scan)), synthetic.true_world_from_cams)
options = EvaluateOptions(delta_m=2.0, map=MapOptions(frame_step=2))
# In place of a result, poses (n, 4, 4) of any kind will do: those of another program, say.
evaluation = planfit.evaluate(scan, result, truth=truth, options=options)
for metric in evaluation.metrics.values():  # lower is better in all of them
    print(f"{metric.meaning:45} {metric.before:9.3f} to {metric.after:9.3f} {metric.unit}")
for check in result.checks:  # what planfit knows without any truth
    print(f"check {check.name}: {check.before:.3g} to {check.after:.3g} {check.unit}")
