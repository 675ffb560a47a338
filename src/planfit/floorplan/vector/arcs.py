"""Circles through points, and paths and walls that follow one: files hold many arcs as polylines."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.floorplan.vector.drawing import Lines
from planfit.floorplan.vector.line_work import WallFaces
from planfit.geometry import segments

ROUND = 0.03
"""Points of an arc lie on its circle within this share of its radius."""
MIN_SEGMENTS = 4
_MIN_TURN, _MAX_BEND = np.deg2rad(40.0), np.deg2rad(50.0)
_LONG = 0.8
"""Segments of an arc are shorter than its radius by this factor: a bay of three walls is none."""
_APART = (0.25, 5.0)
"""How far apart the two lines are, in thicknesses of the straight walls: outer walls are up to five times as
thick as partitions."""
_LEAST_RADIUS = 6.0
"""In these thicknesses too: round tables with an edge are smaller."""
_SAME_CENTRE = 0.25
"""Of that distance, how far the two centres may be from each other."""


@dataclass(frozen=True)
class Circle:
    """Through points."""

    centre: Float[np.ndarray, "2"]
    radius: float

    def apart(self, points: Float[np.ndarray, "n 2"]) -> float:
        """How far the furthest of some points is from it."""
        return float(np.abs(np.linalg.norm(points - self.centre, axis=1) - self.radius).max())


def fit_circle(points: Float[np.ndarray, "n 2"]) -> Circle | None:
    """Where all points lie on one within `ROUND`; None where they do not, as on a line."""
    circle = nearest_circle(points)
    if circle is None or circle.radius == 0:
        return None
    return circle if circle.apart(points) <= ROUND * circle.radius else None


def nearest_circle(points: Float[np.ndarray, "n 2"]) -> Circle | None:
    """The circle of least squares; None of points on a line."""
    middle = points.mean(axis=0)
    local = points - middle
    # |p|^2 = 2 c p + r^2 - |c|^2: linear in the centre c (Kasa 1976).
    design = np.column_stack([2 * local, np.ones(len(local))])
    solution, _, rank, _ = np.linalg.lstsq(design, np.sum(local**2, axis=1), rcond=None)
    if rank < 3:
        return None
    centre = solution[:2]
    radius = float(np.sqrt(max(solution[2] + centre @ centre, 0.0)))
    return Circle(centre + middle, radius)


def arc_segments(lines: Lines) -> Bool[np.ndarray, " n"]:
    """Which segments are of paths that follow a circle round a good part of it, whatever each bend is."""
    n = len(lines)
    found = np.zeros(n, dtype=bool)
    if n < MIN_SEGMENTS:
        return found
    bend, joined = joints(lines)
    joined &= np.abs(bend) < _MAX_BEND
    length = segments.lengths(lines.ends)
    starts = np.flatnonzero(np.concatenate([[True], ~joined]))
    stops = np.append(starts[1:], n)
    turned = np.concatenate([[0.0], np.cumsum(bend)])
    turn = np.abs(turned[stops - 1] - turned[starts])
    is_likely = (stops - starts >= MIN_SEGMENTS) & (turn > _MIN_TURN)
    for start, stop in zip(starts[is_likely].tolist(), stops[is_likely].tolist(), strict=True):
        points = np.concatenate([lines.ends[start:stop, 0], lines.ends[stop - 1 : stop, 1]])
        circle = fit_circle(points)
        if circle is not None and length[start:stop].max() < _LONG * circle.radius:
            found[start:stop] = True
    return found


def joints(lines: Lines) -> tuple[Float[np.ndarray, " m"], Bool[np.ndarray, " m"]]:
    """Of each two segments in sequence by how much the second turns from the first, rad, to the left > 0, and
    whether it goes on where that ends, on one path."""
    along, length = segments.directions(lines.ends), segments.lengths(lines.ends)
    gap = np.linalg.norm(lines.ends[1:, 0] - lines.ends[:-1, 1], axis=1)
    shorter = np.minimum(length[:-1], length[1:])
    is_one = (lines.path[:-1] == lines.path[1:]) & (gap < 1e-3 * shorter)
    return segments.turns(along[:-1], along[1:]), is_one


def curve_runs(lines: Lines) -> tuple[Int[np.ndarray, " c"], Int[np.ndarray, " c"]]:
    """Index of each segment of a curve, in the order of the file, and the number of the run it is in."""
    at = np.flatnonzero(lines.is_curved)
    if len(at) == 0:
        return at, at
    ends, along = lines.ends[at], segments.directions(lines.ends[at])
    gap = np.linalg.norm(ends[1:, 0] - ends[:-1, 1], axis=1)
    joined = (
        (np.diff(at) == 1)
        & (gap <= 1e-3 * segments.lengths(ends)[1:])
        & (np.einsum("ni,ni->n", along[1:], along[:-1]) > 0.5)
    )
    return at, np.cumsum(np.concatenate([[True], ~joined])) - 1


def round_walls(lines: Lines, usual_thickness: float) -> tuple[WallFaces, Bool[np.ndarray, " n"]]:
    """Faces of round walls, and which lines they are.

    `lines`: of the drawing, in the order of the file; `usual_thickness`: of its straight walls.
    """
    at, run = curve_runs(lines)
    own, circles = _arcs(lines.ends[at], run, _LEAST_RADIUS * usual_thickness)
    arcs, centres, radii = at[own], circles[:, :2], circles[:, 2]
    found = np.zeros(len(lines), dtype=bool)
    ends = lines.ends[arcs]
    middles = ends.mean(axis=1)
    gap = np.full(len(arcs), np.nan)
    least, most = _APART[0] * usual_thickness, _APART[1] * usual_thickness
    for row in np.unique(circles, axis=0):
        apart = radii - row[2]
        distance = np.abs(apart)
        is_pair = (distance > least) & (distance < most)
        is_pair &= np.linalg.norm(centres - row[:2], axis=1) < _SAME_CENTRE * distance
        other = np.flatnonzero((circles == row).all(axis=1))
        for k in np.flatnonzero(is_pair):
            reach = np.linalg.norm(middles[other] - middles[k], axis=1)
            beside = reach < distance[k] + 0.5 * segments.lengths(ends[other]) + 0.1 * distance[k]
            if beside.any() and not abs(gap[k]) < distance[k]:
                gap[k] = apart[k]
    is_face = np.isfinite(gap)
    found[arcs[is_face]] = True
    outwards = middles[is_face] - centres[is_face]
    normals = segments.left_normals(ends[is_face])
    # The outer one of the two looks away from the centre.
    side = np.sign(np.einsum("ni,ni->n", normals, outwards)) * np.sign(gap[is_face])
    return WallFaces.oriented(ends[is_face], normals * side[:, None], np.abs(gap[is_face])), found


def _arcs(
    ends: Float[np.ndarray, "c 2 2"], run: Int[np.ndarray, " c"], least_radius: float
) -> tuple[Int[np.ndarray, " k"], Float[np.ndarray, "k 3"]]:
    """Segments of runs that follow one circle larger than that; its centre and radius."""
    own, circles = [np.zeros(0, dtype=int)], [np.zeros((0, 3))]
    for part in np.split(np.arange(len(run)), np.flatnonzero(np.diff(run)) + 1):
        circle = fit_circle(ends[part].reshape(-1, 2)) if len(part) > 2 else None
        if circle is not None and circle.radius > least_radius:
            own.append(part)
            circles.append(np.tile([*circle.centre, circle.radius], (len(part), 1)))
    return np.concatenate(own), np.concatenate(circles)
