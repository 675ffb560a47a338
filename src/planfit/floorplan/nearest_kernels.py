"""Compiled loops of `planfit.floorplan.nearest_faces`, which says what rule each goes by.

`pragma: no cover`: compiled code is invisible to coverage; the tests hold it against twins.
"""

import numpy as np

from planfit.compiled import kernel


@kernel
def _share_along(x, y, end):  # pragma: no cover
    """Where on a segment (2, 2) its point nearest to (x, y) lies, 0 to 1 from the first end."""
    dx, dy = end[1, 0] - end[0, 0], end[1, 1] - end[0, 1]
    length_sq = dx * dx + dy * dy
    if length_sq == 0.0:
        return 0.0
    share = ((x - end[0, 0]) * dx + (y - end[0, 1]) * dy) / length_sq
    return min(max(share, 0.0), 1.0)


@kernel
def _gap(x, y, end):  # pragma: no cover
    """From the nearest point of a segment (2, 2) to (x, y)."""
    share = _share_along(x, y, end)
    # Exact at both ends, unlike first + share * (second - first).
    near_x = (1.0 - share) * end[0, 0] + share * end[1, 0]
    near_y = (1.0 - share) * end[0, 1] + share * end[1, 1]
    return x - near_x, y - near_y


@kernel
def nearest_distance(xy, ends):  # pragma: no cover
    """Distances (m,) from points (m, 2) to the nearest segment (n, 2, 2)."""
    result = np.full(len(xy), np.inf)
    for m in range(len(xy)):
        for n in range(len(ends)):
            ax, ay = ends[n, 0, 0], ends[n, 0, 1]
            dx, dy = ends[n, 1, 0] - ax, ends[n, 1, 1] - ay
            px, py = xy[m, 0] - ax, xy[m, 1] - ay
            length_sq = dx * dx + dy * dy
            t = (px * dx + py * dy) / length_sq if length_sq > 0 else 0.0
            t = min(max(t, 0.0), 1.0)
            distance_sq = (px - t * dx) ** 2 + (py - t * dy) ** 2
            if distance_sq < result[m]:
                result[m] = distance_sq
    return np.sqrt(result)


@kernel
def facing_distances(xy, eyes, ends, normals, offsets, is_oriented):  # pragma: no cover
    """Distances (m, 2) to the nearest segment, and to the nearest that looks at the eye (m, 2)."""
    result = np.full((len(xy), 2), np.inf)
    block = 1024  # points that stay in the nearest cache while all faces pass by
    for first in range(0, len(xy), block):
        x, y = xy[first : first + block, 0].copy(), xy[first : first + block, 1].copy()
        u, v = eyes[first : first + block, 0].copy(), eyes[first : first + block, 1].copy()
        near, facing = np.full(len(x), np.inf), np.full(len(x), np.inf)
        for n in range(len(ends)):
            ax, ay = ends[n, 0, 0], ends[n, 0, 1]
            dx, dy = ends[n, 1, 0] - ax, ends[n, 1, 1] - ay
            length_sq = dx * dx + dy * dy
            scale = 1.0 / length_sq if length_sq > 0 else 0.0
            nx, ny, offset = normals[n, 0], normals[n, 1], offsets[n]
            if not is_oriented[n]:
                nx, ny, offset = 0.0, 0.0, -1.0  # looks at every eye
            for m in range(len(x)):  # without branches, so that it runs four abreast
                px, py = x[m] - ax, y[m] - ay
                t = (px * dx + py * dy) * scale
                t = t if t > 0.0 else 0.0
                t = t if t < 1.0 else 1.0
                px, py = px - t * dx, py - t * dy
                distance_sq = px * px + py * py
                near[m] = distance_sq if distance_sq < near[m] else near[m]
                seen = distance_sq if nx * u[m] + ny * v[m] > offset else np.inf
                facing[m] = seen if seen < facing[m] else facing[m]
        result[first : first + block, 0] = np.sqrt(near)
        result[first : first + block, 1] = np.sqrt(facing)
    return result


@kernel
def nearest_beside(
    xy, normals, ends, face_normals, is_oriented, max_distance, min_cosine, end_margin
):  # pragma: no cover
    """Signed distances (m,) across the nearest faces that look a point's way, and the faces (m,) or -1."""
    signed = np.zeros(len(xy))
    nearest = np.full(len(xy), -1)
    for m in range(len(xy)):
        best = max_distance
        for n in range(len(ends)):
            dx, dy = xy[m, 0] - ends[n, 0, 0], xy[m, 1] - ends[n, 0, 1]
            distance = dx * face_normals[n, 0] + dy * face_normals[n, 1]
            if abs(distance) >= best:
                continue
            cosine = normals[m, 0] * face_normals[n, 0] + normals[m, 1] * face_normals[n, 1]
            if (cosine if is_oriented[n] else abs(cosine)) <= min_cosine:
                continue
            ax, ay = ends[n, 1, 0] - ends[n, 0, 0], ends[n, 1, 1] - ends[n, 0, 1]
            length = np.sqrt(ax * ax + ay * ay)
            at = (dx * ax + dy * ay) / length
            if at > -end_margin and at < length + end_margin:
                best, signed[m], nearest[m] = abs(distance), distance, n
    return signed, nearest


@kernel
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


@kernel
def nearest_in_grid(
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
