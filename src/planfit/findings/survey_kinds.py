"""Findings of control and check points, of corrections by hand, and of several scans, and their words."""

from planfit.findings.finding import Kind, reservation, some_ids, warning


def _first_part(parts: tuple[str, ...]) -> str:
    return parts[0]


def _hint(parts: tuple[str, ...]) -> str:
    """What would make points agree that do not."""
    return "".join(f"; {part}" for part in parts)


class SurveyKind(Kind):
    """Control and check points, corrections by hand, several scans, and their words."""

    POINT_NOT_USED = warning(
        "control point {point!r} contradicts those beside it by more than drift can: it was not used",
        "check its coordinates and marks",
    )
    FEW_POINTS_SEEN = warning(
        "the scan sees {point_count} of the control points that are used: fewer than three cannot tell "
        "swapped axes or another unit",
        "mark three or more, not on a line",
    )
    POINTS_ON_A_LINE = warning(
        "the control points stand on one line: they cannot tell a mirrored site from a right one",
        "add a point beside the line",
    )
    POINTS_UNSEEN = warning(("no frame sees the surveyed points ", lambda points: some_ids(points)))
    POINTS_SWAPPED = warning(
        "control points {point!r} and {other_point!r} look swapped: without them, the other evidence puts "
        "each in the other's place",
        "check their ids",
    )
    POINT_CONTRADICTED = warning(
        "control point {point!r} contradicts the other evidence, which without it puts it {left_out_m:.2f m} "
        "from where it was surveyed ({left_out_sigmas:.0f} sigmas); it ends {residual_m:.2f m} off",
        "check its coordinates and marks, or leave it out",
    )
    POINT_OFF = warning(
        "control point {point!r} ends {residual_m:.2f m} from where it was surveyed, against a sigma of "
        "{sigma_m:.3f m}: it contradicts the other evidence",
        "check its coordinates and marks",
    )
    CHECK_POINTS_OFF = warning(
        "check points are off by {rms_m:.2f m} (RMS), more than the predicted error of "
        "{predicted_rms_m:.2f m}",
        "believe the check points, and see which are off in the report",
        joint=": ",
    )
    CORRECTION_CONTRADICTED = warning(("contradicted by hand or scan: {correction}: ", _first_part))
    CORRECTION_LEFT_OUT = warning(("left out, as contradicted: {correction}: ", _first_part))
    LOOP_DELETED = warning("a delete_loop says the opposite")
    FRAME_OF_LOOP_EXCLUDED = warning("one of the frames is excluded")
    FRAME_EXCLUDED = warning("the frame is excluded")
    WALL_ERASED = warning("an erase_wall says that it is not there")
    IMAGES_DO_NOT_MATCH = warning(
        "their images do not match", "pick a point that both show, as pixels"
    )
    PICKED_POINTS_APART = warning(
        "by what their images match, the picked points are {gap_m:.2f m} apart"
    )
    CORRECTION_ENDS_OFF = warning(
        (
            "ends {residual_m:.2f m} off, where {allowed_m:g m} is allowed: ",
            lambda is_place: "walls or other places" if is_place else "other loops or walls",
            " hold against it",
        )
    )
    LOOP_BENDS_MOTION = warning(
        "{off_m:.2f m} off where all else puts it, and without it the recorded motion of frames "
        "{first}-{last} fits better by {better_m:.2f m}"
    )
    PLACE_OFF_BY_WALLS_ALONE = warning(("{off_m:.2f m} off where the walls put it", _hint))
    PLACE_OFF_BY_OTHERS = warning(("{off_m:.2f m} off where the other places put it", _hint))
    TWO_POINTS_APART = warning(
        "the two are {scan_m:.2f m} apart in the scan and {plan_m:.2f m} on the plan"
    )
    POINTS_AGREE_MIRRORED = warning("with left and right swapped they agree: is the plan mirrored?")
    POINTS_AGREE_SCALED = warning(
        "with the plan {scale_ratio:.3g} times as large they agree: is its unit right?"
    )
    SCAN_LEFT_OUT = reservation(
        (
            "{scan} has no place and was left out, its poses as recorded: ",
            lambda parts: ", and ".join(parts),
        )
    )
    SCAN_UNLINKED = reservation("none of the other scans shows the same places")
    SCAN_OFF_PLAN = reservation("the plan does not fit it ({error})")
    SCAN_WITHOUT_WALLS = reservation("it shows no wall to be aligned with the plan by")
    SCAN_ON_OTHER_PLAN = reservation(
        "the plan explains only {wall_share:.0%} of its walls wherever it is put: is it of another storey "
        "or building?"
    )
    SCAN_IN_MANY_PLACES = reservation("it fits the plan in more than one place")
