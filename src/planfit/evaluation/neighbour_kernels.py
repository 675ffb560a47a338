"""Compiled loops of `planfit.evaluation.neighbourhoods`; each has a NumPy twin in the tests."""

import numpy as np

from planfit.compiled import kernel

# Sums may be taken in another order, which lets them run four abreast: the same on one machine.
_FAST = {"reassoc", "contract", "nsz"}


@kernel
def fill_table(keys):  # pragma: no cover - compiled
    """Open-addressing table of distinct keys (q,) >= 0: keys and their indices, -1 where empty."""
    size = 16
    while size < 2 * len(keys):
        size *= 2
    table_keys = np.full(size, -1, dtype=np.int64)
    indices = np.full(size, -1, dtype=np.int64)
    for index in range(len(keys)):
        at = _slot(keys[index], size)
        while table_keys[at] >= 0:
            at = (at + 1) & (size - 1)
        table_keys[at] = keys[index]
        indices[at] = index
    return table_keys, indices


@kernel(inline="always")
def _slot(key, size):  # pragma: no cover - compiled
    mixed = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
    return np.int64(mixed >> np.uint64(33)) & (size - 1)


@kernel
def sum_cells(points, start, cells, edge):  # pragma: no cover - compiled
    """Sums (c, 10) of each cell's points about the cell's centre."""
    sums = np.zeros((len(cells), 10))
    for c in range(len(cells)):
        cx, cy, cz = (
            (cells[c, 0] + 0.5) * edge,
            (cells[c, 1] + 0.5) * edge,
            (cells[c, 2] + 0.5) * edge,
        )
        for m in range(start[c], start[c + 1]):
            x, y, z = points[0, m] - cx, points[1, m] - cy, points[2, m] - cz
            sums[c, 0] += 1.0
            sums[c, 1] += x
            sums[c, 2] += y
            sums[c, 3] += z
            sums[c, 4] += x * x
            sums[c, 5] += x * y
            sums[c, 6] += x * z
            sums[c, 7] += y * y
            sums[c, 8] += y * z
            sums[c, 9] += z * z
    return sums


@kernel(inline="always")
def _shifted(sums, x, y, z, out):  # pragma: no cover - compiled
    """The same sums about a point that lies (-x, -y, -z) from the one that they are about."""
    # Parallel axes: the sum of (p + x)(q + y) is that of pq + yp + xq + xy.
    n, sx, sy, sz = sums[0], sums[1], sums[2], sums[3]
    out[0] = n
    out[1] = sx + n * x
    out[2] = sy + n * y
    out[3] = sz + n * z
    out[4] = sums[4] + 2.0 * x * sx + n * x * x
    out[5] = sums[5] + x * sy + y * sx + n * x * y
    out[6] = sums[6] + x * sz + z * sx + n * x * z
    out[7] = sums[7] + 2.0 * y * sy + n * y * y
    out[8] = sums[8] + y * sz + z * sy + n * y * z
    out[9] = sums[9] + 2.0 * z * sz + n * z * z


@kernel(fastmath=_FAST)
def _add_within(x, y, z, half, limit, centres, about, is_cut, total):  # pragma: no cover - compiled
    """Add the sums of those cells that lie within the sphere about (x, y, z) as a whole; mark the cut."""
    xs, ys, zs = centres[0], centres[1], centres[2]
    a0, a1, a2, a3, a4 = about[0], about[1], about[2], about[3], about[4]
    a5, a6, a7, a8, a9 = about[5], about[6], about[7], about[8], about[9]
    t0 = t1 = t2 = t3 = t4 = t5 = t6 = t7 = t8 = t9 = 0.0
    for o in range(len(is_cut)):
        dx, dy, dz = abs(x - xs[o]), abs(y - ys[o]), abs(z - zs[o])
        fx, fy, fz = dx + half, dy + half, dz + half
        nx, ny, nz = dx - half, dy - half, dz - half
        nx, ny, nz = nx if nx > 0.0 else 0.0, ny if ny > 0.0 else 0.0, nz if nz > 0.0 else 0.0
        w = 1.0 if fx * fx + fy * fy + fz * fz <= limit else 0.0
        is_cut[o] = nx * nx + ny * ny + nz * nz - w * limit  # below 0 where within as a whole
        t0 += w * a0[o]
        t1 += w * a1[o]
        t2 += w * a2[o]
        t3 += w * a3[o]
        t4 += w * a4[o]
        t5 += w * a5[o]
        t6 += w * a6[o]
        t7 += w * a7[o]
        t8 += w * a8[o]
        t9 += w * a9[o]
    total[0] += t0
    total[1] += t1
    total[2] += t2
    total[3] += t3
    total[4] += t4
    total[5] += t5
    total[6] += t6
    total[7] += t7
    total[8] += t8
    total[9] += t9


