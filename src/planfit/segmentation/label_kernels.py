"""Compiled loops of segmentation: the visibility map, labels that spread over a plane.

Numba compiles their types, which nothing can wrap: shapes are in the docstrings here, and in the
annotations of the functions that call them.
"""

import numpy as np

from planfit.compiled import kernel

CELL_M = 0.06
"""Size of a cell of the visibility map."""
BIN_M = 0.1
"""Height of its bins."""
_STOP_M = 0.06
"""A line of sight counts up to this far before what it meets."""


@kernel
def wall_cells_at(xy: np.ndarray, low_xy: np.ndarray, is_wall: np.ndarray, n_y: int) -> np.ndarray:
    """Whether cells at xy (k, 2) m are wall (k,); `is_wall` (nx, ceil(n_y / 8)) has a bit for each.

    As `np.packbits` lays them: eight cells along y a byte, the first in its highest bit.
    """
    found = np.zeros(len(xy), dtype=np.bool_)
    for k in range(len(xy)):
        i, j = np.floor((xy[k, 0] - low_xy[0]) / CELL_M), np.floor((xy[k, 1] - low_xy[1]) / CELL_M)
        if i >= 0 and j >= 0 and i < len(is_wall) and j < n_y:  # never of NaN
            row, column = int(i), int(j)
            found[k] = (is_wall[row, column >> 3] >> (7 - (column & 7))) & 1 == 1
    return found


@kernel
def trace_rays(
    centre: np.ndarray,
    points: np.ndarray,
    is_upright: np.ndarray,
    low: np.ndarray,
    hits: np.ndarray,
    highest_ray: np.ndarray,
) -> None:
    """Enter the rays from a camera's centre (3,) to points (n, 3) into a map with its corner at low (3,), m.

    Upright points (n,) count in and beside their cells in `hits` (nx, ny, nz). `highest_ray` (nx, ny) is
    raised to the bin of each line of sight, in half-cell steps. Both in place.
    """
    nx, ny, nz = hits.shape
    for k in range(len(points)):
        dx, dy, dz = (points[k, 0] - centre[0], points[k, 1] - centre[1], points[k, 2] - centre[2])
        length = np.sqrt(dx * dx + dy * dy)
        if not length < 40.0:  # NaN too
            continue
        if is_upright[k]:
            i = int(np.floor((points[k, 0] - low[0]) / CELL_M))
            j = int(np.floor((points[k, 1] - low[1]) / CELL_M))
            b = int(np.floor((points[k, 2] - low[2]) / BIN_M))
            if 0 < i < nx - 1 and 0 < j < ny - 1 and 0 <= b < nz:
                for di in range(-1, 2):
                    for dj in range(-1, 2):
                        if hits[i + di, j + dj, b] < 250:  # bytes; no more is asked for than two
                            hits[i + di, j + dj, b] += 1
        n_steps = int((length - _STOP_M) / (0.5 * CELL_M))
        for s in range(n_steps):
            t = (s + 0.5) * 0.5 * CELL_M / length
            i = int(np.floor((centre[0] + t * dx - low[0]) / CELL_M))
            j = int(np.floor((centre[1] + t * dy - low[1]) / CELL_M))
            if i < 0 or j < 0 or i >= nx or j >= ny:
                break
            b = int(np.floor((centre[2] + t * dz - low[2]) / BIN_M))
            if b > highest_ray[i, j]:
                highest_ray[i, j] = min(b, nz - 1)


@kernel
def upright_extents(hits: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest bin (nx, ny) with two upright points or more; nz and -1 where there is none."""
    nx, ny, nz = hits.shape
    bottom = np.full((nx, ny), nz, dtype=np.int16)
    top = np.full((nx, ny), -1, dtype=np.int16)
    for i in range(nx):
        for j in range(ny):
            for b in range(nz):
                if hits[i, j, b] >= 2:
                    top[i, j] = b
                    bottom[i, j] = min(bottom[i, j], b)
    return bottom, top


@kernel
def label_walls(
    labels: np.ndarray,
    planes: np.ndarray,
    points: np.ndarray,
    normals: np.ndarray,
    tilt_sine: float,
    is_wall: np.ndarray,
    label: int,
) -> None:
    """Label upright pixels (h, w) where it `is_wall`, each with the upright plane it lies on, in place."""
    h, w = labels.shape
    for r in range(h):
        for c in range(w):
            n, p = normals[r, c], points[r, c]
            if is_wall[r, c] and abs(n[2]) < tilt_sine:
                length = np.hypot(n[0], n[1])
                labels[r, c] = label
                planes[r, c, 0], planes[r, c, 1] = n[0] / length, n[1] / length
                planes[r, c, 3] = planes[r, c, 0] * p[0] + planes[r, c, 1] * p[1]


@kernel
def label_level(
    labels: np.ndarray,
    planes: np.ndarray,
    points: np.ndarray,
    normal_z: np.ndarray,
    near: np.ndarray,
    tolerance: np.ndarray,
    plane: np.ndarray,
    facing: float,
    label: int,
) -> None:
    """Give pixels (h, w) `near` a level its label where they lie on its plane (4,), in place.

    Seen at a flat angle normals are wild; whatever lies on the plane and is not upright is it.
    """
    h, w = labels.shape
    for r in range(h):
        for c in range(w):
            if not near[r, c] or facing * normal_z[r, c] < np.float32(0.7):
                continue
            off = -plane[3]
            for a in range(3):
                off += plane[a] * points[r, c, a]
            if abs(off) < tolerance[r, c]:
                labels[r, c] = label
                planes[r, c] = plane


@kernel
def grow_labels(
    labels: np.ndarray,
    planes: np.ndarray,
    points: np.ndarray,
    normals: np.ndarray,
    tolerance: np.ndarray,
    n_steps: int,
) -> None:
    """Carry labels (h, w) with their planes (h, w, 4) to unlabelled neighbours on the plane, in place.

    At most `n_steps` pixels far, and within `tolerance` (h, w) m of the plane.
    """
    h, w = labels.shape
    queue = np.zeros((h * w, 2), dtype=np.int32)
    age = np.zeros((h, w), dtype=np.int16)
    head, tail = 0, 0
    for r in range(h):
        for c in range(w):
            if labels[r, c] != 0:
                queue[tail, 0], queue[tail, 1] = r, c
                tail += 1
    while head < tail:
        r, c = queue[head]
        head += (
            1  # breadth first: each pixel is reached by its shortest way, labels grow at one pace
        )
        if age[r, c] >= n_steps:
            continue
        for k in range(4):
            i = r + (1 if k == 0 else -1 if k == 1 else 0)
            j = c + (1 if k == 2 else -1 if k == 3 else 0)
            if i < 0 or j < 0 or i >= h or j >= w or labels[i, j] != 0:
                continue
            off = -planes[r, c, 3]
            along = np.float32(0.0)
            for a in range(3):
                off += planes[r, c, a] * points[i, j, a]
                along += planes[r, c, a] * normals[i, j, a]
            # NaN normals compare false and are let in; NaN points are not.
            if abs(off) < tolerance[i, j] and not abs(along) < 0.85:
                labels[i, j] = labels[r, c]
                planes[i, j] = planes[r, c]
                age[i, j] = age[r, c] + 1
                queue[tail, 0], queue[tail, 1] = i, j
                tail += 1
