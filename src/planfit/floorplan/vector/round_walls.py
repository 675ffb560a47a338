"""Round walls drawn as two lines: arcs about one centre, as far apart as the faces of a wall."""

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.floorplan.vector.arcs import fit_circle
from planfit.floorplan.vector.double_lines import LineFaces
from planfit.floorplan.vector.drawing import Lines
from planfit.floorplan.vector.openings import curve_runs
from planfit.geometry import segments

APART = (0.25, 5.0)
"""How far apart the two lines are, in thicknesses of the straight walls: outer walls are up to five times as
thick as partitions."""
LEAST_RADIUS = 6.0
"""In these thicknesses too: round tables with an edge are smaller."""
SAME_CENTRE = 0.25
"""Of that distance, how far the two centres may be from each other."""


def round_walls(lines: Lines, usual_thickness: float) -> tuple[LineFaces, Bool[np.ndarray, " n"]]:
    """Faces of round walls, and which lines they are.

    Args:
        lines: of the drawing, in the order of the file.
        usual_thickness: of its straight walls.
    """
    at, run = curve_runs(lines)
    own, circles = _arcs(lines.ends[at], run, LEAST_RADIUS * usual_thickness)
    arcs, centres, radii = at[own], circles[:, :2], circles[:, 2]
    found = np.zeros(len(lines), dtype=bool)
    ends = lines.ends[arcs]
    middles = ends.mean(axis=1)
    gap = np.full(len(arcs), np.nan)
    for row in np.unique(circles, axis=0):
        apart = radii - row[2]
        distance = np.abs(apart)
        is_pair = (distance > APART[0] * usual_thickness) & (distance < APART[1] * usual_thickness)
        is_pair &= np.linalg.norm(centres - row[:2], axis=1) < SAME_CENTRE * distance
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
    n = int(is_face.sum())
    faces = LineFaces(
        ends[is_face],
        normals * side[:, None],
        np.ones(n, bool),
        np.abs(gap[is_face]),
        np.full(n, -1),
    )
    return faces, found


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
