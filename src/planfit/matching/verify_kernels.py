"""Compiled loops over the matches of one pair of frames.

In NumPy they are hundreds of calls on arrays of a few hundred rows, each under the interpreter's lock:
a second thread then mostly waits.
"""

import numba
import numpy as np

MIN_SIDE_M = 0.2
"""Triples with a shorter side say too little of the turn."""


@numba.njit(cache=True, nogil=True)
def rigid_triples(
    triples: np.ndarray,
    points_a: np.ndarray,
    points_b: np.ndarray,
    tolerance: np.ndarray,
    most: int,
) -> np.ndarray:
    """Indices (r,) of the first `most` triples (t, 3) whose mutual distances agree in both frames.

    A rigid motion keeps distances: those of points (m, 3) may differ by their tolerances (m,), m.
    """
    kept = np.zeros(most, dtype=np.int64)
    n_kept = 0
    for t in range(len(triples)):
        is_rigid = True
        for side in range(3):
            j, k = triples[t, side], triples[t, (side + 1) % 3]
            side_a = np.sqrt(_distance_sq(points_a[j], points_a[k]))
            side_b = np.sqrt(_distance_sq(points_b[j], points_b[k]))
            allowed = np.sqrt(tolerance[j] ** 2 + tolerance[k] ** 2)
            if not (abs(side_a - side_b) < allowed and side_a > MIN_SIDE_M):
                is_rigid = False
                break
        if is_rigid:
            kept[n_kept] = t
            n_kept += 1
            if n_kept == most:
                break
    return kept[:n_kept]


@numba.njit(cache=True, nogil=True)
def best_motion(
    a_from_b: np.ndarray, points_a: np.ndarray, points_b: np.ndarray, tolerance: np.ndarray
) -> int:
    """Index of the motion (r, 4, 4) that brings points_b (m, 3) nearest to points_a, r >= 1.

    By truncated squares rather than counts (MSAC): ties among good motions go to the tighter one. A
    motion is left as soon as it is worse than the best before it.
    """
    best, least = 0, np.inf
    for r in range(len(a_from_b)):
        score = 0.0
        for k in range(len(points_a)):
            moved = _moved(a_from_b[r], points_b[k])
            score += min(_distance_sq(moved, points_a[k]) / tolerance[k] ** 2, 1.0)
            if score >= least:
                break
        if score < least:
            best, least = r, score
    return best


@numba.njit(cache=True, nogil=True)
def agreeing(
    a_from_b: np.ndarray,
    points_a: np.ndarray,
    points_b: np.ndarray,
    uv_a: np.ndarray,
    uv_b: np.ndarray,
    cameras: np.ndarray,
    tolerance: np.ndarray,
    max_reprojection_px: float,
) -> np.ndarray:
    """Which matches (m,) lie together in 3D, within tolerance (m,) m, and in both images.

    `cameras` (2, 4) are fx fy cx cy of both. A point behind a camera is in no image.
    """
    b_from_a = np.eye(4)
    for r in range(3):
        for c in range(3):
            b_from_a[r, c] = a_from_b[c, r]
            b_from_a[r, 3] -= a_from_b[c, r] * a_from_b[c, 3]
    agrees = np.zeros(len(points_a), dtype=np.bool_)
    for k in range(len(points_a)):
        b_in_a = _moved(a_from_b, points_b[k])
        agrees[k] = (
            _distance_sq(b_in_a, points_a[k]) < tolerance[k] ** 2
            and _is_seen_at(b_in_a, cameras[0], uv_a[k], max_reprojection_px)
            and _is_seen_at(_moved(b_from_a, points_a[k]), cameras[1], uv_b[k], max_reprojection_px)
        )
    return agrees


@numba.njit(cache=True, nogil=True)
def _is_seen_at(point: tuple, camera: np.ndarray, uv: np.ndarray, max_px: float) -> bool:
    if not point[2] > 0:
        return False
    u = camera[0] * point[0] / point[2] + camera[2] - uv[0]
    v = camera[1] * point[1] / point[2] + camera[3] - uv[1]
    return u * u + v * v < max_px * max_px


@numba.njit(cache=True, nogil=True)
def _moved(transform: np.ndarray, p: np.ndarray) -> tuple:
    return (
        transform[0, 0] * p[0] + transform[0, 1] * p[1] + transform[0, 2] * p[2] + transform[0, 3],
        transform[1, 0] * p[0] + transform[1, 1] * p[1] + transform[1, 2] * p[2] + transform[1, 3],
        transform[2, 0] * p[0] + transform[2, 1] * p[1] + transform[2, 2] * p[2] + transform[2, 3],
    )


@numba.njit(cache=True, nogil=True)
def _distance_sq(a: np.ndarray | tuple, b: np.ndarray) -> float:
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2
