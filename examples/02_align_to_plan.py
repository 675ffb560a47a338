"""Align a scan with a plan whose scale nobody knows, and look at what else would fit.

On the command line: `planfit align SCAN PLAN -o OUT`. A plan of pixels has no unit; here one is made by
drawing a plan at 37 units a metre. Takes a few seconds; writes nothing.
"""

from dataclasses import replace

import numpy as np

from planfit.pipeline.align import align
from planfit.synth import BuildingOptions, CameraOptions, SynthOptions, WalkOptions, make_scan

UNITS_PER_METRE = 37.0

synthetic = make_scan(
    SynthOptions(
        building=BuildingOptions(n_rooms=2),
        walk=WalkOptions(n_frames=30),
        camera=CameraOptions(width_px=160, height_px=120),
        world="moved",  # the scan does not say where it is
    )
)
drawn = synthetic.floorplan.scaled(UNITS_PER_METRE)
drawn = replace(drawn, is_metric=False)

found = align(synthetic.scan, drawn)
alignment, walls = found.alignment, found.walls

print(f"{len(walls.xy)} samples of wall; one unit is {alignment.metres_per_unit:.5f} m")
print(f"  true: {1 / UNITS_PER_METRE:.5f} m; sigma: {alignment.scale_sigma:.1%}")
print(
    f"sure: {alignment.is_sure}, ahead of the next hypothesis by {alignment.margin:.0%} of the wall"
)
for number, hypothesis in enumerate(alignment.candidates, start=1):
    print(
        f"  hypothesis {number}: {hypothesis.score:.0%} of the wall explained, yaw "
        f"{np.rad2deg(hypothesis.yaw):.1f} deg, {hypothesis.metres_per_unit:.5f} m a unit"
    )
print(*alignment.warnings, sep="\n")
# Another hypothesis than the best: align(scan, plan, RefineOptions(align=AlignOptions(candidate=2))).
