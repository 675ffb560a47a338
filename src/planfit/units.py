"""The units that lengths are told in: metres, or feet and inches, where a user asks for these. Files that
programs read are metric whatever is asked for."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from fractions import Fraction
from typing import Literal, get_args

Units = Literal["m", "ft"]
UNITS: tuple[Units, ...] = get_args(Units)
INCH_M, FOOT_M = 0.0254, 0.3048
_FINEST_PER_INCH = 8
"""From one foot on, lengths are told to an eighth of an inch, 3 mm, as tapes have it."""
_WHOLE_FROM_FT = 100
"""Longer ways are told in whole feet."""
_asked: ContextVar[Units] = ContextVar("units", default="m")


@contextmanager
def told_in(units: Units) -> Iterator[None]:
    """Words that are made while the context lasts have these units; also a decorator."""
    before = _asked.set(units)
    try:
        yield
    finally:
        _asked.reset(before)


def asked() -> Units:
    """Those of the context."""
    return _asked.get()


def in_units(value_m: float, spec: str = ".2f", unit: str = "m", space: str = " ") -> str:
    """A length in words: "0.23 m", or "9.1 in" and "7 ft 6 1/8 in" where feet are asked for.

    Args:
        value_m: m.
        spec: Python's format of the number in metric units; its sign holds for feet too.
        unit: metric one to tell it in, m or cm; none where a later number of the words has it.
        space: between number and unit.
    """
    if asked() == "ft" and math.isfinite(value_m):
        return _in_feet(value_m, "+" if spec.startswith("+") else "").replace(" ", space)
    return f"{100 * value_m if unit == 'cm' else value_m:{spec}}{space if unit else ''}{unit}"


def _in_feet(value_m: float, plus: str) -> str:
    inches, sign = abs(value_m) / INCH_M, "-" if value_m < 0 else plus
    if round(inches, 1) < 12:
        return f"{sign}{inches:.{1 if round(inches, 2) >= 1 else 2}f} in"
    if inches / 12 >= _WHOLE_FROM_FT:
        return f"{sign}{inches / 12:,.0f} ft"
    feet, rest = divmod(round(inches * _FINEST_PER_INCH), 12 * _FINEST_PER_INCH)
    whole, part = divmod(rest, _FINEST_PER_INCH)
    told = [str(whole)] * (whole > 0) + [str(Fraction(part, _FINEST_PER_INCH))] * (part > 0)
    return f"{sign}{feet} ft" + (f" {' '.join(told)} in" if told else "")


def quantity(value: float, unit: str, spec: str, space: str = " ") -> str:
    """A number with its unit, where that may be a length in m or cm, or an area in cm²."""
    if unit in ("m", "cm"):
        return in_units(value / (100 if unit == "cm" else 1), spec, unit, space)
    if asked() == "ft" and unit == "cm²":
        return f"{value / (100 * INCH_M) ** 2:{spec}}{space}in²"
    return f"{value:{spec}}{space}{unit}".rstrip()


def share_reached(share: float) -> str:
    """A share in whole per cent, rounded down: 94.9 % does not reach the 95 % that was asked for."""
    if math.isnan(share):
        return "an unknown share"
    return f"{math.floor(100 * share + 1e-9)}%"


def area(value_m2: float, spec: str = ".1f", space: str = " ") -> str:
    """An area in words: "17.7 m²", or "191 sq ft"."""
    if asked() == "ft":
        return f"{value_m2 / FOOT_M**2:{spec}}{space}sq{space}ft"
    return f"{value_m2:{spec}}{space}m²"


def column(name: str) -> str:
    """The head of a column of bare lengths, of which `bare` makes the cells: decimal feet, as surveyors in
    feet use them."""
    return f"{name}, {asked()}"


def bare(value_m: float) -> str:
    """A length without its unit, for tables that have it in their head."""
    return f"{value_m / (FOOT_M if asked() == 'ft' else 1):.3f}"
