"""Compiled passes over points: derivatives of robust terms by the sensor's parameters.

With corrected points p = (x, y, z) of measured depth d, where z = s d + o + q d^2, the parameters of
`planfit.geometry.calibration` move a point by

    depth scale p d / z, offset p / z, quadratic p d^2 / z; focal scale -(x, y, 0), aspect -(0, y, 0);
    principal point -(z, 0, 0) and -(0, z, 0),

exact in depth, and all but exact where focal lengths are corrected by little. With z for d, steps of q
overshot twofold where depth reaches 20 m, and did not settle. Sigmas grow with the points: stretching rays
by a factor stretches their noise, else shrinking a scan would always pay (on ConSLAM, 1 % less costs less and
errs by 0.145 m instead of 0.09). So residuals count as shares of the stretch: their own derivative by its
logarithm is taken off. Depth errs along the ray, where scale, offset and quadratic stretch by
(1, 0, 2 d) / (s + 2 q d), and images across it, where they stretch by (d, 1, d^2) / z: with the latter both
ways, an offset of 2 cm and -0.003 z^2 were found of faultless scans. Robust weights are given: the losses'
own kernels are in another file, which numba's cache would not watch. `pragma: no cover`: compiled code is
invisible to coverage.
"""

import numpy as np

from planfit.compiled import kernel

K = 7
"""Parameters."""


@kernel(fastmath=True)
def _measured_depth(z, depth):  # pragma: no cover
    """The depth d that (s, o, q) correct to z = s d + o + q d^2; the nearest to it where none is."""
    beyond = z - depth[1]
    root = np.sqrt(max(depth[0] * depth[0] + 4.0 * depth[2] * beyond, 0.0))
    return 2.0 * beyond / (depth[0] + root)


@kernel(fastmath=True)
def sum_planes_by_sensor(
    points, start, planes, weight, depth, is_stretched, by_pose, by_self, by_res
):  # pragma: no cover
    """Sums of groups of points about their planes (normal, -offset; camera frame).

    `depth` has s, o and q, by which points are corrected. Adds to by_pose (k, 6, K): J_x^T J_s by the
    camera-frame tangent (rotation p x n, translation n);
    by_self (K, K): J_s^T J_s; by_res (K,): J_s^T r. Weights are per point, sigma in them.
    """
    j, lever = np.zeros(K), np.zeros(6)
    for k in range(len(start) - 1):
        a, b, c, offset = planes[k]
        lever[3], lever[4], lever[5] = a, b, c
        for m in range(start[k], start[k + 1]):
            w = weight[m]
            x, y, z = points[m, 0], points[m, 1], points[m, 2]
            if w == 0.0 or z <= 0.0:  # no depth image has a point behind the camera
                continue
            along = a * x + b * y + c * z
            r = along + offset
            sideways = a * x + b * y
            d = _measured_depth(z, depth)
            j[0], j[1], j[2] = along * d / z, along / z, along * d * d / z
            if is_stretched:
                # Dense points err along their rays alone.
                grown = r / (depth[0] + 2.0 * depth[2] * d)
                j[0] -= grown
                j[2] -= 2.0 * d * grown
                sideways -= r * (a * a + b * b)
            j[3] = -sideways
            j[4], j[5], j[6] = -b * y, -a * z, -b * z
            lever[0], lever[1], lever[2] = y * c - z * b, z * a - x * c, x * b - y * a
            for u in range(K):
                wj = w * j[u]
                by_res[u] += wj * r
                for v in range(K):
                    by_self[u, v] += wj * j[v]
                for i in range(6):
                    by_pose[k, i, u] += wj * lever[i]


