"""Paths of an SVG as points, y up, curves flattened."""

import numpy as np
from jaxtyping import Bool, Float
from svgelements import Arc, Close, CubicBezier, Move, QuadraticBezier
from svgelements import Path as SvgPath

from planfit.floorplan.vector.line_work import flatten_cubic


def sub_paths(path: SvgPath) -> list[tuple[Float[np.ndarray, "_ 2"], Bool[np.ndarray, " _"]]]:
    """Each sub-path as points (k, 2), y up, and which of its segments (k - 1,) are curved."""
    result: list[tuple[np.ndarray, np.ndarray]] = []
    points: list[np.ndarray] = []
    curved: list[bool] = []

    def finish() -> None:
        if len(points) > 1:
            result.append((np.array(points), np.array(curved, dtype=bool)))

    for segment in path.segments(transformed=True):
        if isinstance(segment, Move):
            finish()
            points, curved = [xy_of(segment.end)], []
            continue
        if segment.end is None:
            continue
        if not points:
            points = [xy_of(segment.start)]
        if isinstance(segment, Close):
            if np.abs(points[-1] - points[0]).max() > 0:
                points.append(points[0])
                curved.append(False)
            finish()
            points, curved = [points[0]], []
            continue
        if isinstance(segment, Arc):
            cubics = list(segment.as_cubic_curves())
        elif isinstance(segment, CubicBezier):
            cubics = [segment]
        elif isinstance(segment, QuadraticBezier):
            start, control, end = (xy_of(p) for p in (segment.start, segment.control, segment.end))
            _extend(points, curved, np.array(
                [start, (start + 2 * control) / 3, (end + 2 * control) / 3, end]
            ))  # fmt: skip
            continue
        else:
            points.append(xy_of(segment.end))
            curved.append(False)
            continue
        for cubic in cubics:
            corners = (cubic.start, cubic.control1, cubic.control2, cubic.end)
            _extend(points, curved, np.array([xy_of(p) for p in corners]))
    finish()
    return result


def _extend(
    points: list[np.ndarray], curved: list[bool], controls: Float[np.ndarray, "4 2"]
) -> None:
    flat, is_bent = flatten_cubic(controls)
    points.extend(flat)
    curved.extend([is_bent] * len(flat))


def xy_of(point) -> Float[np.ndarray, "2"]:
    """A point of svgelements, y up."""
    return np.array([point.x, -point.y], dtype=float)
