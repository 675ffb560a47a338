"""Scans whose truth is known, drawn at random: flats that planfit is given as they are, and some with what
real ones have. Stated errors are held against true ones, and of what is right nothing may be corrected.

Even numbers are for choosing, odd ones for reporting.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from buildings.judging import FALSE, judge
from buildings.rows import Row
from buildings.sites import ALL_KINDS
from calibration_cases import without_unit
from faults.images import with_faulty_sensor
from faults.inputs import DRIFT, Inputs
from faults.measure import CRASHED, REFUSED, How, KeypointsKept
from faults.plans import centre_lines, some_walls
from faults.scans import drifted, inputs_of, keep_images
from jaxtyping import Float
from scipy.stats import chi2, norm

import planfit
from planfit.adjust.uncertainty import radius_95
from planfit.errors import PlanfitError
from planfit.export.plan_files import write_plan_dxf
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

N_SCANS = 300
FIRST_SEED = 400
CAMERA = CameraOptions(width_px=320, height_px=240)
SENSOR_SIGMAS = np.array([0.01, 0.01, 0.01, 0.004, 0.004])
"""Of depth's factor and offset (m), of the focal length's factor, of the principal point by the focal
length."""
DRAWN_SIGMA_M = 0.02
"""Of walls about where they are drawn, in plans that are not exact."""


@dataclass(frozen=True)
class World:
    """What planfit is given of a flat."""

    spoil: Callable[[Inputs, np.random.Generator], Inputs]
    judged: frozenset[str] = frozenset()
    """Kinds of corrections of which none is right; of other kinds nothing is judged."""


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

    @property
    def is_honest(self) -> bool:
        """Whether nothing is wrong that could be corrected."""
        return bool(WORLDS[self.world].judged)

    def make(self, cache_dir: Path) -> Inputs:
        """Rendered once, drifted, and spoilt."""
        inputs = _flat(self.number)
        inputs = replace(inputs, scan=keep_images(inputs.scan, cache_dir / "images"))
        inputs = drifted(inputs, self.number)
        rng = np.random.default_rng([FIRST_SEED, self.number])
        return WORLDS[self.world].spoil(inputs, rng)


def _flat(number: int) -> Inputs:
    """A flat of two to eight rooms, bare or furnished, seen by either kind of sensor, with drift."""
    rng = np.random.default_rng(FIRST_SEED + number)
    n_rooms = int(rng.integers(2, 9))
    building = BuildingOptions(
        n_rooms=n_rooms,
        has_corridor=bool(rng.integers(2)),
        height_m=float(rng.uniform(2.4, 3.4)),
        furniture_per_room=int(rng.choice([0, 1, 3, 6])),
        n_columns=int(rng.choice([0, 0, 0, 2])),
        pictures_per_wall=float(rng.uniform(0.5, 2.5)),
        yaw_deg=float(rng.choice([0.0, rng.uniform(0.0, 90.0)])),
    )
    noise = (StructuredLightNoise(), TimeOfFlightNoise())[int(rng.integers(2))]
    # 15 to 20 frames a room: at fewer, neighbours share little of their views.
    walk = WalkOptions(n_frames=int(40 + n_rooms * rng.integers(10, 16)))
    options = SynthOptions(
        seed=FIRST_SEED + number, building=building, walk=walk, camera=CAMERA, depth_noise=noise
    )
    share = float(rng.uniform(0.5, 1.5))
    drift = replace(DRIFT, yaw_deg=share * DRIFT.yaw_deg, translation_m=share * DRIFT.translation_m)
    return replace(inputs_of(make_scan(options)), drift=drift)


def _as_it_is(inputs: Inputs, _rng: np.random.Generator) -> Inputs:
    return inputs


def _as_drawing(inputs: Inputs, _rng: np.random.Generator) -> Inputs:
    """Both lines of each wall, written to a drawing and read from there."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "plan.dxf"
        write_plan_dxf(path, inputs.floorplan)
        return replace(inputs, floorplan=planfit.read_floorplan(path))


