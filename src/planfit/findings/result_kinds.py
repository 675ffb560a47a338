"""Findings of the adjustment and of what the evidence says of its result, and their words."""

import numpy as np

from planfit.findings.finding import Kind, against, direction_words, note, reservation, warning
from planfit.units import in_units

MAX_MOVED, MAX_RIVALS = 5, 3
"""Moved walls that a warning names, and that a reservation does."""


def _moved_wall(
    from_xy_m: tuple[float, float],
    to_xy_m: tuple[float, float],
    normal: tuple[float, float],
    offset_m: float,
) -> str:
    (x1, y1), (x2, y2) = from_xy_m, to_xy_m
    way = direction_words(np.array(normal), offset_m)
    return f"the wall at ({x1:.1f}, {y1:.1f})-({x2:.1f}, {y2:.1f}): {in_units(abs(offset_m))} {way}"


def _moved_walls(parts: tuple[str, ...]) -> str:
    named, is_one = list(parts[:MAX_MOVED]), len(parts) == 1
    if len(parts) > MAX_MOVED:
        named.append(f"and {len(parts) - MAX_MOVED} more")
    who = "1 wall stands" if is_one else f"{len(parts)} walls stand"
    return (
        f"{who} elsewhere than drawn: {'; '.join(named)}; poses were not held to "
        f"{'it' if is_one else 'them'}; look there and correct the plan, unless cupboards stand before the "
        "wall or are seen through its glass"
    )


def _unseen(has_plan: bool) -> str:
    return "neither floor nor a wall of the plan" if has_plan else "no floor"


def _who(which: str | None) -> str:
    """A piece of the scan: its frames, or the whole."""
    return which or "the scan"


def _along(direction: tuple[float, float] | None) -> str:
    if direction is None:
        return ""
    x, y = direction
    return f" along the plan's direction ({x:.2f}, {y:.2f})"


def _taken_for_moved(parts: tuple[str, ...]) -> str:
    if not parts:
        return ""
    shown = [*parts[:MAX_RIVALS]]
    if len(parts) > MAX_RIVALS:
        shown.append(f"{len(parts) - MAX_RIVALS} more")
    return f", other walls being drawn wrongly then; taken for moved were {'; '.join(shown)}"


def _check_of_rivals(parts: tuple[str, ...]) -> str:
    check = "check the plan"
    if parts:
        check = "measure one of these walls in the building and correct the plan there"
    return f"{check}, or give control points"


