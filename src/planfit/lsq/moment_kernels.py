"""Compiled loops of moments: sums over points, robustly weighted, and the normal blocks made of them.

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
_NOTHING = (0.0,) * 10
"""Sums of `_sums` over no points."""


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
    """Add the moments of groups first..last - 1 about their planes (camera frame); returns the cost."""
    xyz, s, weight = points.T, np.zeros(BLOCK), np.zeros(BLOCK)
    inverse = 1.0 / (sigma * sigma)
    cost = 0.0
    for k in range(first, last):
        if weight_per_point[k] == 0.0:
            continue
        a, b, c, d = planes[k]
        sums, group_cost = _NOTHING, 0.0
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
            sums = _sums(xyz, begin, weight, n, sums)
        cost += 0.5 * weight_per_point[k] * group_cost
        _add_symmetric(sums, weight_per_point[k] * inverse, moments[k])
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
    """Add the moments of the matches of pairs first..last - 1; returns the cost.

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
                for i in range(3):
                    p[i, m], q[i, m] = points_a[begin + m, i], points_b[begin + m, i]
            for m in range(n):
                ex = p[0, m] - (t[0, 0] * q[0, m] + t[0, 1] * q[1, m] + t[0, 2] * q[2, m] + t[0, 3])
                ey = p[1, m] - (t[1, 0] * q[0, m] + t[1, 1] * q[1, m] + t[1, 2] * q[2, m] + t[1, 3])
                ez = p[2, m] - (t[2, 0] * q[0, m] + t[2, 1] * q[1, m] + t[2, 2] * q[2, m] + t[2, 3])
                inverse[m] = 1.0 / (sigma[begin + m] * sigma[begin + m])
                s[m] = (ex * ex + ey * ey + ez * ez) * inverse[m]
            group_cost += weigh(s, n, kind, scale, weight)
            for m in range(n):
                weight[m] *= weight_per_point[k] * inverse[m]
            _add_symmetric(_sums(p, 0, weight, n, _NOTHING), 1.0, aa[k])
            _add_symmetric(_sums(q, 0, weight, n, _NOTHING), 1.0, bb[k])
            _add_cross_moments(p, q, weight, n, aa[k], bb[k], ab[k])
        cost += 0.5 * weight_per_point[k] * group_cost
    return cost


@kernel(fastmath=True)
def _sums(xyz, begin, weight, n, sums):  # pragma: no cover
    """`sums` and those of n points from `begin` on: the upper triangle of w p~ p~^T, row after row.

    Args:
        xyz: (3, m).
        begin: the first of the points.
        weight: of each of them, from 0 on.
        n: how many.
        sums: ten numbers, taken up and given back one by one, so that they stay in registers.
    """
    xx, xy, xz, sx, yy, yz, sy, zz, sz, total = sums
    for m in range(n):
        x, y, z = xyz[0, begin + m], xyz[1, begin + m], xyz[2, begin + m]
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
    return xx, xy, xz, sx, yy, yz, sy, zz, sz, total


@kernel(fastmath=True)
def _add_symmetric(sums, factor, out):  # pragma: no cover
    """Add the symmetric (4, 4) matrix with the upper triangle `sums`, times a factor, to `out`."""
    k = 0
    for i in range(4):
        for j in range(i, 4):
            out[i, j] += factor * sums[k]
            out[j, i] = out[i, j]
            k += 1


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
    sums = (xx, xy, xz, yx, yy, yz, zx, zy, zz)
    for i in range(3):
        for j in range(3):
            out[i, j] += sums[3 * i + j]
    for i in range(4):
        out[i, 3] = aa[i, 3]
        out[3, i] = bb[3, i]


