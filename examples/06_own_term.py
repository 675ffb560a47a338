"""Add a term of your own to the adjustment: cameras on a cart, whose height over the floor is known.

docs/api/engine.md says what a term is. Takes a few seconds; writes nothing.
"""

import numpy as np

from planfit.lsq import Problem, ResidualTerm
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.prepare import StageTimer, extract_observations, prepare
from planfit.runtime import Runtime
from planfit.synth import CameraOptions, SynthOptions, WalkOptions, make_scan

HEIGHT_M = 1.5
walk, camera = WalkOptions(n_frames=30, sway_m=0.0), CameraOptions(width_px=160, height_px=120)
synthetic = make_scan(SynthOptions(walk=walk, camera=camera))
options, timer = RefineOptions(), StageTimer(Runtime())
observations = extract_observations(synthetic.scan, options, Runtime(), timer)
prepared = prepare(synthetic.scan, observations, options, timer)
poses, measurements = prepared.level_from_keys, prepared.measurements

# Each residual names one pose, and is one number: the height of its camera; z is up in the level frame.
every = np.arange(len(poses))[:, None]
heights = ResidualTerm(every, lambda at: at[:, 0, 2:3, 3] - HEIGHT_M, sigma=0.01, name="height")
terms = [*measurements.terms(options.adjust), measurements.pose_prior(poses, options.adjust)]
for more in ([], [heights]):
    solution = Problem([*terms, *more], poses).solve(options.adjust.solver)
    off = np.sqrt(np.mean((solution.target_from_cams[:, 2, 3] - HEIGHT_M) ** 2))
    print(
        f"{'with' if more else 'without'} the term: heights {off:.4f} m off, {solution.stop.value}"
    )
