"""Make a small synthetic scan, refine its drifted poses against its plan, and compare with the truth.

Takes about ten seconds; writes nothing.
"""

import planfit
from planfit.evaluation import position_errors
from planfit.synth import BuildingOptions, CameraOptions, SynthOptions, WalkOptions, make_scan

options = SynthOptions(
    building=BuildingOptions(n_rooms=2),
    walk=WalkOptions(n_frames=60),
    camera=CameraOptions(width_px=320, height_px=240),
)
synthetic = make_scan(options)
result = planfit.refine(synthetic.scan, synthetic.floorplan)
for name, poses in (
    ("before", synthetic.scan.world_from_cams),
    ("after", result.world_from_cams),
):
    errors = position_errors(poses, synthetic.true_world_from_cams)
    print(f"{name}: position error {errors.rms_m:.3f} m RMS")
