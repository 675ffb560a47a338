"""Compiled assembly of normal blocks from moments: what a step costs once points are collapsed."""

import numpy as np

from planfit.compiled import kernel


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
