"""Distance of points to the plan's nearest faces, by whether a face looks at the camera; compiled."""

import numba
import numpy as np
from jaxtyping import Float

from planfit.floorplan import Floorplan


def nearest_distances(
    xy: Float[np.ndarray, "m 2"], eyes_xy: Float[np.ndarray, "m 2"], floorplan: Floorplan
) -> Float[np.ndarray, "m 2"]:
    """Distance (m) of each point, seen from its own eye, to the nearest face, and to the nearest face that
    looks at the eye (infinite where none does). Past the ends of a face, the distance is to its end."""
    return _nearest(
        np.ascontiguousarray(xy, dtype=float),
        np.ascontiguousarray(eyes_xy, dtype=float),
        np.ascontiguousarray(floorplan.ends, dtype=float),
        np.ascontiguousarray(floorplan.normals, dtype=float),
        np.asarray(floorplan.offsets, dtype=float),
        np.asarray(floorplan.is_oriented, dtype=bool),
    )


@numba.njit(cache=True, nogil=True)
def _nearest(
    xy, eyes, ends, normals, offsets, is_oriented
):  # pragma: no cover - compiled; has a NumPy twin in the tests
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
