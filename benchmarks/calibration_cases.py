"""Faults of a depth camera, put on the images and cameras of scans, and what came of them.

Depth that a sensor reports too long by 0.01 z^2 is such that true = d - 0.01 d^2 of the reported d: what
planfit looks for undoes every fault exactly, so what was put in is what should be found.
"""

import time
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from faults.images import with_faulty_sensor
from faults.inputs import Inputs
from faults.measure import CRASHED, How, KeypointsKept, Measured, base_inputs, judge
from faults.poses import delayed
from faults.scans import AT_RATE, RATE_HZ, drifted

import planfit
from planfit.adjust.calibration import SHARED
from planfit.errors import PlanfitError
from planfit.geometry import se3
from planfit.geometry.calibration import NOMINAL, PARAMETERS, SensorCalibration
from planfit.geometry.camera import Camera
from planfit.pipeline.result import RefineResult

UNITS_PER_METRE = 37.0
"""Of a plan that does not say its unit."""
VGA_WIDTH = 640
CLOCK = "clock_s"
"""How much later than their poses images were taken; all else that is found is of the camera."""


@dataclass(frozen=True)
class SensorFault:
    """What a depth camera gets wrong, by what undoes it."""

    name: str
    depth: SensorCalibration = NOMINAL
    focal_error: float = 0.0
    """Focal lengths in the file over the true ones, less one."""
    principal_px: float = 0.0
    """Principal point in the file less the true one, x, in pixels of an image 640 wide."""
    late_s: float = 0.0
    """How much later than their poses images were taken."""

    def undone_by(self, true: Camera) -> SensorCalibration:
        """The calibration that should be found of a camera."""
        focal = 1.0 / (1.0 + self.focal_error)
        shift = self.principal_px * true.width / VGA_WIDTH
        return replace(self.depth, focal_scale=focal, principal_x=-shift * focal / true.fx)


def _longer(share: float) -> SensorCalibration:
    return SensorCalibration(depth_scale=1 / (1 + share))


FAULTLESS = SensorFault("faultless")
HELD = SensorFault("faultless, not calibrated")
"""As planfit was before it looked for a calibration."""
FAULTS = (
    *(SensorFault(f"depth x{1 + e:.2f}", _longer(e)) for e in (-0.05, -0.02, 0.02, 0.05)),
    SensorFault("depth +5 cm", SensorCalibration(depth_offset_m=-0.05)),
    SensorFault("depth -3 cm", SensorCalibration(depth_offset_m=0.03)),
    SensorFault("depth +0.01 z^2", SensorCalibration(depth_quadratic_per_m=-0.01)),
    *(SensorFault(f"focal {e:+.0%}", focal_error=e) for e in (-0.05, -0.02, 0.02, 0.05)),
    SensorFault("principal point 8 px", principal_px=8.0),
    SensorFault("depth x1.02, focal -5%", _longer(0.02), focal_error=-0.05),
    SensorFault("depth +5 cm, focal +2%", SensorCalibration(depth_offset_m=-0.05), 0.02),
    SensorFault("depth x0.95, principal point 8 px", _longer(-0.05), principal_px=8.0),
)
CLOCKS = (
    SensorFault("clock 30 ms", late_s=0.03),
    SensorFault("clock 100 ms", late_s=0.1),
    SensorFault("clock -100 ms", late_s=-0.1),
    SensorFault("clock 30 ms, depth x1.05", _longer(0.05), late_s=0.03),
)
"""Put on scans of 30 frames a second alone: a clock is no matter of frames that are seconds apart."""

SCANS: tuple[tuple[str, int, bool], ...] = (
    ("conslam", 1, True),
    ("conslam", 2, True),
    ("conslam", 4, True),
    ("kitchen", 1, True),
    ("flat, moved", 0, True),
    ("open plan", 0, False),
    ("one room", 0, True),
    ("flat, phone", 0, True),
    ("open plan, phone", 0, False),
    ("two rooms, phone", 0, True),
)
"""Scan, seed of its drift, and whether the plan says its unit. What decides in `CalibrationPriors` was
chosen on ConSLAM's drifts 0 and 3, the flat's drifts 1 and 2, the offices' drifts 1 and 2, and the kitchen's
drift 0, none of which is here."""


