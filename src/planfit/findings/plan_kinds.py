"""Findings of where on the plan the scan is, and of what leaves that open, and their words."""

from planfit.findings.finding import MAX_NAMED, Kind, against, note, reservation, warning
from planfit.units import in_units

LINES = (
    "weak: the plan shows walls as single lines, so that its scale and the thickness of walls cannot be told "
    "apart; give a plan with both faces of each wall"
)
RIVAL = (
    "two alignments fit the plan almost equally well ({wall_share:.0%} and {other_wall_share:.0%} of the "
    "wall), "
)


def _apart(
    apart_m: float, apart_deg: float, metres_per_unit: float, other_metres_per_unit: float
) -> str:
    scales = _unlike(metres_per_unit, other_metres_per_unit)
    scale = f", scales {' and '.join(scales)} m a unit" if scales else ""
    return f"{in_units(apart_m, '.1f')} and {apart_deg:.0f} deg apart{scale}"


def _unlike(metres_per_unit: float, other_metres_per_unit: float) -> tuple[str, ...]:
    """Both scales as they are printed; empty where that is the same."""
    scales = f"{metres_per_unit:.4g}", f"{other_metres_per_unit:.4g}"
    return () if scales[0] == scales[1] else scales


def _step_between_places(metres_per_unit: float, other_metres_per_unit: float) -> str:
    place = "choose the other one with --candidate 2, or give control points"
    if not _unlike(metres_per_unit, other_metres_per_unit):
        return place
    return f"give the scale of the plan, which tells them apart (--scale 1:100, or metres a unit), or {place}"


def _little_wall(wall_share: float, min_wall_share: float, is_plan_metric: bool) -> str:
    unit = ", in metres" if is_plan_metric else ""
    return (
        f"only {wall_share:.0%} of the scanned wall lies on the plan's faces (at least "
        f"{min_wall_share:.0%} expected); is it the plan of this building{unit}?"
    )


def _centre_lines(offset_m: float) -> str:
    return (
        f"scanned walls stand {in_units(offset_m)} in front of the plan's lines, on either side: they seem "
        f"to be drawn by the centre lines of walls {in_units(2 * offset_m)} thick; positions are pulled by "
        "up to that half thickness, and a plan with both faces of each wall gives better ones"
    )


def _fitted_thickness(thickness_m: float, drawn_thickness_m: float) -> str:
    what = (
        f"strokes {in_units(drawn_thickness_m)} thick" if drawn_thickness_m > 0 else "single lines"
    )
    return (
        f"the plan draws walls as {what}: the scan shows them to be {in_units(thickness_m)} thick in "
        "the middle, half on either side of their lines, and each was taken to be as thick as it was seen; a "
        "plan with both faces of each wall gives better positions where only one side was seen"
    )


def _rescaled(scale_ratio: float, sigma_share: float) -> str:
    way = "small" if scale_ratio > 1 else "large"
    return (
        f"the plan is drawn {_off_share(scale_ratio):.1%} too {way}: its coordinates were multiplied by "
        f"{scale_ratio:.4f} (within {sigma_share:.1%}), so that lengths are the scan's; "
        f"{_same_look(scale_ratio)}"
    )


def _other_scale(scale_ratio: float, sigma_share: float) -> str:
    return (
        f"the plan would fit at {scale_ratio:.4f} times its size (within {sigma_share:.1%}): was it "
        f"printed, traced or shrunk? It was taken as drawn; {_same_look(scale_ratio)}"
    )


def _same_look(factor: float) -> str:
    way = "long" if factor > 1 else "short"
    return f"a scan whose depth and motion are {_off_share(factor):.1%} too {way} looks the same"


def _off_share(factor: float) -> float:
    return abs(1.0 / factor - 1.0)


WITHOUT_POINTS = (
    "without them {wall_share_without:.0%} of the scanned wall lies on the plan, {apart_m:.2f m} and "
    "{apart_deg:.0f} deg away from where they put the scan, and {wall_share_with:.0%} with them"
)
"""Where the walls put a scan whose control points put it elsewhere."""


def _points_off(points: tuple[str, ...], offs_m: tuple[float, ...]) -> str:
    named = [
        f"{name} ({in_units(off_m)} off there)" for name, off_m in zip(points, offs_m, strict=True)
    ]
    if len(named) > MAX_NAMED:
        named[MAX_NAMED:] = [f"{len(named) - MAX_NAMED} more"]
    return ", ".join(named) or "check them"


