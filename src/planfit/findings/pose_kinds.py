"""Findings of how far recorded poses are believed, and their words."""

from planfit.findings.finding import Kind, note, reservation, some_ids, warning


def _clock(offset_s: float | None, offset_frames: float, rate: float) -> str:
    """ "30 ms later than their poses", and what it grows by."""
    size = f"{abs(offset_frames):.2g} frames"
    if offset_s is not None:
        size = f"{1000 * abs(offset_s):.0f} ms"
    size += f" {'later' if offset_frames > 0 else 'earlier'} than their poses"
    if not rate:
        return size
    return f"{size} half way, and {1000 * abs(rate):.2g} ms {'later' if rate > 0 else 'earlier'} each second"


def _done(unmatched_after_frames: tuple[int, ...]) -> str:
    """What became of lost frames."""
    if not unmatched_after_frames:
        return "placed by the motions that the images show"
    after = ", ".join(str(frame) for frame in unmatched_after_frames[:5])
    return f"guessed in part, as neighbouring images do not match after frame {after}"


def _mount(turn_deg: tuple[float, float, float], arm_m: tuple[float, float, float]) -> str:
    """ "turned by roll -90.0, pitch 0.0, yaw -90.0 degrees and 0.10, 0.00, 0.25 m from its origin"."""
    turn = ", ".join(
        f"{name} {angle + 0.0:.1f}"
        for name, angle in zip(("roll", "pitch", "yaw"), turn_deg, strict=True)
    )
    arm = ", ".join(f"{each:.2f}" for each in arm_m)
    return f"turned by {turn} degrees and {arm} m (x, y, z) from its origin"


class PoseKind(Kind):
    """How far recorded poses are believed."""

    POSES_IN_OWN_UNIT = note(
        "the recorded motion is not in metres: by what images and depth show of it, its unit is "
        "{metres_per_unit:.3g} m, and poses were multiplied by that",
        "if they are in metres, depth is in the wrong unit: give --depth-scale",
    )
    DEPTH_UNIT_TAKEN = note(
        "depth is in another unit than it was read in: the recorded motion is in metres, and depth was "
        "multiplied by {depth_factor:.4g}, a ratio of units that are in use",
        "if poses have a unit of their own instead, give it: --poses-convention unit:METRES",
    )
    MOTION_TO_SCALE = note(
        (
            "the recorded motion is ",
            lambda departure, sigma: (
                f"{abs(departure):.1%} +- {sigma:.1%} too {'short' if departure > 0 else 'long'}"
            ),
            " for the walls of the plan: corrected by one factor",
        )
    )
    CONVENTION_TAKEN = note("the recorded poses were taken as {convention}")
    MOUNT_FOUND = note(
        (
            "the recorded poses are those of a body that carries the camera, ",
            _mount,
            ": so they explain {explained_share:.0%} of {motion_count} measured motions, as recorded "
            "{recorded_share:.0%}, and were taken to the camera",
        )
    )
    CLOCK_CORRECTED = note(
        ("images are ", _clock, ": poses were read from the trajectory at the images' times")
    )
    CLOCK_OFF = warning(
        (
            "images are about ",
            _clock,
            ", and frames are too far apart to read poses between them: they stay as recorded",
        ),
        "export the scan with more frames a second",
    )
    POSES_REPEAT = reservation(
        "the recorded poses of {repeated_count} of {frame_count} frames repeat the one before while the "
        "images move, and say nothing of where the camera was",
        "export the scan with its poses, or give those of another tracker with --poses",
        joint=": ",
    )
    POSES_HELD = note(
        "the recorded poses come at a lower rate than images: {held_count} of {frame_count} frames "
        "repeat the pose before while the images move; their poses were interpolated"
    )
    MOTIONS_UNEXPLAINED = reservation(
        "the recorded poses explain only {explained_share:.0%} of {motion_count} motions between "
        "neighbouring images, and no usual convention explains more",
        "check that poses and images belong to one recording, in the same order",
        joint=": ",
    )
    TRACKER_NOISY = note(
        "the tracker errs about {sigma_factor:.1f} times more than usual between frames: its motion was "
        "believed less"
    )
    JUMP_CORRECTED = note(
        "the recorded motion jumps by {recorded_m:.1f m} and {recorded_deg:.0f} degrees after frame {first}, "
        "where the {witness} show a step of {corrected_m:.1f m} and {corrected_deg:.0f} degrees: corrected"
    )
    FRAMES_DISPLACED = note(
        "{which} {are} recorded {displacement_m:.1f m} and {displacement_deg:.0f} degrees away from where "
        "the images show them: corrected"
    )
    POSE_STANDS_STILL = warning(
        (
            "the recorded pose stands still from frame {first} to {last}, where the images move by "
            "{moved_m:.1f m} and {moved_deg:.0f} degrees: ",
            _done,
        )
    )
    POSES_LOST = warning(
        (
            "{which} ({lost_count} of {frame_count}) ",
            lambda lost_count: "has" if lost_count == 1 else "have",
            " the identity as pose, as trackers write it that are lost: ",
            _done,
        )
    )
    ELSEWHERE_AFTER_LOST = warning(
        (
            "after the lost {which} the tracker goes on {departure_m:.1f m} and {departure_deg:.0f} degrees "
            "away from where it should: the frames from {next_frame} on are ",
            _done,
        )
    )
    PLACED_BY_REVISITS = note(
        "after frame {first}, where tracking was lost, the walk goes on {step_m:.1f m} and {step_deg:.0f} "
        "degrees further: placed by {revisit_count} revisits"
    )
    REVISITS_CONTRADICT_MOTION = warning(
        "revisits contradict the recorded motion somewhere about frames {first}-{last}, where neighbouring "
        "images do not match, but not enough of them show where: left as recorded",
        "look at these frames in the report, or scan that part again",
    )


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
