"""Findings of what a scan shows, and of its sensor, and their words."""

from planfit.findings.finding import Kind, note, warning
from planfit.priors import VIEW_DISTANCE_M
from planfit.units import in_units

FAR_M = VIEW_DISTANCE_M.value
"""Distance at which the quadratic part of depth is told in metres."""


def _drifted_floor(floors_m: tuple[float, ...]) -> str:
    heights = " and ".join(in_units(height, "+.1f") for height in floors_m)
    return (
        f"the recorded poses drift in height: the floor was recorded at {heights} as well, and matches "
        "and motion show that it is the same"
    )


def _floor_pieces(heights_m: tuple[float, ...], slopes: tuple[float, ...]) -> str:
    higher = [in_units(height, "+.2f") for height in heights_m[1:]]
    sloped = [f"{slope:.1%}" for slope in slopes if slope]
    levels = [f"has pieces at {' and '.join(higher)}"] if higher else []
    falls = [f"slopes by {' and '.join(sloped)}"] if sloped else []
    return (
        f"the floor is not one level plane: it {' and '.join([*levels, *falls])}; heights follow it"
    )


def _others(has_plan: bool) -> str:
    return "walls and floor" if has_plan else "the floor"


def _check_of_matches(has_colour: bool) -> str:
    if has_colour:
        return "check that colour images are sharp and belong to the depth"
    return "check that frames that follow each other show the same surfaces"


def _torn_revisit(runs: tuple[tuple[int, int], ...], recorded_m: float, solved_m: float) -> str:
    one, other = (
        f"frame {first}" if first == last else f"frames {first}-{last}" for first, last in runs
    )
    return (
        f"{one} and {other} look alike but cannot be the same place: using them would change a "
        f"recorded step of {in_units(recorded_m)} to {in_units(solved_m)}; they were left out"
    )


def _correction(parameter: str, departure: float, found: float, sigma: float) -> str:
    """A parameter that is kept: what was measured or given wrongly, and what was done."""
    off, too = departure, "long" if departure < 0 else "short"
    match parameter:
        case "depth_scale":
            share = abs(1 / found - 1)
            return (
                f"depth was measured {share:.1%} too {too}: corrected by {found:.4f} +- {sigma:.4f}"
            )
        case "depth_offset_m":
            return (
                f"depth was measured {in_units(abs(off), '.3f')} too {too} at every distance: corrected by "
                f"{in_units(off, '+.3f', '')} +- {in_units(sigma, '.3f')}"
            )
        case "depth_quadratic_per_m":
            return (
                f"depth was measured too {too} by its square, {in_units(abs(off) * FAR_M**2, '.3f')} at "
                f"{in_units(FAR_M, 'g')}: corrected by {off:+.4f} +- {sigma:.4f} times its square (1/m)"
            )
        case "focal_scale" | "focal_aspect":
            which = "" if parameter == "focal_scale" else " in y"
            share = abs(1 / found - 1)
            return (
                f"the focal length{which} was given {share:.1%} too {too}: corrected by "
                f"{found:.4f} +- {sigma:.4f}"
            )
        case _:
            return (
                f"the principal point was given {abs(off):.1f} px off in {parameter[-1]}: moved by "
                f"{off:+.1f} +- {sigma:.1f} px"
            )


def _request(parameter: str, unit: str, departure: float) -> str:
    """A parameter that is implausible: what it would have to be."""
    off = abs(departure)
    much = {
        "": f"{off:.1%}",
        "m": in_units(off),
        "1/m": f"{in_units(off * FAR_M**2)} at {in_units(FAR_M, 'g')}",
        "px": f"{off:.0f} px",
    }[unit]
    what = {
        "depth_scale": "depth",
        "depth_offset_m": "an offset of the depth",
        "depth_quadratic_per_m": "depth by its square",
        "focal_scale": "a focal length",
        "focal_aspect": "a focal length in y",
        "principal_x": "a principal point in x",
        "principal_y": "a principal point in y",
    }[parameter]
    return f"{what} {much} off"


def _either(p_sensor: float | None) -> str:
    if p_sensor is None:
        return ""
    return (
        f"; geometry without keypoints gives {p_sensor:.0%} to intrinsics of another camera or image size, "
        f"{1 - p_sensor:.0%} to colour and depth that are not registered to each other"
    )


def _check_of_sensor(is_of_depth: bool, is_of_lens: bool) -> str:
    unit = (
        "check the unit of the depth (--depth-scale), and the calibration that the device exports"
    )
    registration = (
        "colour and depth may not be registered to each other, or the intrinsics be those of another camera "
        "or image size: check the export of the scan"
    )
    return "; ".join([unit] * is_of_depth + [registration] * is_of_lens)


class ScanKind(Kind):
    """What a scan shows, and its sensor."""

    FEW_FRAMES = warning(
        "only {frame_count} frames: there is little to hold the poses together",
        "more frames that see the same places give a surer result",
    )
    GRAVITY_UNSURE = warning(
        "gravity is unsure (from {source})", "check that the floor is level in the report"
    )
    NO_FLOOR = warning(
        "no floor was seen: height and tilt follow the recorded poses, and where the floor lies below them "
        "is supposed",
        "tilt the camera down while scanning, or give floor masks",
    )
    FLOOR_NOT_LEVEL = note(_floor_pieces)
    FLOOR_DRIFTED = warning(
        _drifted_floor, "if there are stairs, scan them with images that overlap"
    )
    NO_WALL = warning(
        "no wall was seen: the scan cannot be aligned with the plan by its walls, and only the "
        "matches and the floor were used",
        "give wall masks, or scan more of the walls",
    )
    NO_COLOUR = note(("the scan has no colour: ", lambda parts: parts[0]))
    MATCHED_BY_GEOMETRY = note(
        "{pair_count} pairs of frames were matched by geometry alone, of which {free_pair_count} say nothing "
        "of motion along some direction, as before one flat wall"
    )
    NO_MATCHES = warning(
        ("no two frames could be matched: poses can be refined by ", _others, " alone"),
        _check_of_matches,
    )
    NO_LOOPS = warning(
        (
            "no place was seen to be visited again (no loop closure): drift along the path is corrected by ",
            _others,
            " only",
        )
    )
    REVISIT_TEARS_STEP = note(_torn_revisit)
    SENSOR_CORRECTED = note(lambda parts: "; ".join(parts))
    SENSOR_IMPLAUSIBLE = warning(
        (
            "the scan asks for ",
            lambda parts: " and ".join(parts),
            ", more than a camera can be off: nothing was corrected",
            _either,
        ),
        _check_of_sensor,
    )
    PARAMETER_CORRECTED = note(_correction)
    PARAMETER_IMPLAUSIBLE = warning(_request)
