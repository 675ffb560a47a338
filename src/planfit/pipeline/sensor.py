"""What was found of the sensor, parameter by parameter, in a client's words and units."""

from collections.abc import Sequence
from dataclasses import dataclass

from planfit.adjust.calibration import ODOMETRY, SHARED, Calibration
from planfit.findings import Finding, Kind, PoseKind, ScanKind
from planfit.geometry.calibration import NOMINAL, PARAMETERS
from planfit.geometry.camera import Camera
from planfit.priors import SURE_SIGMAS

_NAMES = {
    "depth_scale": "depth, factor",
    "depth_offset_m": "depth, offset",
    "depth_quadratic_per_m": "depth, part that grows with its square",
    "focal_scale": "focal length, factor",
    "focal_aspect": "focal length in y, further factor",
    "principal_x": "principal point in x",
    "principal_y": "principal point in y",
}
_UNITS = {
    "depth_offset_m": "m",
    "depth_quadratic_per_m": "1/m",
    "principal_x": "px",
    "principal_y": "px",
}


@dataclass(frozen=True)
class SensorParameter:
    """One parameter of the sensor, and what the evidence says of it."""

    key: str
    """As `planfit.geometry.calibration.PARAMETERS` has it."""
    name: str
    """In words."""
    unit: str
    """Of all the numbers; empty for factors. Principal points are in pixels of the first camera."""
    nominal: float
    """What the scan's files say: 1 of factors, 0 of the others."""
    found: float
    """What the evidence asks for: with the others that are kept where this one is, else if it alone were free
    beside those."""
    sigma: float | None
    """Standard deviation of `found`; None where the parameter was held, or nothing was looked for."""
    is_kept: bool
    """Whether the scan is corrected by it."""
    is_implausible: bool
    """Whether it departs by more than a sensor can be off, so that nothing was corrected."""
    p_sensor: float | None
    """Probability that an implausible departure is the sensor's all the same, by geometry without keypoints;
    None of others, and of depth, of which that tells nothing."""

    @property
    def departure(self) -> float:
        """By how much it departs from nominal."""
        return self.found - self.nominal


def sensor_parameters(calibration: Calibration, camera: Camera) -> tuple[SensorParameter, ...]:
    """All parameters of a calibration in their order; `camera` is the scan's first one, as recorded."""
    rows = []
    for key, nominal in zip(PARAMETERS, NOMINAL.vector, strict=True):
        i = SHARED.index(key)
        by = camera.fx if _UNITS.get(key) == "px" else 1.0
        sigma = by * float(calibration.sigmas[i])
        is_implausible = key in calibration.implausible
        rows.append(
            SensorParameter(
                key=key,
                name=_NAMES[key],
                unit=_UNITS.get(key, ""),
                nominal=float(nominal),
                found=float(nominal) + by * float(calibration.departures[i]),
                sigma=sigma if sigma > 0 else None,
                is_kept=bool(calibration.is_kept[i]),
                is_implausible=is_implausible,
                p_sensor=calibration.p_sensor if is_implausible else None,
            )
        )
    return tuple(rows)


def sensor_findings(rows: Sequence[SensorParameter]) -> tuple[Finding, ...]:
    """What a user should know of the sensor: what was corrected, or could not be; mostly nothing."""
    kept = tuple(_finding(ScanKind.PARAMETER_CORRECTED, row) for row in rows if row.is_kept)
    refused = [row for row in rows if row.is_implausible]
    if kept:
        return (Finding(ScanKind.SENSOR_CORRECTED, parts=kept),)
    if not refused:
        return ()
    of_depth = {row.key.startswith("depth") for row in refused}
    facts = {"p_sensor": refused[0].p_sensor}
    facts |= {"is_of_depth": True in of_depth, "is_of_lens": False in of_depth}
    asked = tuple(_finding(ScanKind.PARAMETER_IMPLAUSIBLE, row) for row in refused)
    return (Finding(ScanKind.SENSOR_IMPLAUSIBLE, facts, parts=asked),)


def motion_findings(calibration: Calibration) -> tuple[Finding, ...]:
    """By how much recorded motion was corrected, where it surely is too short or too long."""
    departure, sigma = (float(v[ODOMETRY]) for v in (calibration.departures, calibration.sigmas))
    if abs(departure) <= SURE_SIGMAS.value * sigma:
        return ()
    return (Finding(PoseKind.MOTION_TO_SCALE, {"departure": departure, "sigma": sigma}),)


def _finding(kind: Kind, row: SensorParameter) -> Finding:
    facts = {"parameter": row.key, "unit": row.unit, "found": row.found}
    return Finding(kind, facts | {"departure": row.departure, "sigma": row.sigma or 0.0})