@kernel(fastmath=_FAST)
def _add_points(x, y, z, xs, ys, zs, limit, total):  # pragma: no cover - compiled
    """Add the points that are near (x, y, z), about (x, y, z)."""
    s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = s8 = s9 = 0.0
    for q in range(len(xs)):
        dx, dy, dz = xs[q] - x, ys[q] - y, zs[q] - z
        w = 1.0 if dx * dx + dy * dy + dz * dz <= limit else 0.0
        wx, wy, wz = w * dx, w * dy, w * dz
        s0 += w
        s1 += wx
        s2 += wy
        s3 += wz
        s4 += wx * dx
        s5 += wx * dy
        s6 += wx * dz
        s7 += wy * dy
        s8 += wy * dz
        s9 += wz * dz
    total[0] += s0
    total[1] += s1
    total[2] += s2
    total[3] += s3
    total[4] += s4
    total[5] += s5
    total[6] += s6
    total[7] += s7
    total[8] += s8
    total[9] += s9


@kernel
def _near_cells(
    c,
    cells,
    start,
    column_start,
    table_keys,
    indices,
    sums,
    edge,
    reach,
    runs,
    centres,
    about,
    shared,
):  # pragma: no cover - compiled
    """Cells that a sphere about a point of cell c may reach: those within every such sphere go into `shared`,
    the others into the lists; returns how many."""
    size, n = len(table_keys), 0
    moved = np.zeros(10)
    ci, cj, ck = cells[c, 0], cells[c, 1], cells[c, 2]
    for di in range(-reach, reach + 1):
        gap_i = max(abs(di) - 1, 0)
        for dj in range(-reach, reach + 1):
            gap_j = max(abs(dj) - 1, 0)
            gap_ij = gap_i * gap_i + gap_j * gap_j
            if gap_ij > reach * reach or ci + di < 0 or cj + dj < 0:
                continue
            key = ((ci + di) << 21) | (cj + dj)
            at = _slot(key, size)
            while table_keys[at] >= 0 and table_keys[at] != key:
                at = (at + 1) & (size - 1)
            if table_keys[at] < 0:
                continue
            below, above = column_start[indices[at]], column_start[indices[at] + 1]
            end = above
            while below < above:  # the first cell that is high enough
                middle = (below + above) // 2
                if cells[middle, 2] < ck - reach:
                    below = middle + 1
                else:
                    above = middle
            for o in range(below, end):
                dk = cells[o, 2] - ck
                if dk > reach:
                    break
                gap_k = max(abs(dk) - 1, 0)
                if gap_ij + gap_k * gap_k > reach * reach:
                    continue
                _shifted(sums[o], di * edge, dj * edge, dk * edge, moved)
                far = (abs(di) + 1) ** 2 + (abs(dj) + 1) ** 2 + (abs(dk) + 1) ** 2
                if far <= reach * reach:
                    for e in range(10):
                        shared[e] += moved[e]
                    continue
                runs[n, 0], runs[n, 1] = start[o], start[o + 1]
                centres[0, n], centres[1, n], centres[2, n] = di * edge, dj * edge, dk * edge
                for e in range(10):
                    about[e, n] = moved[e]
                n += 1
    return n


