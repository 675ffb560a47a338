"""Compiled passes over matches for residuals that do not collapse into moments.

Residuals of a pair depend on first_from_second alone, so each pair is summed by its tangent (rotation,
translation; first's axes): with v = R p and q = v + t, a change of q along `row` is a change of the tangent
along (v x row, row). Squared residuals come from one pass and robust weights from `robust`, so no
kernel here needs a loss (numba's cache watches only the file a function is in, see `lsq.moment_kernels`).

`pragma: no cover`: compiled code is invisible to coverage; the tests hold it against twins.
"""

import numpy as np

from planfit.compiled import kernel


@kernel
def _close(rows, hessian, gradient):  # pragma: no cover
    """Write J^T W J and J^T W r of a pair from rows sqrt(w) (J, r), (n, 7): one product for both."""
    both = np.dot(rows.T, rows)
    hessian[:] = both[:6, :6]
    gradient[:] = both[:6, 6]


@kernel
def reproject(
    points_second, points_first, start, first_from_second, focals, min_depth, squared, is_on
):  # pragma: no cover
    """Squared reprojection errors (px^2) in the first camera of points lifted by the second.

    Writes `squared` (m,) and `is_on` (m,): whether the point lies before the first camera by more than
    `min_depth`. Depths below are taken as `min_depth`, so the error stays finite and continuous.
    """
    for k in range(len(start) - 1):
        t = first_from_second[k]
        for m in range(start[k], start[k + 1]):
            px, py, pz = points_second[m, 0], points_second[m, 1], points_second[m, 2]
            x = t[0, 0] * px + t[0, 1] * py + t[0, 2] * pz + t[0, 3]
            y = t[1, 0] * px + t[1, 1] * py + t[1, 2] * pz + t[1, 3]
            z = t[2, 0] * px + t[2, 1] * py + t[2, 2] * pz + t[2, 3]
            depth, seen = max(z, min_depth), max(points_first[m, 2], min_depth)
            u = focals[k, 0] * (x / depth - points_first[m, 0] / seen)
            v = focals[k, 1] * (y / depth - points_first[m, 1] / seen)
            squared[m] = u * u + v * v
            is_on[m] = z > min_depth and points_first[m, 2] > min_depth


@kernel
def sum_reprojections(
    points_second,
    points_first,
    start,
    first_from_second,
    focals,
    min_depth,
    weight,
    hessians,
    gradients,
):  # pragma: no cover
    """Write the Gauss-Newton sums of `reproject`'s errors to (k, 6, 6) and (k, 6)."""
    for k in range(len(start) - 1):
        t = first_from_second[k]
        rows = np.zeros((2 * (start[k + 1] - start[k]), 7))
        for m in range(start[k], start[k + 1]):
            px, py, pz = points_second[m, 0], points_second[m, 1], points_second[m, 2]
            vx = t[0, 0] * px + t[0, 1] * py + t[0, 2] * pz
            vy = t[1, 0] * px + t[1, 1] * py + t[1, 2] * pz
            vz = t[2, 0] * px + t[2, 1] * py + t[2, 2] * pz
            x, y, z = vx + t[0, 3], vy + t[1, 3], vz + t[2, 3]
            depth, seen = max(z, min_depth), max(points_first[m, 2], min_depth)
            # A depth that is held at `min_depth` does not change.
            by_depth = 1.0 / depth if z > min_depth else 0.0
            root = np.sqrt(weight[m])
            focal_x, focal_y = root * focals[k, 0], root * focals[k, 1]
            row = rows[2 * (m - start[k])]
            a = focal_x / depth
            c = -a * x * by_depth
            row[0], row[1], row[2] = vy * c, vz * a - vx * c, -vy * a
            row[3], row[5] = a, c
            row[6] = focal_x * (x / depth - points_first[m, 0] / seen)
            row = rows[2 * (m - start[k]) + 1]
            b = focal_y / depth
            c = -b * y * by_depth
            row[0], row[1], row[2] = vy * c - vz * b, -vx * c, vx * b
            row[4], row[5] = b, c
            row[6] = focal_y * (y / depth - points_first[m, 1] / seen)
        _close(rows, hessians[k], gradients[k])


@kernel
def _cross(a, b, out):  # pragma: no cover
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@kernel
def _across(ray_first, ray_second, t, turned, normal):  # pragma: no cover
    """The second ray turned into the first's axes, and the cross product of the two; returns t . n."""
    for a in range(3):
        turned[a] = t[a, 0] * ray_second[0] + t[a, 1] * ray_second[1] + t[a, 2] * ray_second[2]
    _cross(ray_first, turned, normal)
    return t[0, 3] * normal[0] + t[1, 3] * normal[1] + t[2, 3] * normal[2]


@kernel
def ray_distances(
    rays_first, rays_second, start, first_from_second, parallel_sq, distance
):  # pragma: no cover
    """Signed faded distances (m,) m between rays; see `planfit.adjust.terms.rays`."""
    turned, normal = np.zeros(3), np.zeros(3)
    for k in range(len(start) - 1):
        for m in range(start[k], start[k + 1]):
            along = _across(rays_first[m], rays_second[m], first_from_second[k], turned, normal)
            sine_sq = normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2
            distance[m] = along / np.sqrt(sine_sq + parallel_sq)


@kernel
def sum_ray_distances(
    rays_first, rays_second, start, first_from_second, parallel_sq, weight, hessians, gradients
):  # pragma: no cover
    """Write the Gauss-Newton sums of `ray_distances` to (k, 6, 6) and (k, 6).

    With a the first ray, e the second, s the translation, n = a x e, N = n . n + parallel_sq and
    r = s . n / sqrt(N):
    dr = rotation . e x ((s x a) / sqrt(N) - (s . n) (n x a) / N^1.5) + translation . n / sqrt(N).
    """
    turned, normal, lever, across = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    for k in range(len(start) - 1):
        t = first_from_second[k]
        rows = np.zeros((start[k + 1] - start[k], 7))
        for m in range(start[k], start[k + 1]):
            row = rows[m - start[k]]
            along = _across(rays_first[m], rays_second[m], t, turned, normal)
            grown = normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2 + parallel_sq
            scale = np.sqrt(weight[m] / grown)
            _cross(t[:3, 3], rays_first[m], lever)
            _cross(normal, rays_first[m], across)
            for a in range(3):
                lever[a] = scale * (lever[a] - along * across[a] / grown)
                row[3 + a] = scale * normal[a]
            _cross(turned, lever, row)
            row[6] = scale * along
        _close(rows, hessians[k], gradients[k])