class PlanKind(Kind):
    """Where on the plan the scan is, and what leaves that open."""

    NOT_ALIGNED = warning("the scan is not aligned with the plan: its own axes were kept, levelled")
    NOT_AS_RECORDED = warning(
        "the scan's format says its poses are in the plan's axes, but the walls fit {apart_m:.1f m} and "
        "{apart_deg:.0f} deg away from there; that alignment was taken"
    )
    PLAN_MIRRORED = warning(
        "the plan is mirrored: {mirrored_wall_share:.0%} of the scanned wall fits it with left and "
        "right swapped, {wall_share:.0%} as drawn",
        lambda was_mirrored: f"run again {'without' if was_mirrored else 'with'} --mirror",
    )
    LITTLE_WALL_ON_PLAN = warning(_little_wall)
    AMBIGUOUS_PLACE = warning(
        ("ambiguous: ", RIVAL, _apart),
        _step_between_places,
    )
    OTHER_PLACE_BETTER = warning(
        (
            "another alignment fits the plan better ({other_wall_share:.0%} of the wall, {wall_share:.0%} "
            "here), ",
            _apart,
            "; the one asked for was taken",
        )
    )
    OTHER_PLACE_THAN_RECORDED = warning(
        (RIVAL, _apart, "; the one that the scan's format records was taken")
    )
    OTHER_PLACE_THAN_ASKED = warning((RIVAL, _apart, "; the one asked for was taken"))
    LITTLE_MARGIN = warning(
        "weak: {wall_share:.0%} of the scanned wall fits here and {other_wall_share:.0%} elsewhere, which "
        "the plan of another building may give as well",
        "look at the overlay, scan more walls, or give control points",
    )
    DIRECTION_OPEN = warning(
        "ambiguous: the walls leave the alignment open along one direction, as in a corridor whose "
        "ends were not seen",
        "scan an end of it, or give control points",
    )
    SCALE_OPEN = warning(
        "ambiguous: the walls leave the scale open", "give it, or two control points"
    )
    PARTS_DISAGREE = warning(
        "weak: parts of the scan fit the plan at alignments that differ by {sigma_yaw_deg:.1f} deg, "
        "{sigma_m:.2f m} and {sigma_scale_share:.1%} of scale; the scan is deformed, or shows too little "
        "wall"
    )
    PART_OFF_PLAN = warning(
        "weak: of the walk from {from_share:.0%} to {to_share:.0%} only {wall_share:.0%} of the wall lies on "
        "the plan; the scan is deformed there, or the plan shows other walls"
    )
    SCAN_DEFORMED = warning(
        "weak: the walls fit the plan only when the scan is deformed by {deformation_m:.2f m} over "
        "{extent_m:.0f m}; drift is left that no loop has closed"
    )
    PLAN_SEEN_THROUGH = warning(
        "weak: the camera saw through {seen_through_share:.0%} of the plan's wall where it looked "
        "({judged_m:.0f m}); is it the plan of this building and storey?"
    )
    CENTRE_LINES = note(_centre_lines)
    CENTRE_LINES_OF_THICK_WALLS = warning(("weak: ", _centre_lines))
    SINGLE_LINES = warning(LINES)
    THICKNESS_FITTED = note(_fitted_thickness)
    PLAN_RESCALED = warning(
        _rescaled,
        "compare a length that you know, and where the plan is right, run again with "
        "--align.metric-scale-tolerance 0",
        joint=": ",
    )
    OTHER_SCALE = reservation(
        _other_scale,
        "compare a length that you know; where the plan is off, run again with "
        "--align.metric-scale-tolerance {tolerance_share:g}, which takes that scale",
    )
    POINTS_LEAVE_LITTLE_WALL = warning(
        "with the control points given, the plan explains only {wall_share:.0%} of the wall",
        "check their numbers, or leave them out",
        joint=": ",
    )
    POINTS_AGAINST_WALLS = warning(
        (f"the control points given disagree with the walls: {WITHOUT_POINTS}: ", _points_off)
    )
    PLACE_OFF_BY_WALLS = warning("{off_m:.2f m} off where the walls put it: " + WITHOUT_POINTS)
    EXTENTS_DIFFER = warning(
        "the paper's method needs a scan of the whole plan and of nothing else, but the extents of "
        "scan and plan have the ratios {x_ratio:.3g} and {y_ratio:.3g} along the plan's axes"
    )
    FEW_RIGHT_ANGLES = warning(
        "the paper's method needs walls at right angles, but only {orthogonal_share:.0%} of the scan's "
        "normals are near two orthogonal directions"
    )
    ROTATIONS_ALIKE = warning(
        "the paper's method takes the nearest of four rotations, but two are alike: mean distances "
        "{distance_m:.2f (m)} and {other_distance_m:.2f m}"
    )
    LITTLE_WALL_BY_PAPER = warning(
        "only {wall_share:.0%} of the scanned wall lies on the plan's faces (at least {min_wall_share:.0%} "
        "expected) where the paper's method puts it"
    )
    ADJUSTED_MIRRORED = against("the scan fits the plan better with left and right swapped")
    ADJUSTED_FITS_ELSEWHERE = against(
        "the adjusted walls fit the plan elsewhere almost as well ({wall_share:.0%} of the wall here, "
        "{other_wall_share:.0%} there)"
    )
    ADJUSTED_AT_OTHER_SCALE = against(
        "at another scale than the plan is drawn at, {wall_share:.0%} of the adjusted wall lies on it, and "
        "{other_wall_share:.0%} elsewhere, which the plan of another building may give as well"
    )
    ADJUSTED_LITTLE_MARGIN = against(
        "{wall_share:.0%} of the adjusted wall lies on the plan here and {other_wall_share:.0%} elsewhere, "
        "which the plan of another building may give as well"
    )
    ADJUSTED_LITTLE_WALL = against(
        "only {wall_share:.0%} of the adjusted wall lies on the plan, which may be of another place, storey "
        "or time"
    )
    ADJUSTED_SEEN_THROUGH = against(
        "only {wall_share:.0%} of the adjusted wall lies on the plan, and the camera saw through "
        "{seen_through_share:.0%} of the plan's wall where it looked: it seems to be of another place or "
        "storey"
    )
    ADJUSTED_SINGLE_LINES = against(f"the place is {LINES}")
