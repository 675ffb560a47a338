"""Compiled passes over points: robust weights, and the weighted sums that `moments` is made of.

All in one file, because numba's cache watches only the file that a function is in: a kernel that
called a loss in another file would go on with the old one after an edit.

Each group of points goes through in blocks: squared residuals, then weights, then sums, three plain
loops that the compiler turns into vector instructions. Points may be float32 or float64; sums are
float64. `pragma: no cover`: compiled code is invisible to coverage; the tests hold it against twins.
"""

import numpy as np

from planfit.compiled import kernel

BLOCK = 256
SQUARED, HUBER, CAUCHY, GEMAN_MCCLURE, NORM = range(5)


@kernel(fastmath=True)
def weigh(s, n, kind, scale, weight):  # pragma: no cover
    """Weights of n squared residuals, written to `weight`; returns the sum of their costs."""
    c2 = scale * scale
    cost = 0.0
    if kind == SQUARED:
        for i in range(n):
            weight[i] = 1.0
            cost += s[i]
    elif kind == HUBER:
        for i in range(n):
            root = np.sqrt(max(s[i], c2))
            weight[i] = scale / root
            cost += min(s[i], 2.0 * scale * root - c2)
    elif kind == CAUCHY:
        # The sum of logarithms is the logarithm of the product: one log for eight residuals. Eight
        # factors of up to 1e38 do not overflow.
        product, held = 1.0, 0
        for i in range(n):
            grown = 1.0 + s[i] / c2
            weight[i] = 1.0 / grown
            product *= min(grown, 1e38)
            held += 1
            if held == 8:
                cost += np.log(product)
                product, held = 1.0, 0
        cost = c2 * (cost + np.log(product))
    elif kind == NORM:
        for i in range(n):
            root = np.sqrt(s[i] + c2)
            weight[i] = 1.0 / root
            cost += 2.0 * (root - scale)
    else:
        for i in range(n):
            share = c2 / (c2 + s[i])
            weight[i] = share * share
            cost += s[i] * share
    return cost


@kernel
def weigh_all(s, kind, scale):  # pragma: no cover
    """Costs and weights of squared residuals, one by one."""
    rho, weight, one = np.zeros_like(s), np.zeros_like(s), np.zeros(1)
    for i in range(len(s)):
        one[0] = s[i]
        rho[i] = weigh(one, 1, kind, scale, weight[i:])
    return rho, weight


@kernel(fastmath=True)
def sum_planes(
    points, start, planes, weight_per_point, sigma, kind, scale, first, last, moments
):  # pragma: no cover
    """Moments of groups first..last - 1 about their planes (camera frame); returns the cost."""
    s, weight = np.zeros(BLOCK), np.zeros(BLOCK)
    inverse = 1.0 / (sigma * sigma)
    cost = 0.0
    for k in range(first, last):
        if weight_per_point[k] == 0.0:
            continue
        a, b, c, d = planes[k]
        xx = xy = xz = yy = yz = zz = sx = sy = sz = total = group_cost = 0.0
        for begin in range(start[k], start[k + 1], BLOCK):
            n = min(BLOCK, start[k + 1] - begin)
            for m in range(n):
                distance = (
                    a * points[begin + m, 0]
                    + b * points[begin + m, 1]
                    + c * points[begin + m, 2]
                    + d
                )
                s[m] = distance * distance * inverse
            group_cost += weigh(s, n, kind, scale, weight)
            for m in range(n):
                x, y, z = points[begin + m, 0], points[begin + m, 1], points[begin + m, 2]
                w = weight[m]
                wx, wy, wz = w * x, w * y, w * z
                xx += wx * x
                xy += wx * y
                xz += wx * z
                yy += wy * y
                yz += wy * z
                zz += wz * z
                sx += wx
                sy += wy
                sz += wz
                total += w
        cost += 0.5 * weight_per_point[k] * group_cost
        f = weight_per_point[k] * inverse
        out = moments[k]
        out[0, 0], out[1, 1], out[2, 2], out[3, 3] = f * xx, f * yy, f * zz, f * total
        out[0, 1] = out[1, 0] = f * xy
        out[0, 2] = out[2, 0] = f * xz
        out[1, 2] = out[2, 1] = f * yz
        out[0, 3] = out[3, 0] = f * sx
        out[1, 3] = out[3, 1] = f * sy
        out[2, 3] = out[3, 2] = f * sz
    return cost


