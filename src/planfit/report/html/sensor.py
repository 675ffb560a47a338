"""The section on the sensor: what was found of each parameter, and what that does to depth."""

from collections.abc import Sequence
from html import escape

import numpy as np

from planfit.findings import sentences_of
from planfit.pipeline.result import RefineResult
from planfit.pipeline.sensor import SensorParameter, sensor_findings
from planfit.report import formatting
from planfit.report.html.sections import captioned
from planfit.report.html.tables import table
from planfit.report.plots.depth_error import FAR_M, NEAR_M, depth_error_plot

_DIGITS = {"": 4, "m": 3, "1/m": 4, "px": 1}


def sensor_section(result: RefineResult) -> str:
    """Parameters with standard deviations, and the error of depth over distance, before and after.

    Nothing where nothing was looked for.
    """
    rows = result.sensor_parameters
    if all(row.sigma is None for row in rows):
        return ""
    farthest_m = farthest_point_m(result)
    picture = captioned(
        depth_error_plot(result.calibration, farthest_m),
        "<strong>Error of the depth over distance,</strong> as found: before, and after the correction. "
        f"Shaded: one standard deviation. Points were seen up to {farthest_m:.1f}{formatting.SPACE}m.",
        "Error of measured depth over distance, before and after",
    )
    names = ("parameter", "found", "sigma", "")
    cells = [(escape(row.name), _number(row, row.found), _sigma(row), _state(row)) for row in rows]
    return (
        f"<h2>The sensor</h2><p>{escape(_in_words(rows))}</p>"
        f'<div class="pair"><div>{table(names, cells, "wnnw")}</div>{picture}</div>'
    )


def farthest_point_m(result: RefineResult) -> float:
    """Depth below which all but a thousandth of the points of the solve lie, within the plot's limits."""
    structure, matches = result.structure, result.matches
    depths = np.concatenate(
        [
            points[:, 2]
            for points in (
                structure.floor.points_cam,
                structure.walls.points_cam,
                structure.ceiling.points_cam,
                matches.points_a,
                matches.points_b,
            )
        ]
    )
    known = depths[np.isfinite(depths)]
    far = float(np.percentile(known, 99.9)) if len(known) else FAR_M
    return float(np.clip(far, 2 * NEAR_M, FAR_M))


def _in_words(rows: Sequence[SensorParameter]) -> str:
    said = "; ".join(sentences_of(sensor_findings(rows)))
    if said:
        return f"{said[0].upper()}{said[1:]}."
    return (
        "Depth and camera are as the scan's files say, as far as matches, floor, recorded motion and walls "
        "can tell: nothing was corrected."
    )


def _number(row: SensorParameter, value: float) -> str:
    rounded = round(value, _DIGITS[row.unit]) + 0.0  # + 0.0: no "-0.0"
    text = f"{rounded:.{_DIGITS[row.unit]}f}".replace("-", formatting.MINUS)
    return f"{text}{formatting.SPACE}{row.unit}" if row.unit else text


def _sigma(row: SensorParameter) -> str:
    return "n/a" if row.sigma is None else _number(row, row.sigma)


def _state(row: SensorParameter) -> str:
    if row.is_kept:
        return "<strong>corrected</strong>"
    if row.is_implausible:
        return "not believed"
    return "held" if row.sigma is None else "left alone"
