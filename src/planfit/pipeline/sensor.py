"""What was found of the sensor, parameter by parameter, in a client's words and units."""

from collections.abc import Sequence
from dataclasses import dataclass

from planfit.adjust.calibration import SHARED, Calibration
from planfit.geometry.calibration import NOMINAL, PARAMETERS
from planfit.geometry.camera import Camera

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
FAR_M = 3.0
"""Distance at which the quadratic part of depth is told in metres."""
_REGISTRATION = (
    "colour and depth may not be registered to each other, or the intrinsics be those of another camera or "
    "image size: check the export of the scan"
)
_UNIT = "check the unit of the depth (--depth-scale), and the calibration that the device exports"


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
        rows.append(
            SensorParameter(
                key=key,
                name=_NAMES[key],
                unit=_UNITS.get(key, ""),
                nominal=float(nominal),
                found=float(nominal) + by * float(calibration.departures[i]),
                sigma=sigma if sigma > 0 else None,
                is_kept=bool(calibration.is_kept[i]),
                is_implausible=key in calibration.implausible,
            )
        )
    return tuple(rows)


def sensor_warnings(rows: Sequence[SensorParameter]) -> tuple[str, ...]:
    """What a user should know of the sensor: what was corrected, or could not be; mostly nothing."""
    kept = [_correction(row) for row in rows if row.is_kept]
    refused = [row for row in rows if row.is_implausible]
    if kept:
        return ("; ".join(kept),)
    if not refused:
        return ()
    keys = {row.key for row in refused}
    advice = [_UNIT] if any(key.startswith("depth") for key in keys) else []
    advice += [_REGISTRATION] if any(not key.startswith("depth") for key in keys) else []
    asked = " and ".join(_request(row) for row in refused)
    return (
        f"the scan asks for {asked}, more than a camera can be off: nothing was corrected; "
        f"{'; '.join(advice)}",
    )


def _correction(row: SensorParameter) -> str:
    """A parameter that is kept: what was measured or given wrongly, and what was done."""
    off, sigma = row.departure, row.sigma or 0.0
    too = "long" if off < 0 else "short"
    match row.key:
        case "depth_scale":
            share = abs(1 / row.found - 1)
            return f"depth was measured {share:.1%} too {too}: corrected by {row.found:.4f} +- {sigma:.4f}"
        case "depth_offset_m":
            return (
                f"depth was measured {abs(off):.3f} m too {too} at every distance: corrected by "
                f"{off:+.3f} +- {sigma:.3f} m"
            )
        case "depth_quadratic_per_m":
            return (
                f"depth was measured too {too} by its square, {abs(off) * FAR_M**2:.3f} m at {FAR_M:g} m: "
                f"corrected by {off:+.4f} +- {sigma:.4f} times its square (1/m)"
            )
        case "focal_scale" | "focal_aspect":
            which = "" if row.key == "focal_scale" else " in y"
            share = abs(1 / row.found - 1)
            return (
                f"the focal length{which} was given {share:.1%} too {too}: corrected by "
                f"{row.found:.4f} +- {sigma:.4f}"
            )
        case _:
            axis = row.key[-1]
            return (
                f"the principal point was given {abs(off):.1f} px off in {axis}: moved by {off:+.1f} +- "
                f"{sigma:.1f} px"
            )


def _request(row: SensorParameter) -> str:
    """A parameter that is implausible: what it would have to be."""
    off = row.departure
    much = {
        "": f"{abs(off):.1%}",
        "m": f"{abs(off):.2f} m",
        "1/m": f"{abs(off) * FAR_M**2:.2f} m at {FAR_M:g} m",
        "px": f"{abs(off):.0f} px",
    }[row.unit]
    what = {
        "depth_scale": "depth",
        "depth_offset_m": "an offset of the depth",
        "depth_quadratic_per_m": "depth by its square",
        "focal_scale": "a focal length",
        "focal_aspect": "a focal length in y",
        "principal_x": "a principal point in x",
        "principal_y": "a principal point in y",
    }[row.key]
    return f"{what} {much} off"
