"""Curves as polylines."""

import numpy as np

PIECES = 12
"""Of a cubic: a quarter circle then strays by 0.2 % of its radius, a millimetre in a door's arc."""


def flatten_cubic(controls: np.ndarray) -> tuple[np.ndarray, bool]:
    """Points (k, 2) along a cubic with control points (4, 2), its first left out, and whether it bends.

    A straight one is one piece: some programs write straight walls as curves.
    """
    chord = controls[3] - controls[0]
    length_sq = float(chord @ chord)
    offset = controls[1:3] - controls[0]
    across = np.abs(offset[:, 0] * chord[1] - offset[:, 1] * chord[0])
    if length_sq > 0 and across.max() < 1e-3 * length_sq:
        return controls[3:], False
    t = (np.arange(1, PIECES + 1) / PIECES)[:, None]
    s = 1 - t
    points = (
        s**3 * controls[0]
        + 3 * s**2 * t * controls[1]
        + 3 * s * t**2 * controls[2]
        + t**3 * controls[3]
    )
    return points, True
