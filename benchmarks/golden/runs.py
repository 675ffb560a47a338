"""The eight runs: four kinds of scan and four kinds of plan, each twice, all made from fixed seeds."""

import time
from dataclasses import dataclass, replace

import planfit
from golden.kept import Run
from golden.plans import PLANS
from planfit.runtime import Runtime
from planfit.synth import (
    BuildingOptions,
    CameraOptions,
    DriftOptions,
    SynthOptions,
    TimeOfFlightNoise,
    WalkOptions,
    make_scan,
)
from planfit.tracking import KeyframeOptions

_SMALL = CameraOptions(width_px=200, height_px=150)
_DRIFT = DriftOptions(yaw_deg=0.5, translation_m=0.03)
_TWO_ROOMS = BuildingOptions(n_rooms=2)

SCANS = {
    # Structured light in the plan's axes, with masks.
    "masks": SynthOptions(
        seed=5, building=_TWO_ROOMS, walk=WalkOptions(n_frames=50), camera=_SMALL, drift=_DRIFT
    ),
    # A phone's depth in axes of its own, with masks, and a tracker that jumps.
    "phone": SynthOptions(
        seed=8,
        building=BuildingOptions(n_rooms=3),
        walk=WalkOptions(n_frames=60),
        camera=_SMALL,
        depth_noise=TimeOfFlightNoise(),
        drift=replace(_DRIFT, jumps_per_100_frames=4, jump_m=0.6, jump_yaw_deg=10),
        world="moved",
    ),
    # Neither colour nor masks: matches and labels come from geometry.
    "depth": SynthOptions(
        seed=6,
        building=_TWO_ROOMS,
        walk=WalkOptions(n_frames=50),
        camera=CameraOptions(width_px=160, height_px=120),
        drift=_DRIFT,
        has_color=False,
        has_labels=False,
    ),
    # At a higher rate: a third of the frames are keyframes.
    "dense": SynthOptions(
        seed=4,
        building=_TWO_ROOMS,
        walk=WalkOptions(n_frames=240),
        camera=_SMALL,
        drift=DriftOptions(yaw_deg=0.08, translation_m=0.006),
    ),
}
"""By name."""
OPTIONS = {
    "dense": planfit.RefineOptions(keyframes=KeyframeOptions(min_frames=0, max_rotation_deg=15.0))
}
"""Of scans that are not refined with the usual ones."""


@dataclass(frozen=True)
class Case:
    """A kind of scan on a kind of plan."""

    scan: str
    plan: str

    @property
    def name(self) -> str:
        """For people, and in the kept file."""
        return f"{self.scan}, {self.plan}"


CASES = (
    Case("masks", "faces"),
    Case("masks", "centre lines"),
    Case("phone", "drawing"),
    Case("phone", "no plan"),
    Case("depth", "faces"),
    Case("depth", "no plan"),
    Case("dense", "centre lines"),
    Case("dense", "drawing"),
)


@dataclass(frozen=True)
class Performed:
    """A run, and what it took."""

    run: Run
    cpu_s: float
    wall_s: float


def perform(case: Case, workers: int) -> Performed:
    """Make the scan and the plan, and refine; nothing is taken from a cache."""
    wall, cpu = time.perf_counter(), time.process_time()
    made = make_scan(SCANS[case.scan])
    plan = PLANS[case.plan](made.floorplan)
    result = planfit.refine(made.scan, plan, OPTIONS.get(case.scan), Runtime(workers=workers))
    scale = float("nan") if result.alignment is None else result.alignment.metres_per_unit
    run = Run(case.name, result.plan_from_cams, result.verdict.outcome.value, float(scale))
    return Performed(run, time.process_time() - cpu, time.perf_counter() - wall)
