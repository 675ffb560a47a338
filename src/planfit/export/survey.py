"""Residuals of control and check points: a table, and what the record says."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from planfit.findings import sentences_of
from planfit.pipeline.survey_residuals import contradicted_points
from planfit.survey import RoleResiduals, SurveyResiduals

HEADER = (
    "id,role,marks,given_x,given_y,given_z,plan_x_m,plan_y_m,plan_z_m,dx_m,dy_m,dz_m,horizontal_m,length_m,"
    "sigma_m,left_out_dx_m,left_out_dy_m,left_out_dz_m,left_out_m,left_out_sigma_m,left_out_sigmas,contradicted"
)
"""Columns of `control_points.csv`, as docs/outputs.md has them."""


def write_survey(folder: Path, survey: SurveyResiduals) -> None:
    """Write `control_points.csv`.

    Raises:
        OSError: it cannot be written.
    """
    lines = [HEADER]
    for point in survey.points:
        role = "check" if point.is_check else "control"
        numbers = [
            *point.given,
            *point.surveyed,
            *point.residual_m,
            point.horizontal_m,
            point.length_m,
            point.sigma_m,
            *(np.full(3, np.nan) if point.left_out_m is None else point.left_out_m),
            point.left_out_length_m,
            point.left_out_sigma_m,
            point.left_out_sigmas,
        ]
        cells = [f"{v:.6f}" if np.isfinite(v) else "" for v in numbers]
        name = (
            point.id if not set(point.id) & set(',"') else '"' + point.id.replace('"', '""') + '"'
        )
        contradicted = "" if point.is_check else "yes" if point.is_contradicted else "no"
        lines.append(",".join([name, role, str(point.n_marks), *cells, contradicted]))
    (folder / "control_points.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def survey_record(survey: SurveyResiduals) -> dict[str, Any]:
    """Residuals by role and by point, and where the survey lies, for `run.json`."""
    site = survey.site_from_plan
    return {
        "axes": survey.axes,
        "height_of_floor_m": survey.height_datum_m,
        "site_from_plan": None if site is None else site.tolist(),
        "site_origin_m": None if site is None else survey.site_origin.tolist(),
        "control": _role_record(survey.control),
        "control_left_out": _role_record(survey.left_out),
        "check": _role_record(survey.check),
        "points": [
            {
                "id": point.id,
                "role": "check" if point.is_check else "control",
                "marks": point.n_marks,
                "residual_m": _numbers(point.residual_m),
                "sigma_m": point.sigma_m,
                "left_out_m": None if point.left_out_m is None else _numbers(point.left_out_m),
                "left_out_sigma_m": _numbers([point.left_out_sigma_m])[0],
                "left_out_sigmas": _numbers([point.left_out_sigmas])[0],
                "is_contradicted": point.is_contradicted,
                "swapped_with": point.swapped_with or None,
            }
            for point in survey.points
        ],
        "contradicted": list(sentences_of(contradicted_points(survey.points))),
        "unseen": list(survey.unseen),
    }


def _numbers(values: Iterable[float]) -> list[float | None]:
    return [float(v) if np.isfinite(v) else None for v in values]


def _role_record(role: RoleResiduals | None) -> dict[str, Any] | None:
    if role is None:
        return None
    return {
        "count": role.count,
        "rms_m": role.rms_m,
        "rms_horizontal_m": role.rms_horizontal_m,
        "rms_height_m": role.rms_height_m,
        "worst_m": role.worst_m,
        "worst": role.worst_id,
    }
