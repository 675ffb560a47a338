"""Compiled passes over points: derivatives of robust terms by the sensor's parameters.

With corrected points p = (x, y, z), the parameters of `planfit.geometry.calibration` move a point by

    depth scale p, offset p / z, quadratic z p; focal scale -(x, y, 0), aspect -(0, y, 0);
    principal point -(z, 0, 0) and -(0, z, 0),

all but exact where the correction so far is small. Sigmas grow with the points: stretching the rays by a
factor stretches their noise, else shrinking a scan would always pay (on ConSLAM, 1 % less costs less and
errs by 0.145 m instead of 0.09). So residuals count as shares of the stretch: their own derivative by its
logarithm is taken off. `weigh` is planfit.lsq.kernels's; these passes are not cached, as numba watches only
the file that a function is in.
"""

import numba
import numpy as np

from planfit.lsq.kernels import BLOCK, weigh

K = 7
"""Parameters."""


@numba.njit(nogil=True, fastmath=True)
def sum_planes_by_sensor(
    points, start, planes, weight_per_point, sigma, kind, scale, stretches, by_pose, by_self, by_res
):  # pragma: no cover
    """Sums of groups about their planes (normal, -offset; camera frame).

    Adds to by_pose (k, 6, K): J_x^T J_s by the camera-frame tangent (rotation p x n, translation n);
    by_self (K, K): J_s^T J_s; by_res (K,): J_s^T r.
    """
    s, weight = np.zeros(BLOCK), np.zeros(BLOCK)
    inverse = 1.0 / (sigma * sigma)
    j, turn = np.zeros(K), np.zeros(3)
    for k in range(len(start) - 1):
        if weight_per_point[k] == 0.0:
            continue
        a, b, c, d = planes[k]
        for begin in range(start[k], start[k + 1], BLOCK):
            n = min(BLOCK, start[k + 1] - begin)
            for m in range(n):
                p = points[begin + m]
                r = a * p[0] + b * p[1] + c * p[2] + d
                s[m] = r * r * inverse
            weigh(s, n, kind, scale, weight)
            for m in range(n):
                x, y, z = points[begin + m, 0], points[begin + m, 1], points[begin + m, 2]
                r = a * x + b * y + c * z + d
                w = weight[m] * weight_per_point[k] * inverse
                along = a * x + b * y + c * z
                if stretches:
                    along -= r
                    lateral = r * (a * a + b * b)
                else:
                    lateral = 0.0
                j[0], j[1], j[2] = along, along / z, along * z
                j[3] = -(a * x + b * y) + lateral
                j[4] = -b * y
                j[5], j[6] = -a * z, -b * z
                turn[0], turn[1], turn[2] = y * c - z * b, z * a - x * c, x * b - y * a
                for u in range(K):
                    wj = w * j[u]
                    by_res[u] += wj * r
                    for v in range(K):
                        by_self[u, v] += wj * j[v]
                    by_pose[k, 0, u] += wj * turn[0]
                    by_pose[k, 1, u] += wj * turn[1]
                    by_pose[k, 2, u] += wj * turn[2]
                    by_pose[k, 3, u] += wj * a
                    by_pose[k, 4, u] += wj * b
                    by_pose[k, 5, u] += wj * c


@numba.njit(nogil=True, fastmath=True)
def _directions(p, by):  # pragma: no cover
    """How each parameter moves a point: columns of `by` (3, K)."""
    x, y, z = p
    by[:, :] = 0.0
    by[0, 0], by[1, 0], by[2, 0] = x, y, z
    by[0, 1], by[1, 1], by[2, 1] = x / z, y / z, 1.0
    by[0, 2], by[1, 2], by[2, 2] = x * z, y * z, z * z
    by[0, 3], by[1, 3] = -x, -y
    by[1, 4] = -y
    by[0, 5] = -z
    by[1, 6] = -z


@numba.njit(nogil=True, fastmath=True)
def sum_pairs_by_sensor(
    points_a, points_b, sigma, start, a_from_b, weight_per_point, kind, scale,
    by_relative, by_self, by_res,
):  # fmt: skip  # pragma: no cover
    """Sums of the matches of pairs: residual p - (R q + t), first camera's axes.

    Adds to by_relative (k, 6, K): J_x^T J_s by the tangent (rotation, translation) of first_from_second,
    first's axes; by_self (K, K) and by_res (K,) as above.
    """
    s, weight = np.zeros(1), np.zeros(1)
    of_a, of_b, j = np.zeros((3, K)), np.zeros((3, K)), np.zeros((3, K))
    for k in range(len(start) - 1):
        if weight_per_point[k] == 0.0:
            continue
        t = a_from_b[k]
        for m in range(start[k], start[k + 1]):
            p, q = points_a[m], points_b[m]
            ux = t[0, 0] * q[0] + t[0, 1] * q[1] + t[0, 2] * q[2]
            uy = t[1, 0] * q[0] + t[1, 1] * q[1] + t[1, 2] * q[2]
            uz = t[2, 0] * q[0] + t[2, 1] * q[1] + t[2, 2] * q[2]
            ex, ey, ez = p[0] - ux - t[0, 3], p[1] - uy - t[1, 3], p[2] - uz - t[2, 3]
            inverse = 1.0 / (sigma[m] * sigma[m])
            s[0] = (ex * ex + ey * ey + ez * ez) * inverse
            weigh(s, 1, kind, scale, weight)
            w = weight[0] * weight_per_point[k] * inverse
            _directions(p, of_a)
            _directions(q, of_b)
            # The stretch of the residual's own sigma: that of the two points' mean depth.
            z = 0.5 * (p[2] + q[2])
            for u in range(K):
                for i in range(3):
                    moved = t[i, 0] * of_b[0, u] + t[i, 1] * of_b[1, u] + t[i, 2] * of_b[2, u]
                    j[i, u] = of_a[i, u] - moved
            for i in range(3):
                e = ex if i == 0 else (ey if i == 1 else ez)
                j[i, 0] -= e
                j[i, 1] -= e / z
                j[i, 2] -= e * z
            j[0, 3] += ex
            j[1, 3] += ey
            for u in range(K):
                jx, jy, jz = w * j[0, u], w * j[1, u], w * j[2, u]
                by_res[u] += jx * ex + jy * ey + jz * ez
                for v in range(K):
                    by_self[u, v] += jx * j[0, v] + jy * j[1, v] + jz * j[2, v]
                # d residual = -(rotation x R q) - translation.
                by_relative[k, 0, u] += jy * uz - jz * uy
                by_relative[k, 1, u] += jz * ux - jx * uz
                by_relative[k, 2, u] += jx * uy - jy * ux
                by_relative[k, 3, u] -= jx
                by_relative[k, 4, u] -= jy
                by_relative[k, 5, u] -= jz
