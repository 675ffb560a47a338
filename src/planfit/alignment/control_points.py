"""What a user knows about the alignment: control points, and a rough start."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from planfit.errors import OptionError
from planfit.floorplan import Floorplan


@dataclass(frozen=True)
class ControlPoint:
    """A point of the scan whose location on the plan is known, both seen from above."""

    level_xy: Float[np.ndarray, " 2"]
    """Metres, level frame."""
    plan_xy: Float[np.ndarray, " 2"]
    """Plan frame, in the plan's unit."""


def parse_control_point(text: str) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 2"]]:
    """World point (m) and plan point (the file's coordinates) of "x,y,z=u,v".

    Raises:
        OptionError: it is not of this form.
    """
    scan, separator, plan = text.partition("=")
    world, on_plan = _numbers(scan), _numbers(plan)
    if not separator or world is None or on_plan is None or (len(world), len(on_plan)) != (3, 2):
        raise OptionError(
            f"align.control-points: expected x,y,z=u,v (a point of the scan = the same point on the plan), "
            f"found {text!r}"
        )
    return np.array(world), np.array(on_plan)


def parse_start(text: str) -> tuple[Float[np.ndarray, " 2"], float]:
    """Plan point (m) of the level frame's origin and yaw (rad) of "x,y,yaw_deg".

    Raises:
        OptionError: it is not of this form.
    """
    values = _numbers(text)
    if values is None or len(values) != 3:
        raise OptionError(
            f"align.start: expected x,y,yaw (metres, metres, degrees), found {text!r}"
        )
    return np.array(values[:2]), float(np.deg2rad(values[2]))


def read_control_points(
    texts: tuple[str, ...], level_from_world: Float[np.ndarray, "4 4"], floorplan: Floorplan
) -> tuple[ControlPoint, ...]:
    """Control points of texts: the scan's side levelled, the plan's side out of the file's coordinates."""
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
    control_points: Sequence[ControlPoint], metres_per_unit: float | None, tolerance_m: float
) -> tuple[float, Float[np.ndarray, " 2"], float]:
    """Yaw (rad), translation (m) and metres per unit that bring two control points or more together.

    Args:
        control_points: at least two.
        metres_per_unit: where the scale is known; None fits it (Umeyama 1991).
        tolerance_m: how far off a control point may end.

    Raises:
        OptionError: the points are one point, or they disagree.
    """
    scan = np.array([point.level_xy for point in control_points])
    plan = np.array([point.plan_xy for point in control_points])
    scan_middle, plan_middle = scan.mean(axis=0), plan.mean(axis=0)
    a, b = scan - scan_middle, plan - plan_middle
    scatter, plan_scatter = float(np.sum(a**2)), float(np.sum(b**2))
    if scatter < 1e-6 or plan_scatter < 1e-12:
        raise OptionError("align.control-points: expected different points, found all at one")
    # As complex numbers: b = z a / scale rotates and scales at once.
    z = np.sum(np.conj(a[:, 0] + 1j * a[:, 1]) * (b[:, 0] + 1j * b[:, 1]))
    yaw = float(np.angle(z))
    scale = float(scatter / max(abs(z), 1e-30)) if metres_per_unit is None else metres_per_unit
    c, s = np.cos(yaw), np.sin(yaw)
    rotation = np.array([[c, -s], [s, c]])
    translation = scale * plan_middle - rotation @ scan_middle
    off_m = np.linalg.norm(scan @ rotation.T + translation - scale * plan, axis=1)
    if off_m.max() > tolerance_m:
        raise OptionError(
            f"align.control-points: expected points that agree within {tolerance_m:g} m, found number "
            f"{int(np.argmax(off_m)) + 1} off by {off_m.max():.2f} m; check its points, which axis "
            "goes up, and that the plan is not mirrored"
        )
    return yaw, translation, scale


def _numbers(text: str) -> list[float] | None:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        return None
    return values if np.isfinite(values).all() else None
