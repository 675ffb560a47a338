"""Compiled loops of verification: motions from triples of points, and which points agree with one.

As in `matching.pair_kernels`, shapes are in the docstrings: numba compiles types that nothing can wrap.
"""

import numpy as np

from planfit.compiled import kernel

MIN_SIDE_M = 0.2
"""Triples with a shorter side say too little of the rotation."""


@kernel
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


@kernel
def fit_triples(triples: np.ndarray, points_a: np.ndarray, points_b: np.ndarray) -> np.ndarray:
    """Rigid motions a_from_b (r, 4, 4) that fit triples (r, 3) of matched points (m, 3) best.

    By unit quaternions (Horn 1987): the best is the eigenvector of the largest eigenvalue of a matrix made of
    the sums of products of coordinates. A batch of decompositions in NumPy took 5 times as long.
    """
    motions = np.zeros((len(triples), 4, 4))
    products, symmetric, vectors = np.zeros((3, 3)), np.zeros((4, 4)), np.zeros((4, 4))
    mean_a, mean_b = np.zeros(3), np.zeros(3)
    for t in range(len(triples)):
        for i in range(3):
            mean_a[i] = mean_b[i] = 0.0
            for k in range(3):
                mean_a[i] += points_a[triples[t, k], i] / 3
                mean_b[i] += points_b[triples[t, k], i] / 3
        for i in range(3):
            for j in range(3):
                products[i, j] = 0.0  # of b's coordinate i and a's j, as in the paper
                for k in range(3):
                    b = points_b[triples[t, k], i] - mean_b[i]
                    products[i, j] += b * (points_a[triples[t, k], j] - mean_a[j])
        _horn_matrix(products, symmetric)
        rotation = motions[t, :3, :3]
        _rotation_of(_largest_eigenvector(symmetric, vectors), rotation)
        for i in range(3):
            motions[t, i, 3] = mean_a[i]
            for j in range(3):
                motions[t, i, 3] -= rotation[i, j] * mean_b[j]
        motions[t, 3, 3] = 1.0
    return motions


@kernel
def _horn_matrix(s: np.ndarray, n: np.ndarray) -> None:
    """Horn's matrix N (4, 4) from the sums of products S (3, 3), in place."""
    n[0, 0] = s[0, 0] + s[1, 1] + s[2, 2]
    n[1, 1] = s[0, 0] - s[1, 1] - s[2, 2]
    n[2, 2] = -s[0, 0] + s[1, 1] - s[2, 2]
    n[3, 3] = -s[0, 0] - s[1, 1] + s[2, 2]
    n[0, 1] = n[1, 0] = s[1, 2] - s[2, 1]
    n[0, 2] = n[2, 0] = s[2, 0] - s[0, 2]
    n[0, 3] = n[3, 0] = s[0, 1] - s[1, 0]
    n[1, 2] = n[2, 1] = s[0, 1] + s[1, 0]
    n[1, 3] = n[3, 1] = s[2, 0] + s[0, 2]
    n[2, 3] = n[3, 2] = s[1, 2] + s[2, 1]


@kernel
def _largest_eigenvector(a: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Eigenvector (4,) of the largest eigenvalue of a symmetric matrix (4, 4), by Jacobi's rotations.

    Both are overwritten: `a` by its eigenvalues on the diagonal, `v` by the eigenvectors.
    """
    v[:] = 0.0
    for k in range(4):
        v[k, k] = 1.0
    for _ in range(12):  # sweeps; six or fewer reach rounding
        off, size = 0.0, 0.0
        for p in range(4):
            size += a[p, p] ** 2
            for q in range(p + 1, 4):
                off += a[p, q] ** 2
        if off <= 1e-28 * (size + off):
            break
        for p in range(3):
            for q in range(p + 1, 4):
                if a[p, q] == 0.0:
                    continue
                theta = (a[q, q] - a[p, p]) / (2 * a[p, q])
                tangent = 1.0 / (abs(theta) + np.sqrt(theta * theta + 1.0))
                if theta < 0:
                    tangent = -tangent
                c = 1.0 / np.sqrt(tangent * tangent + 1.0)
                s = tangent * c
                for k in range(4):
                    a[k, p], a[k, q] = c * a[k, p] - s * a[k, q], s * a[k, p] + c * a[k, q]
                for k in range(4):
                    a[p, k], a[q, k] = c * a[p, k] - s * a[q, k], s * a[p, k] + c * a[q, k]
                    v[k, p], v[k, q] = c * v[k, p] - s * v[k, q], s * v[k, p] + c * v[k, q]
    best = 0
    for k in range(1, 4):
        if a[k, k] > a[best, best]:
            best = k
    return v[:, best]


@kernel
def _rotation_of(q: np.ndarray, rotation: np.ndarray) -> None:
    """Rotation (3, 3) of a unit quaternion (w, x, y, z), in place."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    rotation[0, 0], rotation[0, 1], rotation[0, 2] = (
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
    )  # fmt: skip
    rotation[1, 0], rotation[1, 1], rotation[1, 2] = (
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
    )  # fmt: skip
    rotation[2, 0], rotation[2, 1], rotation[2, 2] = (
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    )  # fmt: skip


@kernel
def best_motion(
    a_from_b: np.ndarray, points_a: np.ndarray, points_b: np.ndarray, tolerance: np.ndarray
) -> int:
    """Index of the motion (r, 4, 4) that brings points_b (m, 3) nearest to points_a, r >= 1.

    By truncated squares rather than counts (MSAC, Torr and Zisserman 2000): among motions that as many
    agree with, the tighter one wins. A motion is left as soon as it is worse than the best before it.
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


@kernel
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
    b_from_a = np.zeros((4, 4))  # np.eye takes 0.4 s to compile
    b_from_a[3, 3] = 1.0
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


@kernel
def _is_seen_at(point: tuple, camera: np.ndarray, uv: np.ndarray, max_px: float) -> bool:
    if not point[2] > 0:
        return False
    u = camera[0] * point[0] / point[2] + camera[2] - uv[0]
    v = camera[1] * point[1] / point[2] + camera[3] - uv[1]
    return u * u + v * v < max_px * max_px


@kernel
def _moved(transform: np.ndarray, p: np.ndarray) -> tuple:
    return (
        transform[0, 0] * p[0] + transform[0, 1] * p[1] + transform[0, 2] * p[2] + transform[0, 3],
        transform[1, 0] * p[0] + transform[1, 1] * p[1] + transform[1, 2] * p[2] + transform[1, 3],
        transform[2, 0] * p[0] + transform[2, 1] * p[1] + transform[2, 2] * p[2] + transform[2, 3],
    )


@kernel
def _distance_sq(a: np.ndarray | tuple, b: np.ndarray) -> float:
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2