@kernel(fastmath=True)
def _directions(p, d, by):  # pragma: no cover
    """How each parameter moves a point of measured depth d: columns of `by` (3, K)."""
    x, y, z = p
    u, v = x / z, y / z
    by[:, :] = 0.0
    by[0, 0], by[1, 0], by[2, 0] = u * d, v * d, d
    by[0, 1], by[1, 1], by[2, 1] = u, v, 1.0
    by[0, 2], by[1, 2], by[2, 2] = u * d * d, v * d * d, d * d
    by[0, 3], by[1, 3] = -x, -y
    by[1, 4] = -y
    by[0, 5] = -z
    by[1, 6] = -z


@kernel(fastmath=True)
def sum_pairs_by_sensor(
    points_a, points_b, start, a_from_b, weight, depth, by_relative, by_self, by_res
):  # pragma: no cover
    """Sums of the matches of pairs: residual p - (R q + t), first camera's axes.

    Adds to by_relative (k, 6, K): J_x^T J_s by the tangent (rotation, translation) of first_from_second,
    first's axes; by_self (K, K) and by_res (K,) as above.
    """
    of_a, of_b, j, e = np.zeros((3, K)), np.zeros((3, K)), np.zeros((3, K)), np.zeros(3)
    ray = np.zeros(3)
    for k in range(len(start) - 1):
        t = a_from_b[k]
        for m in range(start[k], start[k + 1]):
            w = weight[m]
            p, q = points_a[m], points_b[m]
            if w == 0.0 or p[2] <= 0.0 or q[2] <= 0.0:
                continue
            ux = t[0, 0] * q[0] + t[0, 1] * q[1] + t[0, 2] * q[2]
            uy = t[1, 0] * q[0] + t[1, 1] * q[1] + t[1, 2] * q[2]
            uz = t[2, 0] * q[0] + t[2, 1] * q[1] + t[2, 2] * q[2]
            e[0], e[1], e[2] = p[0] - ux - t[0, 3], p[1] - uy - t[1, 3], p[2] - uz - t[2, 3]
            d_p, d_q = _measured_depth(p[2], depth), _measured_depth(q[2], depth)
            _directions(p, d_p, of_a)
            _directions(q, d_q, of_b)
            for u in range(K):
                for i in range(3):
                    moved = t[i, 0] * of_b[0, u] + t[i, 1] * of_b[1, u] + t[i, 2] * of_b[2, u]
                    j[i, u] = of_a[i, u] - moved
            # The stretch of the residual's own sigma is that of both points, along either ray.
            d = 0.5 * (d_p + d_q)
            z = depth[0] * d + depth[1] + depth[2] * d * d
            along = 1.0 / (depth[0] + 2.0 * depth[2] * d)
            uu = ux * ux + uy * uy + uz * uz
            by_p = (
                0.5
                * (p[0] * e[0] + p[1] * e[1] + p[2] * e[2])
                / (p[0] * p[0] + p[1] * p[1] + p[2] * p[2])
            )
            by_u = 0.5 * (ux * e[0] + uy * e[1] + uz * e[2]) / uu
            ray[0] = by_p * p[0] + by_u * ux
            ray[1] = by_p * p[1] + by_u * uy
            ray[2] = by_p * p[2] + by_u * uz
            for i in range(3):
                across = (e[i] - ray[i]) / z
                j[i, 0] -= across * d + ray[i] * along
                j[i, 1] -= across
                j[i, 2] -= across * d * d + ray[i] * along * 2.0 * d
            j[0, 3] += e[0]
            j[1, 3] += e[1]
            for u in range(K):
                jx, jy, jz = w * j[0, u], w * j[1, u], w * j[2, u]
                by_res[u] += jx * e[0] + jy * e[1] + jz * e[2]
                for v in range(K):
                    by_self[u, v] += jx * j[0, v] + jy * j[1, v] + jz * j[2, v]
                # d residual = -(rotation x R q) - translation.
                by_relative[k, 0, u] += jy * uz - jz * uy
                by_relative[k, 1, u] += jz * ux - jx * uz
                by_relative[k, 2, u] += jx * uy - jy * ux
                by_relative[k, 3, u] -= jx
                by_relative[k, 4, u] -= jy
                by_relative[k, 5, u] -= jz
