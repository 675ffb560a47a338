"""Findings of control and check points, of corrections by hand, and of several scans, and their words."""

from planfit.findings.message import Kind, Message, Severity, some_ids

WARNING, RESERVATION = Severity.WARNING, Severity.RESERVATION


class SurveyKind(Kind):
    """Control and check points, corrections by hand, several scans, and their words."""

    POINT_NOT_USED = Message(
        WARNING,
        "control point {point!r} contradicts those beside it by more than drift can: it was not used",
        "check its coordinates and marks",
    )
    FEW_POINTS_SEEN = Message(
        WARNING,
        "the scan sees {point_count} of the control points that are used: fewer than three cannot tell "
        "swapped axes or another unit",
        "mark three or more, not on a line",
    )
    POINTS_ON_A_LINE = Message(
        WARNING,
        "the control points stand on one line: they cannot tell a mirrored site from a right one",
        "add a point beside the line",
    )
    POINTS_UNSEEN = Message(
        WARNING,
        ("no frame sees the surveyed points ", lambda points: some_ids(points)),
    )
    POINTS_SWAPPED = Message(
        WARNING,
        "control points {point!r} and {other_point!r} look swapped: without them, the other evidence puts "
        "each in the other's place",
        "check their ids",
    )
    POINT_CONTRADICTED = Message(
        WARNING,
        "control point {point!r} contradicts the other evidence, which without it puts it {left_out_m:.2f} m "
        "from where it was surveyed ({left_out_sigmas:.0f} sigmas); it ends {residual_m:.2f} m off",
        "check its coordinates and marks, or leave it out",
    )
    POINT_OFF = Message(
        WARNING,
        "control point {point!r} ends {residual_m:.2f} m from where it was surveyed, against a sigma of "
        "{sigma_m:.3f} m: it contradicts the other evidence",
        "check its coordinates and marks",
    )
    CHECK_POINTS_OFF = Message(
        WARNING,
        "check points are off by {rms_m:.2f} m (RMS), more than the predicted error of "
        "{predicted_rms_m:.2f} m",
        "believe the check points, and see which are off in the report",
        joint=": ",
    )
    CORRECTION_CONTRADICTED = Message(
        WARNING, "contradicted by hand or scan: {correction}: {reason}"
    )
    CORRECTION_LEFT_OUT = Message(WARNING, "left out, as contradicted: {correction}: {reason}")
    SCAN_LEFT_OUT = Message(
        RESERVATION, "{scan} has no place and was left out, its poses as recorded: {reason}"
    )