@kernel
def add_pair_blocks(
    pairs, aa, ab, bb, target_from_cams, diagonal, gradient, rows, columns, off_diagonal
):  # pragma: no cover
    """Gauss-Newton blocks of r = u + s - v of each pair (i, j): u = R_i p, v = R_j q, s = t_i - t_j.

    With J(u) = [-[u]x, I], blocks of i are the sums of J(u)^T J(u), of j of J(v)^T J(v), between them those
    of -J(u)^T J(v). Blocks and gradients of single poses are added to `diagonal` and `gradient`, the others
    written as blocks of (row, column) with row <= column.
    """
    uu, uv, vv = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    block = np.zeros((6, 6))
    sum_u, sum_v, s = np.zeros(3), np.zeros(3), np.zeros(3)
    for k in range(len(pairs)):
        i, j = pairs[k, 0], pairs[k, 1]
        one, other = target_from_cams[i], target_from_cams[j]
        weight = aa[k, 3, 3]
        _turn(one, aa[k], one, uu)
        _turn(one, ab[k], other, uv)
        _turn(other, bb[k], other, vv)
        for a in range(3):
            sum_u[a], sum_v[a] = 0.0, 0.0
            for b in range(3):
                sum_u[a] += one[a, b] * aa[k, b, 3]
                sum_v[a] += other[a, b] * bb[k, b, 3]
            s[a] = one[a, 3] - other[a, 3]
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            cross_uv = uv[b, c] - uv[c, b]  # sum of w u x v
            gradient[i, a] += sum_u[b] * s[c] - sum_u[c] * s[b] - cross_uv
            gradient[j, a] += cross_uv - sum_v[b] * s[c] + sum_v[c] * s[b]
            residual = sum_u[a] - sum_v[a] + weight * s[a]
            gradient[i, 3 + a] += residual
            gradient[j, 3 + a] -= residual
        _levers(uu, sum_u, sum_u, weight, block)
        _add(block, diagonal[i])
        _levers(vv, sum_v, sum_v, weight, block)
        _add(block, diagonal[j])
        _levers(uv, sum_u, sum_v, weight, block)
        rows[k], columns[k] = min(i, j), max(i, j)
        out = off_diagonal[k]
        for a in range(6):
            for b in range(6):
                out[a, b] = -block[a, b] if i <= j else -block[b, a]
        if i == j:  # on the diagonal nothing stands for its transpose
            for a in range(6):
                for b in range(6):
                    out[a, b] -= block[b, a]


@kernel
def add_plane_blocks(
    pose_idx, planes, moments, target_from_cams, diagonal, gradient
):  # pragma: no cover
    """Gauss-Newton blocks of distances to planes (n, -d), added to those of each pose.

    With p~ the point, distance = pi^T T p~ and J = A p~: rotation (u x n), A = -[n]x R; translation n.
    """
    plane_cam = np.zeros(4)
    jacobian, half = np.zeros((6, 4)), np.zeros((6, 4))
    for k in range(len(pose_idx)):
        pose, plane, m = target_from_cams[pose_idx[k]], planes[k], moments[k]
        for b in range(4):
            plane_cam[b] = 0.0
            for a in range(4):
                plane_cam[b] += pose[a, b] * plane[a]
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            for d in range(3):  # row a of -[n]x: n_c at b, -n_b at c
                jacobian[a, d] = plane[c] * pose[b, d] - plane[b] * pose[c, d]
            jacobian[3 + a, 3] = plane[a]
        out = diagonal[pose_idx[k]]
        for a in range(6):
            for b in range(4):
                half[a, b] = 0.0
                for c in range(4):
                    half[a, b] += jacobian[a, c] * m[c, b]
            for b in range(4):
                gradient[pose_idx[k], a] += half[a, b] * plane_cam[b]
            for d in range(6):
                for b in range(4):
                    out[a, d] += half[a, b] * jacobian[d, b]


@kernel
def _turn(one, moments, other, out):  # pragma: no cover
    """R_one M R_other^T of the upper left 3x3 of each."""
    for a in range(3):
        x = one[a, 0] * moments[0, 0] + one[a, 1] * moments[1, 0] + one[a, 2] * moments[2, 0]
        y = one[a, 0] * moments[0, 1] + one[a, 1] * moments[1, 1] + one[a, 2] * moments[2, 1]
        z = one[a, 0] * moments[0, 2] + one[a, 1] * moments[1, 2] + one[a, 2] * moments[2, 2]
        for b in range(3):
            out[a, b] = x * other[b, 0] + y * other[b, 1] + z * other[b, 2]


@kernel
def _levers(outer, sum_u, sum_v, weight, out):  # pragma: no cover
    """Sum of J(u)^T J(v) from the sums of u v^T, u, v and 1: -[u]x [v]x = (u . v) I - v u^T."""
    trace = outer[0, 0] + outer[1, 1] + outer[2, 2]
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        for d in range(3):
            out[a, d] = -outer[d, a]
            out[3 + a, 3 + d] = 0.0
        out[a, a] += trace
        out[3 + a, 3 + a] = weight
        # [u]x: entry (a, b) is -u_c, (a, c) is u_b.
        out[a, 3 + a], out[3 + a, a] = 0.0, 0.0
        out[a, 3 + b], out[a, 3 + c] = -sum_u[c], sum_u[b]
        out[3 + a, b], out[3 + a, c] = sum_v[c], -sum_v[b]


@kernel
def _add(block, out):  # pragma: no cover
    for a in range(6):
        for b in range(6):
            out[a, b] += block[a, b]