@dataclass(frozen=True)
class SensorCase:
    """A scan with a drift, and a fault of its sensor."""

    scan: str
    drift_seed: int
    has_unit: bool
    fault: SensorFault

    @property
    def setting(self) -> str:
        """Without the fault: cases that share it are compared."""
        return f"{self.scan}, drift {self.drift_seed}" + ("" if self.has_unit else ", unit unknown")

    @property
    def name(self) -> str:
        """In words; no two cases share it."""
        return f"{self.setting}: {self.fault.name}"

    @property
    def number(self) -> int:
        """Of the name, so that a case keeps its figures wherever it stands in the list."""
        return zlib.crc32(self.name.encode())

    def spoil(self, inputs: Inputs) -> Inputs:
        """Drifted inputs with the fault."""
        if not self.has_unit:
            inputs = without_unit(inputs)
        if self.fault.late_s:
            inputs = late(inputs, self.fault.late_s)
        if self.undone_by(inputs) == NOMINAL:
            return inputs
        return with_faulty_sensor(inputs, self.undone_by(inputs), f"sensor {self.fault.name}")

    def undone_by(self, inputs: Inputs) -> SensorCalibration:
        """What should be found."""
        return self.fault.undone_by(inputs.scan.cameras[0])


def late(inputs: Inputs, late_s: float) -> Inputs:
    """Images taken so much later than the poses that a tracker with the same drift gives them."""
    recorded, true = inputs.scan.world_from_cams, inputs.true_world_from_cams
    before = delayed(inputs.with_poses(true), late_s * RATE_HZ).scan.world_from_cams
    return inputs.with_poses(recorded @ se3.inverse(true) @ before)


def without_unit(inputs: Inputs) -> Inputs:
    """The same plan, drawn in a unit that nothing tells."""
    drawn = inputs.floorplan.scaled(UNITS_PER_METRE)
    source = replace(drawn.source, unit="unknown", unit_from="")
    return replace(
        inputs,
        floorplan=replace(
            drawn, is_metric=False, source=source, fingerprint=f"{drawn.fingerprint}u"
        ),
        given_from_true=UNITS_PER_METRE * inputs.given_from_true,
    )


def all_cases() -> tuple[SensorCase, ...]:
    """Every fault on every scan; the faultless ones first, as all others are held against them."""
    of_cameras = [
        SensorCase(*scan, fault) for fault in (FAULTLESS, HELD, *FAULTS) for scan in SCANS
    ]
    of_clocks = [
        SensorCase(scan.name, 0, True, fault)
        for fault in (FAULTLESS, HELD, *CLOCKS)
        for scan in AT_RATE
    ]
    return (*of_cameras, *of_clocks)


def choose(
    cases: Sequence[SensorCase], only: str = "", scans: Sequence[str] = ()
) -> list[SensorCase]:
    """Cases whose names hold one of the words (`|` between), on these scans or scans with drift
    (all where empty), with the
    faultless ones that they are held against."""
    words = [word.strip().lower() for word in only.split("|") if word.strip()]
    here = [case for case in cases if not scans or {case.scan, case.setting} & set(scans)]
    chosen = [c for c in here if not words or any(word in c.name.lower() for word in words)]
    settings = {case.setting for case in chosen}
    return [
        case
        for case in here
        if case in chosen or (case.fault is FAULTLESS and case.setting in settings)
    ]


@dataclass(frozen=True)
class Calibrated(Measured):
    """What came of a case, and of its sensor."""

    put_in: dict[str, float] = field(default_factory=dict)
    """Departures that should be found, but for 0."""
    found: dict[str, float] = field(default_factory=dict)
    """Departures that were corrected."""
    asked: dict[str, float] = field(default_factory=dict)
    """Departures as they were estimated, kept or not."""
    sigmas: dict[str, float] = field(default_factory=dict)
    """Standard deviations of `asked`."""
    implausible: tuple[str, ...] = ()
    """What no sensor does, so that nothing was corrected."""


def measure(case: SensorCase, how: How) -> Calibrated:
    """Run planfit on a case; a refusal or an error is recorded, not raised."""
    begin = time.perf_counter()
    measured = _measure(case, how)
    return replace(measured, seconds=round(time.perf_counter() - begin, 2))


def _measure(case: SensorCase, how: How) -> Calibrated:
    nothing = Calibrated(case.number, case.name, how.digest, CRASHED)
    try:
        base = drifted(base_inputs(case.scan, how.cache_dir), case.drift_seed)
        inputs = case.spoil(base)
        options = how.options
        if case.fault == HELD:
            options = replace(options, calibration=replace(options.calibration, is_on=False))
        runtime = KeypointsKept(workers=1, cache_dir=how.cache_dir)
        result = planfit.refine(inputs.scan, inputs.floorplan, options, runtime)
        departures = case.undone_by(base).vector - NOMINAL.vector
        put_in = {name: float(d) for name, d in zip(PARAMETERS, departures, strict=True) if d}
        if case.fault.late_s:
            put_in[CLOCK] = case.fault.late_s
        return _with_sensor(judge(inputs, result, nothing), put_in, result)
    except PlanfitError as error:
        return replace(nothing, exit_code=2, said=str(error))
    except Exception as error:  # whatever it is: the other cases go on, and this one says so
        return replace(nothing, said=f"{type(error).__name__}: {error}")


