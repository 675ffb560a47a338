"""The registration in the report: fit and held-out residuals side by side, and the accuracy."""

from html import escape

from planfit.pipeline.registration import Registration, RegistrationRow
from planfit.report.formatting import SPACE


def registration_section(registration: Registration) -> str:
    """What a surveyor looks for first."""
    rows = "".join(_row(row) for row in registration.rows)
    table = (
        "<table><thead><tr><th></th><th>before</th><th>fit</th><th>held out</th><th>number</th></tr></thead>"
        f"<tbody>{rows}</tbody></table>"
        if rows
        else ""
    )
    stated = "No accuracy is stated."
    if registration.stated_95_m is not None:
        by_checks = ""
        if registration.checked_95_m is not None:
            by_checks = f", by check points {registration.checked_95_m:.3f}{SPACE}m"
        stated = (
            f"<strong>Accuracy at 95{SPACE}%: {registration.stated_95_m:.3f}{SPACE}m, USIBD "
            f"{registration.loa}</strong> (predicted {registration.predicted_95_m:.3f}{SPACE}m{by_checks})."
        )
    basis = registration.basis[0].upper() + registration.basis[1:]
    return (
        "<h2>Registration</h2><p>How well something fits that was fitted is no accuracy: what is held out "
        f"had no say in the poses. {stated} {escape(basis)}. Of camera positions; points add the error of "
        "depth. Also in <code>registration.csv</code>.</p>"
        f"{table}"
    )


def _row(row: RegistrationRow) -> str:
    cells = "".join(f"<td>{_amount(v, row.unit)}</td>" for v in (row.before, row.fit, row.held_out))
    return f"<tr><td>{escape(row.name)}</td>{cells}<td>{row.count}</td></tr>"


def _amount(value: float | None, unit: str) -> str:
    if value is None or value != value:
        return ""
    return f"{value:.0%}" if unit == "share" else f"{value:.3f}{SPACE}{unit}"
