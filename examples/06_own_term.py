"""Add a term of your own to the adjustment: cameras on a cart, whose height over the floor is known.

docs/extending.md says what the solver asks of a term. Takes a few seconds; writes nothing.
"""

from dataclasses import dataclass

import numpy as np

from planfit.lsq.linear.normal_equations import NormalBlocks
from planfit.lsq.solver import solve
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.prepare import extract_observations, prepare
from planfit.runtime import Runtime, StageTimer
from planfit.synth import CameraOptions, SynthOptions, WalkOptions, make_scan


@dataclass(frozen=True)
class HeightTerm:
    """Sum over frames of ((height of the camera - height_m) / sigma_m)^2; z is up in the level frame."""

    height_m: float
    sigma_m: float
    name: str = "height"

    def reweight(self, level_from_cams: np.ndarray) -> tuple["HeightTerm", float]:
        return self, self.cost(level_from_cams)  # not robust: nothing to freeze

    def cost(self, level_from_cams: np.ndarray) -> float:
        return 0.5 * float(np.sum((self._residuals(level_from_cams) / self.sigma_m) ** 2))

    def normal_blocks(self, level_from_cams: np.ndarray) -> NormalBlocks:
        n = len(level_from_cams)
        along = np.array([0, 0, 0, 0, 0, 1.0])  # of (turn, shift), the shift along z alone counts
        gradient = np.outer(self._residuals(level_from_cams), along) / self.sigma_m**2
        blocks = np.tile(np.outer(along, along) / self.sigma_m**2, (n, 1, 1))
        return NormalBlocks(np.arange(n), np.arange(n), blocks, gradient)

    def _residuals(self, level_from_cams: np.ndarray) -> np.ndarray:
        return level_from_cams[:, 2, 3] - self.height_m


walk, camera = WalkOptions(n_frames=30, sway_m=0.0), CameraOptions(width_px=160, height_px=120)
synthetic = make_scan(SynthOptions(walk=walk, camera=camera))
options, clock = RefineOptions(), StageTimer(Runtime())
seen = extract_observations(synthetic.scan, options, Runtime(), clock)
prepared = prepare(synthetic.scan, seen, options, clock)
poses, measurements = prepared.level_from_keys, prepared.measurements
terms = [*measurements.terms(options.adjust), measurements.pose_prior(poses, options.adjust)]
for more in ([], [HeightTerm(height_m=1.5, sigma_m=0.01)]):
    solution = solve([*terms, *more], poses, options.adjust.solver)
    off = np.sqrt(np.mean((solution.target_from_cams[:, 2, 3] - 1.5) ** 2))
    print(
        f"{'with' if more else 'without'} the term: heights {off:.4f} m off, {solution.stop.value}"
    )
