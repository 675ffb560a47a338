"""Add a term of your own to the adjustment: cameras on a cart, whose height over the floor is known.

docs/api/engine.md says what a term is. Takes a few seconds; writes nothing.
"""

import numpy as np

import planfit
from planfit import synth
from planfit.lsq import ResidualTerm

HEIGHT_M = 1.5
walk = synth.WalkOptions(n_frames=30, sway_m=0.0)
camera = synth.CameraOptions(width_px=160, height_px=120)
synthetic = synth.make_scan(synth.SynthOptions(walk=walk, camera=camera))
observations = planfit.extract_observations(synthetic.scan)

# Each residual names one pose (plan_from_cam, z up) and is one number: how far its camera is from the height.
every = np.arange(len(synthetic.scan))[:, None]
heights = ResidualTerm(every, lambda at: at[:, 0, 2:3, 3] - HEIGHT_M, sigma=0.01, name="height")
for more in ([], [heights]):
    result = planfit.refine(
        synthetic.scan, synthetic.floorplan, observations=observations, extra_terms=more
    )
    off = np.sqrt(np.mean((result.plan_from_cams[:, 2, 3] - HEIGHT_M) ** 2))
    print(f"{'with' if more else 'without'} the term: heights {off:.4f} m off")
