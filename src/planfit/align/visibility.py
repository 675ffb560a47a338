"""Compiled loops over samples and faces: the nearest face that looks a sample's way, and what a line of
sight crosses."""

import numba
import numpy as np

END_MARGIN_M = 0.3
"""A sample may lie beyond the end of its face by this much; a line of sight that passes nearer to the
end of a face than this, or than a quarter of the face, does not cross it: jambs and corners are where
drift shows first."""
SIGHT_MARGIN_M = 0.4
"""Crossings this near to the wall that is looked at, or to the camera, do not count."""


def nearest_faces(
    xy: np.ndarray,
    normals: np.ndarray,
    ends: np.ndarray,
    face_normals: np.ndarray,
    is_oriented: np.ndarray,
    max_distance_m: float,
    max_angle_deg: float = 25.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Signed distance (m,) m to the nearest face beside each sample that looks its way, and the face, or -1.

    The rule is that of `adjust.association` for one point instead of a piece: same side, alike
    direction, beside the face; the angle is wider, as the turn is not yet known.
    """
    return _nearest_faces(
        np.ascontiguousarray(xy),
        np.ascontiguousarray(normals),
        np.ascontiguousarray(ends),
        np.ascontiguousarray(face_normals),
        is_oriented,
        max_distance_m,
        np.cos(np.deg2rad(max_angle_deg)),
        END_MARGIN_M,
    )


def crosses_face(eyes: np.ndarray, xy: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """(m,) bool: whether the line of sight from each eye (m, 2) to its point (m, 2) crosses a face."""
    return _crosses_face(
        np.ascontiguousarray(eyes),
        np.ascontiguousarray(xy),
        np.ascontiguousarray(ends),
        END_MARGIN_M,
        SIGHT_MARGIN_M,
    )


@numba.njit(cache=True, nogil=True)
def _nearest_faces(
    xy, normals, ends, face_normals, is_oriented, max_distance, min_cosine, end_margin
):  # pragma: no cover - compiled; has a NumPy twin in the tests
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


@numba.njit(cache=True, nogil=True)
def _crosses_face(
    eyes, xy, ends, end_margin, sight_margin
):  # pragma: no cover - compiled; has a NumPy twin in the tests
    crossed = np.zeros(len(xy), dtype=np.bool_)
    for m in range(len(xy)):
        rx, ry = xy[m, 0] - eyes[m, 0], xy[m, 1] - eyes[m, 1]
        reach = np.sqrt(rx * rx + ry * ry)
        if reach <= 2 * sight_margin:
            continue
        low, high = sight_margin / reach, 1.0 - sight_margin / reach
        for n in range(len(ends)):
            ax, ay = ends[n, 1, 0] - ends[n, 0, 0], ends[n, 1, 1] - ends[n, 0, 1]
            cross = rx * ay - ry * ax
            if abs(cross) < 1e-12:
                continue
            dx, dy = ends[n, 0, 0] - eyes[m, 0], ends[n, 0, 1] - eyes[m, 1]
            t = (dx * ay - dy * ax) / cross
            if t <= low or t >= high:
                continue
            u = (dx * ry - dy * rx) / cross
            margin = min(end_margin / np.sqrt(ax * ax + ay * ay), 0.25)
            if u > margin and u < 1.0 - margin:
                crossed[m] = True
                break
    return crossed
