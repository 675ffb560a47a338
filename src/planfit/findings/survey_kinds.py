"""Findings of control and check points, of corrections by hand, and of several scans, and their words."""

from planfit.findings.message import Kind, Message, Severity, some_ids

WARNING, RESERVATION = Severity.WARNING, Severity.RESERVATION


def _first_part(parts: tuple[str, ...]) -> str:
    return parts[0]


def _hint(parts: tuple[str, ...]) -> str:
    """What would make points agree that do not."""
    return "".join(f"; {part}" for part in parts)


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
        WARNING, ("contradicted by hand or scan: {correction}: ", _first_part)
    )
    CORRECTION_LEFT_OUT = Message(
        WARNING, ("left out, as contradicted: {correction}: ", _first_part)
    )
    LOOP_DELETED = Message(WARNING, "a delete_loop says the opposite")
    FRAME_OF_LOOP_EXCLUDED = Message(WARNING, "one of the frames is excluded")
    FRAME_EXCLUDED = Message(WARNING, "the frame is excluded")
    WALL_ERASED = Message(WARNING, "an erase_wall says that it is not there")
    IMAGES_DO_NOT_MATCH = Message(
        WARNING, "their images do not match", "pick a point that both show, as pixels"
    )
    PICKED_POINTS_APART = Message(
        WARNING, "by what their images match, the picked points are {gap_m:.2f} m apart"
    )
    CORRECTION_ENDS_OFF = Message(
        WARNING,
        (
            "ends {residual_m:.2f} m off, where {allowed_m:g} m is allowed: ",
            lambda is_place: "walls or other places" if is_place else "other loops or walls",
            " hold against it",
        ),
    )
    LOOP_BENDS_MOTION = Message(
        WARNING,
        "{off_m:.2f} m off where all else puts it, and without it the recorded motion of frames "
        "{first}-{last} fits better by {better_m:.2f} m",
    )
    PLACE_OFF_BY_WALLS_ALONE = Message(WARNING, ("{off_m:.2f} m off where the walls put it", _hint))
    PLACE_OFF_BY_OTHERS = Message(
        WARNING, ("{off_m:.2f} m off where the other places put it", _hint)
    )
    TWO_POINTS_APART = Message(
        WARNING, "the two are {scan_m:.2f} m apart in the scan and {plan_m:.2f} m on the plan"
    )
    POINTS_AGREE_MIRRORED = Message(
        WARNING, "with left and right swapped they agree: is the plan mirrored?"
    )
    POINTS_AGREE_SCALED = Message(
        WARNING, "with the plan {scale_ratio:.3g} times as large they agree: is its unit right?"
    )
    SCAN_LEFT_OUT = Message(
        RESERVATION,
        (
            "{scan} has no place and was left out, its poses as recorded: ",
            lambda parts: ", and ".join(parts),
        ),
    )
    SCAN_UNLINKED = Message(RESERVATION, "none of the other scans shows the same places")
    SCAN_OFF_PLAN = Message(RESERVATION, "the plan does not fit it ({error})")
    SCAN_WITHOUT_WALLS = Message(RESERVATION, "it shows no wall to be aligned with the plan by")
    SCAN_ON_OTHER_PLAN = Message(
        RESERVATION,
        "the plan explains only {wall_share:.0%} of its walls wherever it is put: is it of another storey "
        "or building?",
    )
    SCAN_IN_MANY_PLACES = Message(RESERVATION, "it fits the plan in more than one place")
