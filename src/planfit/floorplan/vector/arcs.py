"""Circles through points, and paths that follow one: files hold many arcs as polylines."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from planfit.floorplan.vector.drawing import Lines
from planfit.geometry import segments

ROUND = 0.03
"""Points of an arc lie on its circle within this share of its radius."""
MIN_SEGMENTS = 4
_MIN_TURN, _MAX_BEND = np.deg2rad(40.0), np.deg2rad(50.0)
_LONG = 0.8
"""Segments of an arc are shorter than its radius by this factor: a bay of three walls is none."""


@dataclass(frozen=True)
class Circle:
    """Through points."""

    centre: Float[np.ndarray, "2"]
    radius: float


def fit_circle(points: Float[np.ndarray, "n 2"]) -> Circle | None:
    """Where all points lie on one within `ROUND`; None where they do not, as on a line."""
    middle = points.mean(axis=0)
    local = points - middle
    # |p|^2 = 2 c p + r^2 - |c|^2: linear in the centre c (Kasa 1976).
    design = np.column_stack([2 * local, np.ones(len(local))])
    solution, _, rank, _ = np.linalg.lstsq(design, np.sum(local**2, axis=1), rcond=None)
    if rank < 3:
        return None
    centre = solution[:2]
    radius = float(np.sqrt(max(solution[2] + centre @ centre, 0.0)))
    apart = np.abs(np.linalg.norm(local - centre, axis=1) - radius)
    if radius == 0 or apart.max() > ROUND * radius:
        return None
    return Circle(centre + middle, radius)


def arc_segments(lines: Lines) -> Bool[np.ndarray, " n"]:
    """Which segments are of paths that follow a circle round a good part of it, whatever each bend is."""
    n = len(lines)
    found = np.zeros(n, dtype=bool)
    if n < MIN_SEGMENTS:
        return found
    along = segments.directions(lines.ends)
    cross = along[:-1, 0] * along[1:, 1] - along[:-1, 1] * along[1:, 0]
    bend = np.arctan2(cross, np.einsum("ni,ni->n", along[:-1], along[1:]))
    length = segments.lengths(lines.ends)
    gap = np.linalg.norm(lines.ends[1:, 0] - lines.ends[:-1, 1], axis=1)
    joined = (
        (lines.path[:-1] == lines.path[1:])
        & (gap < 1e-3 * np.minimum(length[:-1], length[1:]))
        & (np.abs(bend) < _MAX_BEND)
    )
    starts = np.flatnonzero(np.concatenate([[True], ~joined]))
    stops = np.append(starts[1:], n)
    turned = np.concatenate([[0.0], np.cumsum(bend)])
    is_likely = (stops - starts >= MIN_SEGMENTS) & (
        np.abs(turned[stops - 1] - turned[starts]) > _MIN_TURN
    )
    for start, stop in zip(starts[is_likely].tolist(), stops[is_likely].tolist(), strict=True):
        points = np.concatenate([lines.ends[start:stop, 0], lines.ends[stop - 1 : stop, 1]])
        circle = fit_circle(points)
        if circle is not None and length[start:stop].max() < _LONG * circle.radius:
            found[start:stop] = True
    return found
