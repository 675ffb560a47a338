"""Scans whose truth is known, to hold stated errors against true ones: small flats, each with what real
ones have.

Even numbers are for choosing, odd ones for reporting.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from calibration_cases import without_unit
from faults.images import with_faulty_sensor
from faults.inputs import Inputs
from faults.measure import CRASHED, REFUSED, How, KeypointsKept, Measured, judge
from faults.plans import some_walls
from faults.scans import drifted, inputs_of, keep_images
from jaxtyping import Float
from scipy.stats import chi2

import planfit
from planfit.adjust.uncertainty import radius_95
from planfit.errors import PlanfitError
from planfit.geometry import se3
from planfit.geometry.calibration import SensorCalibration
from planfit.pipeline.result import RefineResult
from planfit.synth import (
    BuildingOptions,
    CameraOptions,
    StructuredLightNoise,
    SynthOptions,
    TimeOfFlightNoise,
    WalkOptions,
    make_scan,
)

N_SCANS = 30
FIRST_SEED = 400
N_FRAMES = 80
CAMERA = CameraOptions(width_px=320, height_px=240)
SENSOR_SIGMAS = np.array([0.01, 0.01, 0.01, 0.004, 0.004])
"""Of depth's factor and offset (m), of the focal length's factor, of the principal point by the focal
length."""
DRAWN_SIGMA_M = 0.02
"""Of walls about where they are drawn, in plans that are not exact."""


@dataclass(frozen=True)
class Consistency:
    """A scan, and what is wrong of it."""

    number: int
    world: str
    """In words, one of `WORLDS`."""

    @property
    def name(self) -> str:
        """In words; no two cases share it."""
        return f"flat {self.number:02d}, {self.world}"

    @property
    def is_for_choosing(self) -> bool:
        """Whether figures of it may decide anything."""
        return self.number % 2 == 0

    def make(self, cache_dir: Path) -> Inputs:
        """Rendered once, drifted, and spoilt."""
        inputs = _flat(self.number)
        inputs = replace(inputs, scan=keep_images(inputs.scan, cache_dir / "images"))
        inputs = drifted(inputs, self.number)
        return WORLDS[self.world](inputs, np.random.default_rng([FIRST_SEED, self.number]))


def _flat(number: int) -> Inputs:
    """A flat of two to five rooms, furnished or hardly, seen by either kind of sensor."""
    rng = np.random.default_rng(FIRST_SEED + number)
    building = BuildingOptions(
        n_rooms=int(rng.integers(2, 6)), furniture_per_room=int(rng.choice([1, 6]))
    )
    noise = (StructuredLightNoise(), TimeOfFlightNoise())[int(rng.integers(2))]
    walk = WalkOptions(n_frames=N_FRAMES)
    options = SynthOptions(
        seed=FIRST_SEED + number, building=building, walk=walk, camera=CAMERA, depth_noise=noise
    )
    return inputs_of(make_scan(options))


def _as_it_is(inputs: Inputs, _rng: np.random.Generator) -> Inputs:
    return inputs


def drawn_off(inputs: Inputs, rng: np.random.Generator) -> Inputs:
    """Every wall stands `DRAWN_SIGMA_M` off where it is drawn, across, both of its sides alike."""
    plan = inputs.floorplan
    ends = plan.ends.copy()
    for faces in some_walls(plan, 1.1, rng):
        longest = faces[np.argmax(plan.lengths[faces])]
        ends[faces] += rng.normal(0.0, DRAWN_SIGMA_M) * plan.normals[longest]
    return inputs.with_faces(ends, plan.normals, plan.is_oriented)


def _sensor_off(inputs: Inputs, rng: np.random.Generator) -> Inputs:
    """A sensor that errs as real ones do, in all that is the same in every frame."""
    depth, offset_m, focal, x, y = rng.normal(0.0, 1.0, 5) * SENSOR_SIGMAS
    undone_by = SensorCalibration(1 + depth, offset_m, 0.0, 1 + focal, 1.0, x, y)
    return with_faulty_sensor(inputs, undone_by, f"sensor {rng.integers(2**31)}")


def _no_unit(inputs: Inputs, _rng: np.random.Generator) -> Inputs:
    return without_unit(inputs)


WORLDS: dict[str, Callable[[Inputs, np.random.Generator], Inputs]] = {
    "as drawn": _as_it_is,
    "walls drawn 2 cm off": drawn_off,
    "sensor off": _sensor_off,
    "plan without unit": _no_unit,
    "walls 2 cm off, sensor off": lambda inputs, rng: _sensor_off(drawn_off(inputs, rng), rng),
}
"""What is wrong, by name."""


def all_cases() -> tuple[Consistency, ...]:
    """Each world as often, in both halves alike."""
    names = list(WORLDS)
    return tuple(Consistency(k, names[(k // 2) % len(names)]) for k in range(N_SCANS))


@dataclass(frozen=True)
class Consistent(Measured):
    """What came of a case, and how stated errors compare with true ones."""

    nees_position: float | None = None
    """Squared errors of positions by their covariances, a number of each, mean over frames; 1 where they mean
    what they say."""
    nees_pose: float | None = None
    """The same of positions and rotations together."""
    within_position: float | None = None
    """Share of frames whose position lies in its 95 % ellipsoid."""
    within_pose: float | None = None
    """The same of position and rotation."""
    within_radius: float | None = None
    """Share of frames whose position lies in its 95 % radius."""


def measure(case: Consistency, how: How) -> Consistent:
    """Run planfit on a case; a refusal or an error is recorded, not raised."""
    begin = time.perf_counter()
    nothing = Consistent(case.number, case.name, how.digest, CRASHED)
    try:
        inputs = case.make(how.cache_dir)
        runtime = KeypointsKept(workers=1, cache_dir=how.cache_dir)
        result = planfit.refine(inputs.scan, inputs.floorplan, how.options, runtime)
        measured = with_consistency(judge(inputs, result, nothing), inputs, result)
    except PlanfitError as error:
        measured = replace(nothing, exit_code=REFUSED, said=str(error))
    return replace(measured, seconds=round(time.perf_counter() - begin, 2))


def with_consistency(measured: Measured, inputs: Inputs, result: RefineResult) -> Consistent:
    """What was stated of a result beside the truth, on the true plan."""
    assert isinstance(measured, Consistent)
    assert result.floorplan is not None
    true = inputs.true_plan_from_world @ inputs.true_world_from_cams
    found = result.plan_from_cams
    turned = se3.log_so3(found[:, :3, :3] @ np.swapaxes(true[:, :3, :3], 1, 2))
    positions = inputs.in_true_plan(found[:, :3, 3], result.floorplan)
    errors = np.concatenate([turned, positions - true[:, :3, 3]], axis=1)
    covariances = result.evidence.pose_covariances
    of_positions = covariances[:, 3:, 3:]
    by_position, by_pose = squares(errors[:, 3:], of_positions), squares(errors, covariances)
    lengths = np.linalg.norm(errors[:, 3:], axis=1)
    return replace(
        measured,
        nees_position=float(by_position.mean() / 3),
        nees_pose=float(by_pose.mean() / 6),
        within_position=float(np.mean(by_position <= chi2.ppf(0.95, 3))),
        within_pose=float(np.mean(by_pose <= chi2.ppf(0.95, 6))),
        within_radius=float(np.mean(lengths <= radius_95(of_positions))),
    )


def squares(
    errors: Float[np.ndarray, "n d"], covariances: Float[np.ndarray, "n d d"]
) -> Float[np.ndarray, " n"]:
    """Squared errors by their covariances (Mahalanobis)."""
    return np.einsum("ni,ni->n", errors, np.linalg.solve(covariances, errors[:, :, None])[:, :, 0])
