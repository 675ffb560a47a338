"""Compiled loops of surface matching: a pair of surface grids brought together, and how far they agree.

As in `matching.pair_kernels`, shapes are in the docstrings: numba compiles types that nothing can wrap.
A view is (depth (r, c) m, normals (r, c, 3) times 127, fx fy cx cy in cells).
"""

import numpy as np

from planfit.compiled import kernel

LOSS_SIGMAS = 2.0
"""Scale of Cauchy's loss, in sigmas."""
_MAX_TURN_COSINE = 0.8
"""Normals of one surface seen from two places agree within 37 degrees; the corner of a room does not."""
MIN_CELLS = 60
"""With fewer cells in common nothing is said."""
_ROUNDS = 12
"""Steps at the last gate, at most."""
_STILL = 1e-4
"""A step shorter than this, m (rotations by their lever), ends them."""
GATES_M = np.array([0.8, 0.6, 0.5, 0.4, 0.3, 0.2, 0.15, 0.1])
"""Distances of cells that are taken for one surface, one after the other."""
K = 7
"""Parameters of a sensor."""


@kernel
def bring_together(
    view_a: tuple,
    view_b: tuple,
    start: np.ndarray,
    sigma: np.ndarray,
    min_observed: float,
    stride: int,
) -> tuple:
    """Motion a_from_b (4, 4) at which the surfaces of two views lie in each other, from `start` on.

    Point-to-plane distances both ways, cells paired by projection (Blais and Levine 1995). Steps go along
    observed directions alone, so that what nothing observes stays as it was (Zhang, Kaess and Singh 2016).
    With a `stride` of 1, all cells near each other are brought still nearer; with another one, every so many
    rows and columns, from all gates on, which is enough to say where a start leads.

    Returns:
        motion; number of cells that were paired, 0 where they were too few.
    """
    motion = start.copy()
    hessian, gradient, sums = np.zeros((6, 6)), np.zeros(6), np.zeros(7)
    by_sensor, step = np.zeros((0, K)), np.zeros(6)
    last = len(GATES_M) - 1
    first = last if stride == 1 else 0
    for k in range(first, last + _ROUNDS):
        hessian[:], gradient[:], sums[:] = 0.0, 0.0, 0.0
        gate = GATES_M[min(k, last)]
        out = hessian, gradient, sums, by_sensor
        _add(view_a, view_b, motion, gate, sigma, stride, False, *out)
        _add(view_b, view_a, motion, gate, sigma, stride, True, *out)
        if sums[0] < MIN_CELLS / stride**2:
            return motion, 0.0
        values, vectors, scaling = observed(hessian, sums, motion)
        squared = _step(values, vectors, scaling, gradient, min_observed * sums[1], step)
        _retract(motion, step)
        if k >= last and squared < (_STILL * stride) ** 2:
            break
    return motion, sums[0]


@kernel
def sums_at(view_a: tuple, view_b: tuple, motion: np.ndarray, sigma: np.ndarray) -> tuple:
    """Normal equations (6, 6) at a motion, sums as `_add` has them, at the last gate, and what motion and
    sensor share (6, K): J_motion^T J_sensor."""
    hessian, gradient, sums = np.zeros((6, 6)), np.zeros(6), np.zeros(7)
    by_sensor, gate = np.zeros((6, K)), GATES_M[-1]
    out = hessian, gradient, sums, by_sensor
    _add(view_a, view_b, motion, gate, sigma, 1, False, *out)
    _add(view_b, view_a, motion, gate, sigma, 1, True, *out)
    return hessian, sums, by_sensor


