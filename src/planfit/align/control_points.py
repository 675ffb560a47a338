"""What a user knows about the place: pinned points, and a rough start."""

from dataclasses import dataclass

import numpy as np

from planfit.errors import OptionError
from planfit.floorplan import Floorplan


@dataclass(frozen=True)
class ControlPoint:
    """A point of the scan whose place on the plan is known, both seen from above."""

    level_xy: np.ndarray  # (2,) m, level frame
    plan_xy: np.ndarray  # (2,) plan frame, in the plan's unit


def parse_control_point(text: str) -> tuple[np.ndarray, np.ndarray]:
    """World point (3,) and plan point (2,) of "x,y,z=u,v".

    Raises:
        OptionError: it is not of this form.
    """
    scan, separator, plan = text.partition("=")
    world, place = _numbers(scan), _numbers(plan)
    if not separator or world is None or place is None or len(world) != 3 or len(place) != 2:
        raise OptionError(
            f"align.pins: expected x,y,z=u,v (a point of the scan = the same point on the plan), "
            f"found {text!r}"
        )
    return np.array(world), np.array(place)


def parse_start(text: str) -> tuple[np.ndarray, float]:
    """Plan point (2,) m of the level frame's origin and turn (rad) of "x,y,turn_deg".

    Raises:
        OptionError: it is not of this form.
    """
    values = _numbers(text)
    if values is None or len(values) != 3:
        raise OptionError(
            f"align.start: expected x,y,turn (metres, metres, degrees), found {text!r}"
        )
    return np.array(values[:2]), float(np.deg2rad(values[2]))


def place_control_points(
    texts: tuple[str, ...], level_from_world: np.ndarray, floorplan: Floorplan
) -> tuple[ControlPoint, ...]:
    """Pins from their texts: the scan's side levelled, the plan's side out of the file's coordinates."""
    control_points = []
    plan_from_file = np.eye(3)
    if floorplan.source.file_from_plan is not None:
        plan_from_file = np.linalg.inv(floorplan.source.file_from_plan)
    for text in texts:
        world, file_uv = parse_control_point(text)
        level = level_from_world[:3, :3] @ world + level_from_world[:3, 3]
        on_plan = plan_from_file @ np.array([*file_uv, 1.0])
        control_points.append(ControlPoint(level[:2], on_plan[:2] / on_plan[2]))
    return tuple(control_points)


def fit_control_points(
    control_points: tuple[ControlPoint, ...], metres_per_unit: float | None, tolerance_m: float
) -> tuple[float, np.ndarray, float]:
    """Turn (rad), shift (2,) m and metres per unit that bring two pins or more together.

    Args:
        pins: at least two.
        metres_per_unit: where the scale is known; None fits it (Umeyama 1991).
        tolerance_m: how far off a pin may end.

    Raises:
        OptionError: pins are at one point, or they disagree.
    """
    scan = np.array([pin.level_xy for pin in control_points])
    plan = np.array([pin.plan_xy for pin in control_points])
    scan_middle, plan_middle = scan.mean(axis=0), plan.mean(axis=0)
    a, b = scan - scan_middle, plan - plan_middle
    spread, plan_spread = float(np.sum(a**2)), float(np.sum(b**2))
    if spread < 1e-6 or plan_spread < 1e-12:
        raise OptionError("align.pins: expected pins at different points, found all at one")
    # As complex numbers: b = z a / scale turns and scales at once.
    z = np.sum(np.conj(a[:, 0] + 1j * a[:, 1]) * (b[:, 0] + 1j * b[:, 1]))
    yaw = float(np.angle(z))
    scale = float(spread / max(abs(z), 1e-30)) if metres_per_unit is None else metres_per_unit
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, -s], [s, c]])
    shift = scale * plan_middle - turn @ scan_middle
    off_m = np.linalg.norm(scan @ turn.T + shift - scale * plan, axis=1)
    if off_m.max() > tolerance_m:
        raise OptionError(
            f"align.pins: expected pins that agree within {tolerance_m:g} m, found number "
            f"{int(np.argmax(off_m)) + 1} off by {off_m.max():.2f} m; check its points, which axis "
            "goes up, and that the plan is not mirrored"
        )
    return yaw, shift, scale


def _numbers(text: str) -> list[float] | None:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        return None
    return values if np.isfinite(values).all() else None
