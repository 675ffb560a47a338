"""Compiled sums over wall points that are held to points or lines of the plan.

`pragma: no cover`: compiled code is invisible to coverage; the tests hold it against twins.
"""

import numpy as np

from planfit.compiled import kernel


@kernel
def squared_distances(face_idx, gaps, normals, to_line, reach):  # pragma: no cover
    """Squared distances (m,) to faces or their lines; where there is no face, that of `reach`."""
    squared = np.full(len(face_idx), reach * reach)
    for m in range(len(face_idx)):
        f = face_idx[m]
        if f >= 0 and to_line:
            squared[m] = (gaps[m, 0] * normals[f, 0] + gaps[m, 1] * normals[f, 1]) ** 2
        elif f >= 0:
            squared[m] = gaps[m, 0] ** 2 + gaps[m, 1] ** 2
    return squared


@kernel
def correspondence_weights(
    face_idx, normals, to_line, start, information, weight
):  # pragma: no cover
    """Weights (m, 3), xx, xy and yy, of points of patches worth information (k,) times weight (m,) each.

    That of a point on the line of a face with normal n is n n^T, at the nearest point the identity.
    """
    information_of = np.zeros((len(face_idx), 3))
    for k in range(len(start) - 1):
        for m in range(start[k], start[k + 1]):
            f, w = face_idx[m], information[k] * weight[m]
            if f < 0:
                continue
            if to_line:
                information_of[m, 0] = w * normals[f, 0] * normals[f, 0]
                information_of[m, 1] = w * normals[f, 0] * normals[f, 1]
                information_of[m, 2] = w * normals[f, 1] * normals[f, 1]
            else:
                information_of[m, 0] = information_of[m, 2] = w
    return information_of


@kernel
def correspondence_cost(points, start, plan_from_cams, feet, information):  # pragma: no cover
    """Half the sum of g^T A g over points, g from the foot (m, 2) and A = (xx, xy, yy) (m, 3)."""
    cost = 0.0
    for k in range(len(start) - 1):
        t = plan_from_cams[k]
        for m in range(start[k], start[k + 1]):
            px, py, pz = points[m, 0], points[m, 1], points[m, 2]
            x = t[0, 0] * px + t[0, 1] * py + t[0, 2] * pz + t[0, 3] - feet[m, 0]
            y = t[1, 0] * px + t[1, 1] * py + t[1, 2] * pz + t[1, 3] - feet[m, 1]
            a = information[m]
            cost += 0.5 * (a[0] * x * x + 2.0 * a[1] * x * y + a[2] * y * y)
    return cost


@kernel
def sum_correspondences(
    points, start, frame_idx, plan_from_cams, feet, information, hessians, gradients
):  # pragma: no cover
    """Add the Gauss-Newton sums of `correspondence_cost` to its frames' (n, 6, 6) and (n, 6).

    With v = R p, x moves by (0, vz, -vy) . w and y by (-vz, 0, vx) . w under a rotation w.
    """
    jx, jy = np.zeros(6), np.zeros(6)
    jx[3], jy[4] = 1.0, 1.0
    for k in range(len(start) - 1):
        t = plan_from_cams[k]
        hessian, gradient = hessians[frame_idx[k]], gradients[frame_idx[k]]
        for m in range(start[k], start[k + 1]):
            xx, xy, yy = information[m]
            if xx + yy == 0.0:
                continue
            px, py, pz = points[m, 0], points[m, 1], points[m, 2]
            vx = t[0, 0] * px + t[0, 1] * py + t[0, 2] * pz
            vy = t[1, 0] * px + t[1, 1] * py + t[1, 2] * pz
            vz = t[2, 0] * px + t[2, 1] * py + t[2, 2] * pz
            x, y = vx + t[0, 3] - feet[m, 0], vy + t[1, 3] - feet[m, 1]
            jx[1], jx[2] = vz, -vy
            jy[0], jy[2] = -vz, vx
            for a in range(6):
                ax, ay = jx[a] * xx + jy[a] * xy, jx[a] * xy + jy[a] * yy
                gradient[a] += ax * x + ay * y
                for b in range(6):
                    hessian[a, b] += ax * jx[b] + ay * jy[b]