@kernel
def observed(hessian: np.ndarray, sums: np.ndarray, motion: np.ndarray) -> tuple:
    """Eigenvalues (6,), eigenvectors (6, 6) of normal equations about the middle of what was seen.

    Rotations there are about the middle and in metres at the lever, the root mean square distance from it,
    so that all six numbers compare. `scaling` (6, 6) takes such a tangent to (rotation, translation).
    """
    total = max(sums[1], 1e-12)
    spread = sums[5] / total
    arm = np.zeros(3)
    for r in range(3):
        middle = sums[2 + r] / total
        spread -= middle * middle
        arm[r] = motion[r, 3] - middle
    lever = np.sqrt(max(spread, 1e-4))
    scaling = np.zeros((6, 6))
    for r in range(3):
        scaling[r, r] = 1.0 / lever
        scaling[3 + r, 3 + r] = 1.0
    # The middle m moves by v_m = v + w x (m - t): v = v_m + w x (t - m) = v_m - [arm]x w, arm = t - m.
    scaling[3, 1], scaling[3, 2] = arm[2] / lever, -arm[1] / lever
    scaling[4, 0], scaling[4, 2] = -arm[2] / lever, arm[0] / lever
    scaling[5, 0], scaling[5, 1] = arm[1] / lever, -arm[0] / lever
    scaled = np.zeros((6, 6))  # scaling^T hessian scaling
    for r in range(6):
        for c in range(6):
            for u in range(6):
                for v in range(6):
                    scaled[r, c] += scaling[u, r] * hessian[u, v] * scaling[v, c]
    values, vectors = np.linalg.eigh(scaled)
    return values, vectors, scaling


@kernel
def _step(
    values: np.ndarray,
    vectors: np.ndarray,
    scaling: np.ndarray,
    gradient: np.ndarray,
    least: float,
    step: np.ndarray,
) -> float:
    """Put the tangent that lowers the cost most into `step`, along directions observed by more than `least`.

    Returns:
        squared length of the step, m, rotations by their lever.
    """
    squared = 0.0
    step[:] = 0.0
    for e in range(6):
        if values[e] <= least:
            continue
        along = 0.0
        for r in range(6):
            for c in range(6):
                along += vectors[c, e] * scaling[r, c] * gradient[r]
        along /= -values[e]
        squared += along * along
        for r in range(6):
            for c in range(6):
                step[r] += scaling[r, c] * vectors[c, e] * along
    return squared