def _by_axes(inputs: Inputs, rng: np.random.Generator) -> Inputs:
    return centre_lines(inputs, 0, rng)


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


WORLDS: dict[str, World] = {
    "as drawn": World(_as_it_is, ALL_KINDS),
    "walls drawn 2 cm off": World(drawn_off),
    "as a drawing's double lines": World(_as_drawing, ALL_KINDS),
    "sensor off": World(_sensor_off),
    "walls drawn as axes": World(_by_axes, ALL_KINDS - {"thickness"}),
    "plan without unit": World(_no_unit, ALL_KINDS),
    "walls 2 cm off, sensor off": World(
        lambda inputs, rng: _sensor_off(drawn_off(inputs, rng), rng)
    ),
}
"""What is wrong, by name."""
CYCLE = (
    *("as drawn", "walls drawn 2 cm off", "as drawn", "as a drawing's double lines"),
    *("as drawn", "sensor off", "walls drawn as axes", "as drawn"),
    *("plan without unit", "as drawn", "walls 2 cm off, sensor off", "as drawn"),
)
"""Three of four are honest."""


def all_cases() -> tuple[Consistency, ...]:
    """Worlds in turn, in both halves alike."""
    return tuple(Consistency(k, CYCLE[(k // 2) % len(CYCLE)]) for k in range(N_SCANS))


@dataclass(frozen=True)
class Consistent(Row):
    """What came of a case, and how stated errors compare with true ones."""

    nees_position: float | None = None
    """Squared errors of positions by their covariances, a number of each, mean over frames; 1 where they mean
    what they say."""
    nees_pose: float | None = None
    """The same of positions and rotations together."""
    within_axes: tuple[float, ...] = ()
    """Share of frames whose error along x, y and z of the plan lies in its 90 % interval."""
    within_position: float | None = None
    """Share of frames whose position lies in its 95 % ellipsoid."""
    within_pose: float | None = None
    """The same of position and rotation."""
    within_radius: float | None = None
    """Share of frames whose position lies in its 95 % radius."""

    @property
    def false(self) -> tuple[str, ...]:
        """Kinds of corrections that were announced and are none."""
        return tuple(kind for kind, (*_, is_right) in self.corrections.items() if is_right == FALSE)


def measure(case: Consistency, how: How) -> Consistent:
    """Run planfit on a case; a refusal or an error is recorded, not raised."""
    begin = time.perf_counter()
    measured = Consistent(case.number, case.name, how.digest, CRASHED)
    try:
        inputs = case.make(how.cache_dir)
        runtime = KeypointsKept(workers=1, cache_dir=how.cache_dir)
        result = planfit.refine(inputs.scan, inputs.floorplan, how.options, runtime)
        judged = judge(inputs, result, WORLDS[case.world].judged, measured)
        measured = with_consistency(judged, inputs, result)
    except PlanfitError as error:
        measured = replace(measured, exit_code=REFUSED, said=str(error))
    return replace(measured, seconds=round(time.perf_counter() - begin, 2))


def with_consistency(measured: Row, inputs: Inputs, result: RefineResult) -> Consistent:
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
    sigmas = np.sqrt(np.diagonal(of_positions, axis1=1, axis2=2))
    is_within = np.abs(errors[:, 3:]) <= norm.ppf(0.95) * sigmas
    return replace(
        measured,
        nees_position=float(by_position.mean() / 3),
        nees_pose=float(by_pose.mean() / 6),
        within_axes=tuple(is_within.mean(axis=0).tolist()),
        within_position=float(np.mean(by_position <= chi2.ppf(0.95, 3))),
        within_pose=float(np.mean(by_pose <= chi2.ppf(0.95, 6))),
        within_radius=float(np.mean(lengths <= radius_95(of_positions))),
    )


def squares(
    errors: Float[np.ndarray, "n d"], covariances: Float[np.ndarray, "n d d"]
) -> Float[np.ndarray, " n"]:
    """Squared errors by their covariances (Mahalanobis)."""
    return np.einsum("ni,ni->n", errors, np.linalg.solve(covariances, errors[:, :, None])[:, :, 0])