class ResultKind(Kind):
    """The adjustment, and what the evidence says of its result."""

    FEW_WALLS_NEAR_PLAN = warning(
        "only {near_share:.0%} of the wall points lie near the plan in the end ({associated_count} of "
        "{patch_count} wall patches found a face): parts of the plan may be missing, moved or out of date, "
        "or it is the plan of another place",
        "look at the overlay",
    )
    WALLS_MOVED = warning(_moved_walls)
    WALL_MOVED = warning(_moved_wall)
    HELD_BY_ODOMETRY = warning(
        ("{which} {are} held by odometry alone: they match no other frame and see ", _unseen)
    )
    NOT_HELD = warning(
        (
            "{which} {are} not held by anything and stay where they were: they match no other frame and see ",
            _unseen,
        )
    )
    NO_WALL_HOLDS = warning(
        ("no wall of the plan holds ", _who, ": its alignment follows the recorded one")
    )
    NOTHING_HOLDS_ALONG = warning(
        (
            "nothing holds ",
            _who,
            _along,
            ": all walls that it sees run that way, and it stays there where the alignment put it",
        )
    )
    NOTHING_HOLDS_YAW = warning(("nothing holds the yaw of ", _who, ": it keeps the one it had"))
    MORE_HELD_WEAKLY = warning("{piece_count} more pieces of the scan are held as weakly")
    STEP_CHANGED = warning(
        "the step from frame {first} to {last} was changed from {recorded_m:.2f m} as recorded to "
        "{solved_m:.2f m} ({sigmas:.0f} sigmas): tracking may have failed there, or matches or walls were "
        "mistaken",
        "look at these frames",
    )
    MORE_STEPS_CHANGED = warning("{step_count} more steps were changed as much")
    ROUNDS_RAN_OUT = warning(
        "which scanned wall belongs to which wall of the plan was still changing when the solve ended",
        "give it more rounds: --adjust.max-alternations 10",
    )
    STOREY_NOT_WALKED = warning(
        "no frame stands on storey {storey_number}: its plan was not used", "check its number"
    )
    STOREY_WITHOUT_PLAN = warning(
        "frames {frames} stand on {storey}: they are held by matches, recorded motion and floor alone"
    )
    CAMERAS_MOVED = note(
        "cameras were moved by {moved_rms_m:.2f m} and are predicted to be within about "
        "{predicted_rms_m:.2f m} (both RMS)"
    )
    ERROR_EXPECTED = note(
        "expected position error {predicted_rms_m:.2f m}, worst {worst_m:.2f m} at frame {first}; "
        "{within_share:reached} of the frames are expected to be within {tolerance_m:g m}"
    )
    REVISITS_AGREE = note(
        "places seen again agree to {after_m:.3f m} in solves that did without them ({before_m:.3f m} "
        "before)"
    )
    WALLS_ON_PLAN = note(
        "{after_share:.0%} of the wall patches lie on the plan in solves that did without them "
        "({before_share:.0%} before)"
    )
    NOTHING_REFINED = against(
        (
            "nothing was refined: no frame matches another one or sees ",
            lambda has_plan: "the floor or a wall of the plan" if has_plan else "the floor",
            ", so that the error of the poses is not known",
        ),
        "use the recorded poses; check that depth is in metres and belongs to the images, or scan again with "
        "images that overlap",
    )
    PLACE_NOT_CERTAIN = against(("the place on the plan is not certain: ", lambda parts: parts[0]))
    PLACE_OF_SEVERAL = against(
        ("the place on the plan is one of several: ", lambda parts: parts[0]),
        "look at the overlay: where the scan lies as it should, use the refined poses, else choose another "
        "place with --candidate 2, or give control points",
    )
    REVISITS_CAME_APART = against(
        "places seen again came apart, from {before_m:.3f (m)} to {after_m:.3f m}, in solves that did "
        "without them"
    )
    ERROR_TOO_LARGE = against(
        "the predicted error, {predicted_rms_m:.2f m}, is too large a part of what was corrected, "
        "{moved_rms_m:.2f m}"
    )
    FRAMES_WITHOUT_PLACE = reservation(
        "frames {frames} have no place: neighbouring images do not match there, and neither a place that is "
        "surely seen again nor walls of the plan tell where the tracker went on",
        "leave these frames out, or scan that part again",
    )
    PATH_TORN = reservation(
        "the path is torn at frames {frames}: the result departs from the recorded motion by up to "
        "{departure_m:.1f m} and {departure_deg:.0f} deg in one step",
        "look at those frames: either the tracker jumped there, or places were confused",
    )
    WALK_LEAPS = reservation(
        "the walk leaps at frames {frames}, further than any walk does in a step: the tracker jumped there, "
        "and what follows was put at a place that may only look alike",
        "look at those frames, delete the loops that are wrong (planfit view), or scan that part again",
    )
    FITS_ELSEWHERE = reservation(
        (
            "the scan fits the plan about as well with its frames {rival_rms_m:.2f m} (RMS) elsewhere",
            _taken_for_moved,
        ),
        _check_of_rivals,
    )
    FRAMES_NOT_FIXED = reservation(
        (
            "frames {frames} are not fixed",
            _along,
            ": they may be off by {predicted_m:.2f m} (RMS), {within_share:reached} of them are expected to "
            "be within {tolerance_m:g m}",
        ),
        "scan that part again with places that were seen before and walls of both directions in view, or "
        "give control points there",
    )
    WALLS_ALONE = reservation(
        "nothing but walls corrects the recorded motion, as no images match, and only {near_share:.0%} of "
        "the wall patches lie on the plan in solves that did without them",
        "scan again where images show more, with more light or a wider view, or give control points",
    )
    REVISITS_CONTRADICT_RESULT = reservation(
        "of {revisit_count} times that a place is seen again, {contradicted_count} contradict the result, by "
        "{distance_m:.1f m}: frames {frames}",
        "look whether these frames show the same place; places that look alike are confused",
    )
    PLAN_STRAINS_TERM = reservation(
        "scan and plan contradict each other: the misfit of the {term} rises {misfit_ratio:.1f} times "
        "where the walls of the plan are used",
        "the plan may differ from the building where the report shows large distances, or be of another "
        "place or scale",
    )
    FRAMES_OFF_PLANS = reservation(
        "frames {frames} are on {storey}: matches, recorded motion and floor alone hold them",
        "give the plan of that storey too (--plan NUMBER=FILE)",
    )
    NOT_PLACED = reservation(
        "the scan is not placed on the plan: no wall was seen, and its poses only agree with each other",
        "give wall masks, or scan more of the walls",
    )
    ALL_MAY_BE_OFF = reservation(
        "all frames may be off by {predicted_rms_m:.2f m} (RMS): {within_share:reached} of them are expected "
        "to be within {tolerance_m:g m}",
        "scan again so that the walk comes back to places seen before",
    )