@kernel
def _add(
    view_a: tuple,
    view_b: tuple,
    motion: np.ndarray,
    gate: float,
    sigma: np.ndarray,
    stride: int,
    is_back: bool,
    hessian: np.ndarray,
    gradient: np.ndarray,
    sums: np.ndarray,
    by_sensor: np.ndarray,
) -> None:
    """Add the distances of cells of the second view from surfaces of the first, in place.

    `motion` is first_from_second, or with `is_back` second_from_first: derivatives are by the tangent of
    `motion`. `sums`: cells, weights, weighted places (3) and squared distances from the origin, in the axes
    that `motion` leads to, and squared distances from the planes in sigmas. `by_sensor` (6, K) is left out
    where it is empty.
    """
    depth_a, normals_a, camera_a = view_a
    depth_b, normals_b, camera_b = view_b
    rows_a, columns_a = depth_a.shape
    rotation, shift = np.zeros((3, 3)), np.zeros(3)
    for r in range(3):
        for c in range(3):
            rotation[r, c] = motion[c, r] if is_back else motion[r, c]
    for r in range(3):
        if is_back:
            shift[r] = -(
                rotation[r, 0] * motion[0, 3]
                + rotation[r, 1] * motion[1, 3]
                + rotation[r, 2] * motion[2, 3]
            )
        else:
            shift[r] = motion[r, 3]
    x, n, p, j = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(6)
    at, own, of_sensor = np.zeros(3), np.zeros(3), np.zeros(K)
    for row in range(stride // 2, depth_b.shape[0], stride):
        for column in range(stride // 2, depth_b.shape[1], stride):
            z = depth_b[row, column]
            if not z > 0:
                continue
            own[0] = (column - camera_b[2]) / camera_b[0] * z
            own[1] = (row - camera_b[3]) / camera_b[1] * z
            own[2] = z
            for r in range(3):
                x[r] = (
                    rotation[r, 0] * own[0] + rotation[r, 1] * own[1] + rotation[r, 2] * own[2]
                ) + shift[r]
            if not x[2] > 0.2:
                continue
            u = int(np.floor(camera_a[0] * x[0] / x[2] + camera_a[2] + 0.5))
            v = int(np.floor(camera_a[1] * x[1] / x[2] + camera_a[3] + 0.5))
            if u < 0 or v < 0 or u >= columns_a or v >= rows_a:
                continue
            depth = depth_a[v, u]
            if not depth > 0:
                continue
            p[0] = (u - camera_a[2]) / camera_a[0] * depth
            p[1] = (v - camera_a[3]) / camera_a[1] * depth
            p[2] = depth
            distance, cosine, apart = 0.0, 0.0, 0.0
            for r in range(3):
                n[r] = normals_a[v, u, r] / 127.0
                turned = (
                    rotation[r, 0] * normals_b[row, column, 0]
                    + rotation[r, 1] * normals_b[row, column, 1]
                    + rotation[r, 2] * normals_b[row, column, 2]
                ) / 127.0
                cosine += n[r] * turned
                distance += n[r] * (x[r] - p[r])
                apart += (x[r] - p[r]) ** 2
            # Along the surface the nearest cell may be off by its own size.
            if cosine < _MAX_TURN_COSINE or apart > (2.0 * gate + 0.05 * depth) ** 2:
                continue
            if abs(distance) > gate:
                continue
            of_point = sigma[0] + sigma[1] * (z + depth) * 0.5
            scaled = distance / (LOSS_SIGMAS * of_point)
            weight = 1.0 / (of_point**2 * (1.0 + scaled**2))
            for r in range(3):
                # The normal, in the axes of the own point.
                at[r] = rotation[0, r] * n[0] + rotation[1, r] * n[1] + rotation[2, r] * n[2]
            if is_back:
                # first = motion^-1: m . (R^T (y - t) - p), y the own point; by (w, v) of motion.
                j[3], j[4], j[5] = -at[0], -at[1], -at[2]
                ax, ay, az = (
                    own[0] - motion[0, 3],
                    own[1] - motion[1, 3],
                    own[2] - motion[2, 3],
                )
                j[0] = -(ay * at[2] - az * at[1])
                j[1] = -(az * at[0] - ax * at[2])
                j[2] = -(ax * at[1] - ay * at[0])
                place = own
            else:
                ax, ay, az = x[0] - motion[0, 3], x[1] - motion[1, 3], x[2] - motion[2, 3]
                j[0] = ay * n[2] - az * n[1]
                j[1] = az * n[0] - ax * n[2]
                j[2] = ax * n[1] - ay * n[0]
                j[3], j[4], j[5] = n[0], n[1], n[2]
                place = x
            for r in range(6):
                gradient[r] += weight * j[r] * distance
                for c in range(6):
                    hessian[r, c] += weight * j[r] * j[c]
            if len(by_sensor):
                # Both ends move with the sensor: n . (R own + t - p).
                of_sensor[:] = 0.0
                _add_by_sensor(own, at, 1.0, of_sensor)
                _add_by_sensor(p, n, -1.0, of_sensor)
                for r in range(6):
                    for c in range(K):
                        by_sensor[r, c] += weight * j[r] * of_sensor[c]
            sums[0] += 1.0
            sums[1] += weight
            sums[6] += weight * distance**2
            for r in range(3):
                sums[2 + r] += weight * place[r]
                sums[5] += weight * place[r] ** 2


@kernel
def _add_by_sensor(point: np.ndarray, normal: np.ndarray, sign: float, row: np.ndarray) -> None:
    """Add how far the sensor's parameters move a point (its camera's axes) along a normal, in place.

    Depth scale p, offset p / z, quadratic z p; focal scale -(x, y, 0), aspect -(0, y, 0); principal point
    -(z, 0, 0) and -(0, z, 0): `planfit.geometry.calibration` near its nominal values.
    """
    x, y, z = point
    a, b, c = normal
    along = sign * (a * x + b * y + c * z)
    row[0] += along
    row[1] += along / z
    row[2] += along * z
    row[3] -= sign * (a * x + b * y)
    row[4] -= sign * b * y
    row[5] -= sign * a * z
    row[6] -= sign * b * z


@kernel
def _retract(motion: np.ndarray, tangent: np.ndarray) -> None:
    """Rotate by exp(tangent[:3]) from the left and add tangent[3:] to the translation, in place."""
    x, y, z = tangent[0], tangent[1], tangent[2]
    squared = x * x + y * y + z * z
    angle = np.sqrt(squared)
    a = 1.0 if angle < 1e-8 else np.sin(angle) / angle
    b = 0.5 if angle < 1e-4 else (1.0 - np.cos(angle)) / squared
    for c in range(3):
        # Rodrigues, column by column: q + a w x q + b w x (w x q).
        p, q, r = motion[0, c], motion[1, c], motion[2, c]
        u, v, w = y * r - z * q, z * p - x * r, x * q - y * p
        motion[0, c] += a * u + b * (y * w - z * v)
        motion[1, c] += a * v + b * (z * u - x * w)
        motion[2, c] += a * w + b * (x * v - y * u)
        motion[c, 3] += tangent[3 + c]


@kernel
def compare_surfaces(
    view_a: tuple, view_b: tuple, a_from_b: np.ndarray, base_m: float, per_m: float
) -> np.ndarray:
    """Cells of the second view, at a motion: agreeing with the first, looked past by it, all, and those that
    lie where the first shows anything (4,)."""
    depth_a, normals_a, camera_a = view_a
    depth_b, normals_b, camera_b = view_b
    rows_a, columns_a = depth_a.shape
    counts = np.zeros(4)
    for row in range(depth_b.shape[0]):
        for column in range(depth_b.shape[1]):
            z = depth_b[row, column]
            if not z > 0:
                continue
            counts[2] += 1
            bx = (column - camera_b[2]) / camera_b[0] * z
            by = (row - camera_b[3]) / camera_b[1] * z
            x = a_from_b[0, 0] * bx + a_from_b[0, 1] * by + a_from_b[0, 2] * z + a_from_b[0, 3]
            y = a_from_b[1, 0] * bx + a_from_b[1, 1] * by + a_from_b[1, 2] * z + a_from_b[1, 3]
            there = a_from_b[2, 0] * bx + a_from_b[2, 1] * by + a_from_b[2, 2] * z + a_from_b[2, 3]
            if not there > 0.2:
                continue
            u = int(np.floor(camera_a[0] * x / there + camera_a[2] + 0.5))
            v = int(np.floor(camera_a[1] * y / there + camera_a[3] + 0.5))
            if u < 0 or v < 0 or u >= columns_a or v >= rows_a or not depth_a[v, u] > 0:
                continue
            counts[3] += 1
            # The plane of the first view's cell, distance of the point from it.
            z_a = depth_a[v, u]
            n0, n1, n2 = (
                normals_a[v, u, 0] / 127.0,
                normals_a[v, u, 1] / 127.0,
                normals_a[v, u, 2] / 127.0,
            )
            distance = (
                n0 * (x - (u - camera_a[2]) / camera_a[0] * z_a)
                + n1 * (y - (v - camera_a[3]) / camera_a[1] * z_a)
                + n2 * (there - z_a)
            )
            turned = 0.0
            for r in range(3):
                m = (
                    a_from_b[r, 0] * normals_b[row, column, 0]
                    + a_from_b[r, 1] * normals_b[row, column, 1]
                    + a_from_b[r, 2] * normals_b[row, column, 2]
                )
                turned += m / 127.0 * (n0 if r == 0 else n1 if r == 1 else n2)
            allowed = base_m + per_m * max(z, there)
            if abs(distance) < allowed:
                if turned > _MAX_TURN_COSINE:
                    counts[0] += 1
                continue
            # Past a surface: nearer than all that the first view shows about there.
            nearest = z_a
            for r in range(max(v - 1, 0), min(v + 2, rows_a)):
                for c in range(max(u - 1, 0), min(u + 2, columns_a)):
                    if depth_a[r, c] > 0:
                        nearest = min(nearest, depth_a[r, c])
            if there < nearest - allowed:
                counts[1] += 1
    return counts
