"""Control and check points in the report: residuals of both, apart, and of each point."""

from html import escape

import numpy as np

from planfit.report.formatting import SPACE
from planfit.survey import PointResidual, RoleResiduals, SurveyResiduals


def survey_section(survey: SurveyResiduals | None) -> str:
    """Empty without a survey."""
    if survey is None or not survey.points:
        return ""
    roles = [("control", survey.control), ("check", survey.check)]
    sums = "".join(_role_row(name, role) for name, role in roles if role is not None)
    rows = "".join(_point_row(point) for point in survey.points)
    judged = (
        "Check points took no part: their residuals are the error of the result there, but for the sigmas of "
        "the points and of depth."
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
    return (
        "<h2>Control and check points</h2><p>Found less surveyed, in the axes of the plan. Control points "
        f"held the poses. {judged}{datum}</p>"
        "<table><thead><tr><th></th><th>points</th><th>RMS, m</th><th>horizontal, m</th><th>height, m</th>"
        f"<th>worst, m</th><th>at</th></tr></thead><tbody>{sums}</tbody></table>"
        "<details open><summary>Point by point</summary>"
        '<table class="sortable"><thead><tr><th>point</th><th>role</th><th>marks</th><th>dx, m</th>'
        "<th>dy, m</th><th>dz, m</th><th>length, m</th><th>sigma, m</th></tr></thead>"
        f"<tbody>{rows}</tbody></table></details>{unseen}"
    )


def _role_row(name: str, role: RoleResiduals) -> str:
    height = "" if role.rms_height_m is None else f"{role.rms_height_m:.3f}"
    return (
        f"<tr><td>{name} points</td><td>{role.count}</td><td>{role.rms_m:.3f}</td>"
        f"<td>{role.rms_horizontal_m:.3f}</td><td>{height}</td><td>{role.worst_m:.3f}</td>"
        f"<td>{escape(role.worst_id)}</td></tr>"
    )


def _point_row(point: PointResidual) -> str:
    role = "check" if point.is_check else "control"
    cells = [f"{v:.3f}" if np.isfinite(v) else "" for v in point.residual_m]
    numbers = "".join(f"<td>{cell}</td>" for cell in [*cells, f"{point.length_m:.3f}"])
    return (
        f"<tr><td>{escape(point.id)}</td><td>{role}</td><td>{point.n_marks}</td>{numbers}"
        f"<td>{point.sigma_m:.3f}</td></tr>"
    )
