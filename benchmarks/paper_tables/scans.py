"""The scans of the benchmark: two sets of five synthetic ones, fixed by their seeds.

The paper's own scans are not to be had: Redwood's apartments with plans made of their laser scans, and scans
by phone with plans by architects. The sets have the character of these two.
"""

from dataclasses import dataclass, replace

from drawn_plans.habits import DrawingHabits

from planfit.synth import (
    BuildingOptions,
    CameraOptions,
    DriftOptions,
    StructuredLightNoise,
    SynthOptions,
    TimeOfFlightNoise,
    WalkOptions,
)

DESCENT_SET = "descent"
"""Name of the set that `descent_scan` is alone in."""


@dataclass(frozen=True)
class BenchScan:
    """A synthetic scan of the benchmark."""

    set_name: str
    name: str
    synth: SynthOptions
    habits: DrawingHabits | None
    """How the plan departs from the building; None for the true one."""
    lambda_walls: float
    """The paper's weight of the walls for scans of this kind."""


def paper_scans() -> tuple[BenchScan, ...]:
    """Five scans of each set: 4 to 10 rooms, 300 to 1,000 frames."""
    rooms_frames = ((4, 300), (5, 350), (6, 450), (8, 650), (10, 1000))
    redwood = [_redwood(11 + k, *size) for k, size in enumerate(rooms_frames)]
    phone = [_phone(21 + k, *size) for k, size in enumerate(rooms_frames)]
    return (*redwood, *phone)


def small_scans() -> tuple[BenchScan, ...]:
    """One small scan of each set, to try the benchmark in a few minutes."""
    return (_redwood(11, 2, 60), _phone(21, 2, 60))


def descent_scan() -> BenchScan:
    """The scan of the paper's own descent: whole descents of larger ones take hours."""
    return replace(small_scans()[0], set_name=DESCENT_SET, name="redwood-like, small")


_CAMERA = CameraOptions(width_px=320, height_px=240)


def _redwood(seed: int, n_rooms: int, n_frames: int) -> BenchScan:
    """A structured-light camera, poses out of a reconstruction that closed most loops, the true plan."""
    synth = SynthOptions(
        seed=seed,
        building=BuildingOptions(n_rooms=n_rooms),
        walk=WalkOptions(n_frames=n_frames),
        camera=_CAMERA,
        depth_noise=StructuredLightNoise(),
        drift=DriftOptions(yaw_deg=0.05, translation_m=0.007),
        world="moved",
    )
    return BenchScan("redwood-like", f"redwood-like {seed}", synth, None, lambda_walls=0.6)


def _phone(seed: int, n_rooms: int, n_frames: int) -> BenchScan:
    """A phone's time-of-flight camera, drift with jumps of tracking, a plan with an architect's errors."""
    synth = SynthOptions(
        seed=seed,
        building=BuildingOptions(n_rooms=n_rooms, yaw_deg=7.0 * (seed % 5)),
        walk=WalkOptions(n_frames=n_frames),
        camera=replace(_CAMERA, exposure_std=0.05, noise_levels=2.5),
        depth_noise=TimeOfFlightNoise(),
        drift=DriftOptions(yaw_deg=0.12, translation_m=0.015, jumps_per_100_frames=1.0),
        world="moved",
    )
    return BenchScan("phone-like", f"phone-like {seed}", synth, DrawingHabits(), lambda_walls=0.5)
