"""The registration in the report: fit and held-out residuals side by side, and the accuracy."""

from html import escape

from planfit.pipeline.registration import Registration, RegistrationRow
from planfit.report.formatting import SPACE, quantity
from planfit.report.html.tables import table


def registration_section(registration: Registration) -> str:
    """What a surveyor looks for first."""
    heads = ("", "before", "fit", "held out", "number")
    rows = table(heads, [_row(row) for row in registration.rows], "wnnnn")
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
        f"{rows if registration.rows else ''}"
    )


def _row(row: RegistrationRow) -> tuple[str, ...]:
    amounts = (
        "" if v is None else quantity(v, row.unit) for v in (row.before, row.fit, row.held_out)
    )
    return (escape(row.name), *amounts, str(row.count))