@kernel(fastmath=True)
def sum_pairs(
    points_a,
    points_b,
    sigma,
    start,
    a_from_b,
    weight_per_point,
    kind,
    scale,
    first,
    last,
    aa,
    ab,
    bb,
):  # pragma: no cover
    """Moments of the matches of pairs first..last - 1; returns the cost.

    A block is first copied into rows of x, y and z, so that the sums run over neighbours in memory
    (measured: half the time).
    """
    s, weight, inverse = np.zeros(BLOCK), np.zeros(BLOCK), np.zeros(BLOCK)
    p, q = np.zeros((3, BLOCK)), np.zeros((3, BLOCK))
    cost = 0.0
    for k in range(first, last):
        if weight_per_point[k] == 0.0:
            continue
        t = a_from_b[k]
        group_cost = 0.0
        for begin in range(start[k], start[k + 1], BLOCK):
            n = min(BLOCK, start[k + 1] - begin)
            for m in range(n):
                p[0, m], p[1, m], p[2, m] = (
                    points_a[begin + m, 0],
                    points_a[begin + m, 1],
                    points_a[begin + m, 2],
                )
                q[0, m], q[1, m], q[2, m] = (
                    points_b[begin + m, 0],
                    points_b[begin + m, 1],
                    points_b[begin + m, 2],
                )
            for m in range(n):
                ex = p[0, m] - (t[0, 0] * q[0, m] + t[0, 1] * q[1, m] + t[0, 2] * q[2, m] + t[0, 3])
                ey = p[1, m] - (t[1, 0] * q[0, m] + t[1, 1] * q[1, m] + t[1, 2] * q[2, m] + t[1, 3])
                ez = p[2, m] - (t[2, 0] * q[0, m] + t[2, 1] * q[1, m] + t[2, 2] * q[2, m] + t[2, 3])
                inverse[m] = 1.0 / (sigma[begin + m] * sigma[begin + m])
                s[m] = (ex * ex + ey * ey + ez * ez) * inverse[m]
            group_cost += weigh(s, n, kind, scale, weight)
            for m in range(n):
                weight[m] *= weight_per_point[k] * inverse[m]
            _add_own_moments(p, weight, n, aa[k])
            _add_own_moments(q, weight, n, bb[k])
            _add_cross_moments(p, q, weight, n, aa[k], bb[k], ab[k])
        cost += 0.5 * weight_per_point[k] * group_cost
    return cost


@kernel(fastmath=True)
def _add_own_moments(p, weight, n, out):  # pragma: no cover
    """Add the sum of w p~ p~^T over n points (3, n) to `out` (4, 4)."""
    xx = xy = xz = yy = yz = zz = sx = sy = sz = total = 0.0
    for m in range(n):
        w, x, y, z = weight[m], p[0, m], p[1, m], p[2, m]
        wx, wy, wz = w * x, w * y, w * z
        xx += wx * x
        xy += wx * y
        xz += wx * z
        yy += wy * y
        yz += wy * z
        zz += wz * z
        sx += wx
        sy += wy
        sz += wz
        total += w
    out[0, 0] += xx
    out[1, 1] += yy
    out[2, 2] += zz
    out[3, 3] += total
    out[0, 1] += xy
    out[1, 0] += xy
    out[0, 2] += xz
    out[2, 0] += xz
    out[1, 2] += yz
    out[2, 1] += yz
    out[0, 3] += sx
    out[3, 0] += sx
    out[1, 3] += sy
    out[3, 1] += sy
    out[2, 3] += sz
    out[3, 2] += sz


@kernel(fastmath=True)
def _add_cross_moments(p, q, weight, n, aa, bb, out):  # pragma: no cover
    """Add the sum of w p~ q~^T over n points to `out` (4, 4), whose border is that of `aa` and `bb`."""
    xx = xy = xz = yx = yy = yz = zx = zy = zz = 0.0
    for m in range(n):
        w = weight[m]
        ax, ay, az = w * p[0, m], w * p[1, m], w * p[2, m]
        bx, by, bz = q[0, m], q[1, m], q[2, m]
        xx += ax * bx
        xy += ax * by
        xz += ax * bz
        yx += ay * bx
        yy += ay * by
        yz += ay * bz
        zx += az * bx
        zy += az * by
        zz += az * bz
    out[0, 0] += xx
    out[0, 1] += xy
    out[0, 2] += xz
    out[1, 0] += yx
    out[1, 1] += yy
    out[1, 2] += yz
    out[2, 0] += zx
    out[2, 1] += zy
    out[2, 2] += zz
    for i in range(4):
        out[i, 3] = aa[i, 3]
        out[3, i] = bb[3, i]
