"""Compiled search for the nearest wall face of many points, and the sums of what then pulls them.

`pragma: no cover`: compiled code is invisible to coverage; the tests hold it against twins.
"""

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def _share_along(x, y, end):  # pragma: no cover
    """Where on a segment (2, 2) its point nearest to (x, y) lies, 0 to 1 from the first end."""
    dx, dy = end[1, 0] - end[0, 0], end[1, 1] - end[0, 1]
    length_sq = dx * dx + dy * dy
    if length_sq == 0.0:
        return 0.0
    share = ((x - end[0, 0]) * dx + (y - end[0, 1]) * dy) / length_sq
    return min(max(share, 0.0), 1.0)


@numba.njit(cache=True, nogil=True)
def _gap(x, y, end):  # pragma: no cover
    """From the nearest point of a segment (2, 2) to (x, y)."""
    share = _share_along(x, y, end)
    # Exact at both ends, unlike first + share * (second - first).
    near_x = (1.0 - share) * end[0, 0] + share * end[1, 0]
    near_y = (1.0 - share) * end[0, 1] + share * end[1, 1]
    return x - near_x, y - near_y


@numba.njit(cache=True, nogil=True)
def list_faces(ends, origin, cell, shape, reach):  # pragma: no cover
    """Faces that some point of a cell may have within reach, cell by cell (row by row).

    Returns (cells + 1,) starts and (l,) face indices. Two passes: count, then write.
    """
    start = np.zeros(shape[0] * shape[1] + 1, dtype=np.int64)
    far = reach + cell * np.sqrt(0.5) * (1.0 + 1e-9)  # from the middle of the cell
    faces = np.zeros(0, dtype=np.int64)
    for is_writing in (False, True):
        at = 0
        for c in range(shape[0] * shape[1]):
            x = origin[0] + cell * (c // shape[1] + 0.5)
            y = origin[1] + cell * (c % shape[1] + 0.5)
            for f in range(len(ends)):
                gap_x, gap_y = _gap(x, y, ends[f])
                if gap_x * gap_x + gap_y * gap_y <= far * far:
                    if is_writing:
                        faces[at] = f
                    at += 1
            start[c + 1] = at
        if not is_writing:
            faces = np.zeros(at, dtype=np.int64)
    return start, faces


@numba.njit(cache=True, nogil=True)
def find_nearest(
    points,
    start,
    plan_from_cams,
    patch_normals,
    ends,
    normals,
    is_oriented,
    origin,
    cell,
    shape,
    cell_start,
    cell_faces,
    reach,
    face_idx,
    feet,
    gaps,
):  # pragma: no cover
    """Nearest face of each point of patches, in the plan seen from above.

    Args:
        points: (m, 3) camera frames; patch k is points start[k]:start[k + 1].
        start: (k + 1,).
        plan_from_cams: (k, 4, 4) pose of each patch's camera.
        patch_normals: (k, 2) towards the side the patch was seen from, plan frame.
        ends, normals, is_oriented: the faces; those oriented are passed over by patches seen from behind.
        origin, cell, shape, cell_start, cell_faces: from `list_faces`.
        reach: faces further away are none.
        face_idx: (m,) written: index, or -1.
        feet: (m, 2) written: nearest point of the face.
        gaps: (m, 2) written: from the nearest point of the face to the point.
    """
    for k in range(len(start) - 1):
        t = plan_from_cams[k]
        for m in range(start[k], start[k + 1]):
            px, py, pz = points[m, 0], points[m, 1], points[m, 2]
            x = t[0, 0] * px + t[0, 1] * py + t[0, 2] * pz + t[0, 3]
            y = t[1, 0] * px + t[1, 1] * py + t[1, 2] * pz + t[1, 3]
            row, column = np.floor((x - origin[0]) / cell), np.floor((y - origin[1]) / cell)
            face_idx[m] = -1
            if not (0 <= row < shape[0] and 0 <= column < shape[1]):
                continue
            c = int(row) * shape[1] + int(column)
            best = reach * reach
            for f in cell_faces[cell_start[c] : cell_start[c + 1]]:
                looks = normals[f, 0] * patch_normals[k, 0] + normals[f, 1] * patch_normals[k, 1]
                if is_oriented[f] and looks <= 0.0:
                    continue
                gap_x, gap_y = _gap(x, y, ends[f])
                distance_sq = gap_x * gap_x + gap_y * gap_y
                if distance_sq < best:
                    best = distance_sq
                    face_idx[m] = f
                    gaps[m, 0], gaps[m, 1] = gap_x, gap_y
                    feet[m, 0], feet[m, 1] = x - gap_x, y - gap_y


@numba.njit(cache=True, nogil=True)
def square_gaps(face_idx, gaps, normals, to_line, reach):  # pragma: no cover
    """Squared distances (m,) to faces or their lines; where there is no face, that of `reach`."""
    squared = np.full(len(face_idx), reach * reach)
    for m in range(len(face_idx)):
        f = face_idx[m]
        if f >= 0 and to_line:
            squared[m] = (gaps[m, 0] * normals[f, 0] + gaps[m, 1] * normals[f, 1]) ** 2
        elif f >= 0:
            squared[m] = gaps[m, 0] ** 2 + gaps[m, 1] ** 2
    return squared


@numba.njit(cache=True, nogil=True)
def aim_pulls(face_idx, normals, to_line, start, information, weight):  # pragma: no cover
    """Pulls (m, 3) for `pull_cost`, of points of patches worth information (k,) times weight (m,)."""
    pulls = np.zeros((len(face_idx), 3))
    for k in range(len(start) - 1):
        for m in range(start[k], start[k + 1]):
            f, w = face_idx[m], information[k] * weight[m]
            if f < 0:
                continue
            if to_line:
                pulls[m, 0] = w * normals[f, 0] * normals[f, 0]
                pulls[m, 1] = w * normals[f, 0] * normals[f, 1]
                pulls[m, 2] = w * normals[f, 1] * normals[f, 1]
            else:
                pulls[m, 0] = pulls[m, 2] = w
    return pulls


@numba.njit(cache=True, nogil=True)
def pull_cost(points, start, plan_from_cams, feet, information):  # pragma: no cover
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


@numba.njit(cache=True, nogil=True)
def sum_pulls(
    points, start, frame_idx, plan_from_cams, feet, information, hessians, gradients
):  # pragma: no cover
    """Add the Gauss-Newton sums of `pull_cost` to its frames' (n, 6, 6) and (n, 6).

    With v = R p, x moves by (0, vz, -vy) . turn and y by (-vz, 0, vx) . turn.
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