def _with_sensor(measured: Measured, put_in: dict[str, float], result: RefineResult) -> Calibrated:
    calibration = result.calibration
    asked = {name: float(d) for name, d in zip(SHARED, calibration.departures, strict=True)}
    sigmas = {name: float(s) for name, s in zip(SHARED, calibration.sigmas, strict=True) if s > 0}
    found = {
        name: float(d)
        for name, d in zip(PARAMETERS, calibration.sensor.vector - NOMINAL.vector, strict=True)
        if d
    }
    asked = {name: asked[name] for name in sigmas}
    clock = result.tracking.clock
    if clock is not None and clock.offset_s is not None and clock.sigma_s is not None:
        asked[CLOCK], sigmas[CLOCK] = clock.offset_s, clock.sigma_s
        if clock.is_read:
            found[CLOCK] = clock.offset_s
    assert isinstance(measured, Calibrated)
    return replace(
        measured,
        put_in=put_in,
        found=found,
        asked=asked,
        sigmas=sigmas,
        implausible=calibration.implausible,
    )


MAX_RATIO, MAX_MORE_M = 1.25, 0.005
MAX_FAULTLESS_RATIO = 1.02
WITHIN_SHARE, WITHIN_SIGMAS = 0.10, 3.0


@dataclass(frozen=True)
class Judged:
    """A case beside the faultless one."""

    case: SensorCase
    measured: Calibrated
    reference: Calibrated | None
    """Of the same scan without fault; of the faultless one, as planfit was without calibration."""

    @property
    def ratio(self) -> float:
        """Error over that of the reference; NaN where one is missing."""
        if self.reference is None or not self.reference.error_m or self.measured.error_m is None:
            return float("nan")
        return self.measured.error_m / self.reference.error_m

    @property
    def is_near(self) -> bool:
        """Whether the error is as small as is asked."""
        if (
            self.reference is None
            or self.reference.error_m is None
            or self.measured.error_m is None
        ):
            return False
        if self.case.fault == FAULTLESS:
            return self.ratio <= MAX_FAULTLESS_RATIO
        return self.measured.error_m <= MAX_RATIO * self.reference.error_m + MAX_MORE_M

    @property
    def is_recovered(self) -> bool:
        """Whether all that was put in was corrected, and nothing else."""
        found, put_in = self.measured.found, self.measured.put_in
        return all(
            abs(self.errors[name])
            <= max(WITHIN_SHARE * abs(put_in.get(name, 0.0)), WITHIN_SIGMAS * self._sigma(name))
            for name in {*found, *put_in}
        )

    @property
    def errors(self) -> dict[str, float]:
        """What was corrected less what was put in, of all that is either."""
        found, put_in = self.measured.found, self.measured.put_in
        return {
            name: found.get(name, 0.0) - put_in.get(name, 0.0)
            for name in (*PARAMETERS, CLOCK)
            if name in found or name in put_in
        }

    @property
    def in_sigmas(self) -> list[float]:
        """Errors of what was corrected, in stated standard deviations."""
        return [abs(self.errors[name]) / self._sigma(name) for name in self.measured.found]

    def _sigma(self, name: str) -> float:
        return self.measured.sigmas.get(name, 0.0) if name in self.measured.found else 0.0


def judge_all(cases: Sequence[SensorCase], measured: Sequence[Calibrated]) -> list[Judged]:
    """Cases that were measured, the last time that counts, each with its reference."""
    last = {m.number: m for m in measured}
    judged = []
    for case in cases:
        if case.number in last and case.fault != HELD:
            fault = HELD if case.fault == FAULTLESS else FAULTLESS
            reference = replace(case, fault=fault)
            judged.append(Judged(case, last[case.number], last.get(reference.number)))
    return judged


def shares(judged: Sequence[Judged]) -> dict[str, tuple[int, int]]:
    """Figure: how many, of how many."""
    faulty = [j for j in judged if j.case.fault != FAULTLESS and j.reference is not None]
    plain = [j for j in judged if j.case.fault == FAULTLESS and j.reference is not None]
    sigmas = np.array([s for j in judged for s in j.in_sigmas])
    return {
        f"faulty: error at most {MAX_RATIO} times the faultless one + {MAX_MORE_M * 1e3:.0f} mm": (
            sum(j.is_near for j in faulty),
            len(faulty),
        ),
        f"faultless: error at most {MAX_FAULTLESS_RATIO} times that without calibration": (
            sum(j.is_near for j in plain),
            len(plain),
        ),
        "faulty: all found within 10 % or 3 sigma, and nothing else": (
            sum(j.is_recovered for j in faulty),
            len(faulty),
        ),
        "faultless: nothing corrected": (sum(not j.measured.found for j in plain), len(plain)),
        "corrected parameters within 3 sigma of what was put in": (
            int(np.sum(sigmas < WITHIN_SIGMAS)),
            len(sigmas),
        ),
    }
