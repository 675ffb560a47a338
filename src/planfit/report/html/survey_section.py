"""Control and check points in the report: residuals of both, apart, and of each point."""

from html import escape

import numpy as np

from planfit.report.formatting import SPACE
from planfit.report.html.tables import table
from planfit.survey import PointResidual, RoleResiduals, SurveyResiduals


def survey_section(survey: SurveyResiduals | None) -> str:
    """Empty without a survey."""
    if survey is None or not survey.points:
        return ""
    roles = [
        ("control points", survey.control),
        ("control points, each left out", survey.left_out),
        ("check points", survey.check),
    ]
    sums = [_role_row(name, role) for name, role in roles if role is not None]
    judged = (
        "Check points took no part: their residuals are the error of the result there, but for the sigmas "
        "of the points and of depth."
        if survey.check is not None
        else "There are no check points. How well control points fit is no accuracy: they are what the poses "
        "were held to."
    )
    datum = ""
    if survey.height_datum_m is not None:
        datum = (
            f" The floor was found at {survey.height_datum_m:.3f}{SPACE}m of the survey's heights."
        )
    unseen = ""
    if survey.unseen:
        unseen = f"<p>Seen in no frame: {escape(', '.join(survey.unseen))}.</p>"
    heads = ("", "points", "RMS, m", "horizontal, m", "height, m", "worst, m", "at")
    of_points = (
        "point", "role", "marks", "dx, m", "dy, m", "dz, m", "length, m", "sigma, m", "left out, m",
        "its sigma, m", "sigmas",
    )  # fmt: skip
    each = table(of_points, [_point_row(point) for point in survey.points], "wwnnnnnnnnn")
    return (
        "<h2>Control and check points</h2><p>Found less surveyed, along the axes of the plan. Control points "
        "held the poses; <em>left out</em> is how far the other evidence puts each where it takes no part, "
        "<em>sigmas</em> how many standard deviations that is: a point that is wrong stands out there, while "
        f"in the fit it draws others along. {judged}{datum}</p>{table(heads, sums, 'wnnnnnw')}"
        f"<details open><summary>Point by point</summary>{each}</details>{unseen}"
    )


def _role_row(name: str, role: RoleResiduals) -> tuple[str, ...]:
    height = "" if role.rms_height_m is None else f"{role.rms_height_m:.3f}"
    return (
        name,
        str(role.count),
        f"{role.rms_m:.3f}",
        f"{role.rms_horizontal_m:.3f}",
        height,
        f"{role.worst_m:.3f}",
        escape(role.worst_id),
    )


def _point_row(point: PointResidual) -> tuple[str, ...]:
    role = "check" if point.is_check else "control"
    by_axis = (f"{v:.3f}" if np.isfinite(v) else "" for v in point.residual_m)
    lengths = (f"{point.length_m:.3f}", f"{point.sigma_m:.3f}")
    left_out = ("", "", "")
    if point.left_out_m is not None:
        told = (point.left_out_length_m, point.left_out_sigma_m)
        sigmas = f"{point.left_out_sigmas:.1f}" if np.isfinite(point.left_out_sigmas) else ""
        if point.is_contradicted:
            sigmas = f'<span class="worse">{sigmas}</span>'
        left_out = (*(f"{v:.3f}" if np.isfinite(v) else "" for v in told), sigmas)
    return (escape(point.id), role, str(point.n_marks), *by_axis, *lengths, *left_out)