@kernel
def sum_neighbours(
    first,
    last,
    points,
    cells,
    start,
    column_start,
    table_keys,
    indices,
    sums,
    radius,
    reach,
    counts,
    covariance,
):  # pragma: no cover - compiled
    """Fill counts (m,) and covariance (m, 6) of the points in cells first:last."""
    edge, limit, begin = radius / reach, radius * radius, start[first]
    most = (2 * reach + 1) ** 3
    runs = np.zeros((most, 2), dtype=np.int64)
    centres, about, is_cut = np.zeros((3, most)), np.zeros((10, most)), np.zeros(most)
    total, shared, own = np.zeros(10), np.zeros(10), np.zeros(10)
    xs, ys, zs = points[0], points[1], points[2]
    for c in range(first, last):
        cx, cy, cz = (
            (cells[c, 0] + 0.5) * edge,
            (cells[c, 1] + 0.5) * edge,
            (cells[c, 2] + 0.5) * edge,
        )
        shared[:] = 0.0
        n_near = _near_cells(
            c, cells, start, column_start, table_keys, indices, sums, edge, reach,
            runs, centres, about, shared,
        )  # fmt: skip
        for m in range(start[c], start[c + 1]):
            x, y, z = xs[m] - cx, ys[m] - cy, zs[m] - cz
            for e in range(10):
                total[e] = shared[e]
                own[e] = 0.0
            _add_within(x, y, z, 0.5 * edge, limit, centres, about, is_cut[:n_near], total)
            for o in range(n_near):
                if 0.0 <= is_cut[o] <= limit:
                    a, b = runs[o, 0], runs[o, 1]  # slices: a loop from 0 runs four abreast
                    _add_points(xs[m], ys[m], zs[m], xs[a:b], ys[a:b], zs[a:b], limit, own)
            _shifted(own, x, y, z, own)
            for e in range(10):
                total[e] += own[e]
            n = total[0]
            out = m - begin
            counts[out] = np.int64(n)
            if n >= 2.0:
                mx, my, mz = total[1] / n, total[2] / n, total[3] / n
                covariance[out, 0] = (total[4] - n * mx * mx) / (n - 1.0)
                covariance[out, 1] = (total[5] - n * mx * my) / (n - 1.0)
                covariance[out, 2] = (total[6] - n * mx * mz) / (n - 1.0)
                covariance[out, 3] = (total[7] - n * my * my) / (n - 1.0)
                covariance[out, 4] = (total[8] - n * my * mz) / (n - 1.0)
                covariance[out, 5] = (total[9] - n * mz * mz) / (n - 1.0)


@kernel
def smallest_eigenvalues(covariance, out):  # pragma: no cover - compiled
    """Smallest eigenvalue (m,) of symmetric matrices by their entries xx xy xz yy yz zz (m, 6).

    Jacobi's rotations: good to 1e-12 of the trace, for planes and lines too, where the closed formula loses
    half of its digits.
    """
    for m in range(len(covariance)):
        a, d, f = covariance[m, 0], covariance[m, 3], covariance[m, 5]
        b, c, e = covariance[m, 1], covariance[m, 2], covariance[m, 4]
        small = 1e-12 * (abs(a) + abs(d) + abs(f))
        for _ in range(12):
            if abs(b) + abs(c) + abs(e) <= small:
                break
            if b != 0.0:
                cosine, sine, change = _rotation(a, d, b)
                a, d, b = a - change, d + change, 0.0
                c, e = cosine * c - sine * e, sine * c + cosine * e
            if c != 0.0:
                cosine, sine, change = _rotation(a, f, c)
                a, f, c = a - change, f + change, 0.0
                b, e = cosine * b - sine * e, sine * b + cosine * e
            if e != 0.0:
                cosine, sine, change = _rotation(d, f, e)
                d, f, e = d - change, f + change, 0.0
                b, c = cosine * b - sine * c, sine * b + cosine * c
        out[m] = min(a, d, f)


@kernel(inline="always")
def _rotation(p, q, off):  # pragma: no cover - compiled
    """Cosine and sine that make the off-diagonal entry vanish, and how far the diagonal moves."""
    theta = (q - p) / (2.0 * off)
    if abs(theta) > 1e100:
        t = 0.5 / theta
    else:
        t = 1.0 / (abs(theta) + np.sqrt(theta * theta + 1.0))
        if theta < 0.0:
            t = -t
    cosine = 1.0 / np.sqrt(t * t + 1.0)
    return cosine, t * cosine, t * off
