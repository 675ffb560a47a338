"""Numbers as text, each with its unit; spaces do not break between number and unit."""

import math

from planfit import units
from planfit.units import in_units

SPACE = "\u00a0"
MINUS = "\u2212"
NOTHING = 1e-9
"""What is smaller is 0 up to rounding."""


def length(value: float | None, spec: str = "") -> str:
    """Metres, to the millimetre below one metre, `0.073 m`, or as the format says; feet where asked for."""
    if value is None or not math.isfinite(value):
        return "n/a"
    spec = spec or (".3f" if abs(value) < 1 else ".2f")
    return in_units(value, spec, "m", SPACE).replace("-", MINUS)


def share(value: float | None) -> str:
    """Share as per cent: `28 %`."""
    if value is None or not math.isfinite(value):
        return "n/a"
    text = f"{100 * value:.0f}"
    # 99.7 % is not all, and 0.3 % is not none.
    if text in ("0", "100") and value not in (0.0, 1.0):
        text = f"{100 * value:.1f}"
    return f"{text}{SPACE}%"


def quantity(value: float | None, unit: str) -> str:
    """A number of a check: shares as per cent, metres as metres, others as they are."""
    if unit == "share":
        return share(value)
    if unit == "m":
        return length(value)
    return "n/a" if value is None else units.quantity(value, unit, ".3g", SPACE)


def centimetres(value: float, signed: bool = False) -> str:
    """Metres as centimetres, one decimal: `+2.3 cm`; inches where feet are asked for."""
    if not math.isfinite(value):
        return "n/a"
    shown = value if round(100 * value, 1) else 0.0  # no "-0.0"
    spec = "+.1f" if signed and shown else ".1f"
    return in_units(shown, spec, "cm", SPACE).replace("-", MINUS)


def change(before: float | None, after: float | None, unit: str) -> str:
    """Change from before to after: per cent of before; of shares, percentage points."""
    if before is None or after is None or not (math.isfinite(before) and math.isfinite(after)):
        return "n/a"
    if unit == "share":
        points = round(100 * (after - before)) + 0.0
        return _signed(points, f"{points:+.0f}", "percentage points")
    if abs(before) < NOTHING:
        return "unchanged" if abs(after) < NOTHING else "from zero"
    percent = 100 * (after - before) / abs(before)
    return _signed(round(percent) + 0.0, f"{percent:+,.0f}", "%")


def count(value: int) -> str:
    """Whole number with thin spaces between thousands: `276 002`."""
    return f"{value:,}".replace(",", "\u202f")


def seconds(value: float) -> str:
    """Duration: `18.4 s`, below a tenth `0.04 s`."""
    return f"{value:.1f}{SPACE}s" if value >= 0.1 else f"{value:.2f}{SPACE}s"


def _signed(rounded: float, text: str, unit: str) -> str:
    return "unchanged" if rounded == 0 else f"{text}{SPACE}{unit}".replace("-", MINUS)
