"""Compiled loops over points of a laser scanner: depth images, small holes in them, points moved by time.

Numba compiles their types, which nothing can wrap: shapes are in the docstrings here, and in the
annotations of the functions that call them.
"""

import numpy as np

from planfit.compiled import kernel

SAME_SURFACE_M = 0.05
"""Points of a pixel up to this far behind its nearest one are of one surface, and count as their mean."""
SAME_SURFACE_SHARE = 0.01
"""The same, as a share of the depth, on top."""
MAX_JUMP_SHARE = 0.15
"""Depths at both sides of a hole that differ by less are of one surface."""


@kernel
def pixel_of(
    x: float, y: float, z: float, rotation: np.ndarray, fx: float, cx: float, cy: float,
    h: int, w: int,
) -> tuple[int, float]:  # fmt: skip
    """Number of the pixel (by row) that a point falls on, -1 for none, and its depth."""
    ahead = rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z
    if not ahead > 0.05:
        return -1, 0.0
    u = (rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z) / ahead * fx + cx
    v = (rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z) / ahead * fx + cy
    if not (u > -0.5 and v > -0.5 and u < w - 0.5 and v < h - 0.5):
        return -1, 0.0
    return int(np.floor(v + 0.5)) * w + int(np.floor(u + 0.5)), ahead


@kernel
def count_seen(
    points: np.ndarray, rotation: np.ndarray, fx: float, cx: float, cy: float, h: int, w: int
) -> int:
    """How many points (n, 3), in axes turned by `rotation`, fall on an image of h x w px."""
    seen = 0
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        seen += pixel_of(x, y, z, rotation, fx, cx, cy, h, w)[0] >= 0
    return seen


@kernel
def splat(
    points: np.ndarray, rotation: np.ndarray, fx: float, cx: float, cy: float, h: int, w: int
) -> np.ndarray:
    """Depth image (h, w) float32 m, NaN where no point falls, of points (n, 3) in axes turned by `rotation`.

    Square pixels of focal length `fx`. A pixel's depth is the mean of its points on the nearest surface.
    """
    n = points.shape[0]
    nearest = np.full((h, w), np.float32(np.inf))
    pixel = np.full(n, -1, dtype=np.int32)
    depths = np.zeros(n, dtype=np.float32)
    for i in range(n):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        at, ahead = pixel_of(x, y, z, rotation, fx, cx, cy, h, w)
        if at < 0:
            continue
        pixel[i], depths[i] = at, ahead
        r, c = at // w, at % w
        if ahead < nearest[r, c]:
            nearest[r, c] = ahead
    total = np.zeros((h, w))
    count = np.zeros((h, w), dtype=np.int32)
    for i in range(n):
        if pixel[i] < 0:
            continue
        r, c = pixel[i] // w, pixel[i] % w
        near = nearest[r, c]
        if depths[i] <= near * (1 + SAME_SURFACE_SHARE) + SAME_SURFACE_M:
            total[r, c] += depths[i]
            count[r, c] += 1
    image = np.full((h, w), np.float32(np.nan))
    for r in range(h):
        for c in range(w):
            if count[r, c] > 0:
                image[r, c] = total[r, c] / count[r, c]
    return image


@kernel
def fill_holes(image: np.ndarray, reach: int) -> np.ndarray:
    """The depth image (h, w) with holes of up to `reach` px across filled, between pixels of one surface.

    Along a row or column, whichever is shorter; the inverse of depth, which is linear over a plane.
    """
    h, w = image.shape
    filled = image.copy()
    for r in range(h):
        for c in range(w):
            if np.isfinite(image[r, c]):
                continue
            best, value = reach + 1, np.float32(np.nan)
            for dr, dc in ((1, 0), (0, 1)):
                before = after = 0
                for k in range(1, reach + 1):
                    if r - k * dr < 0 or c - k * dc < 0:
                        break
                    if np.isfinite(image[r - k * dr, c - k * dc]):
                        before = k
                        break
                if before == 0:
                    continue
                for k in range(1, reach + 1 - before + 1):
                    if r + k * dr >= h or c + k * dc >= w:
                        break
                    if np.isfinite(image[r + k * dr, c + k * dc]):
                        after = k
                        break
                if after == 0 or before + after >= best:
                    continue
                a = image[r - before * dr, c - before * dc]
                b = image[r + after * dr, c + after * dc]
                if abs(a - b) > MAX_JUMP_SHARE * min(a, b):
                    continue
                best = before + after
                share = before / best
                value = 1.0 / ((1 - share) / a + share / b)
            filled[r, c] = value
    return filled


@kernel
def move_by_time(
    xyz: np.ndarray, from_centres: np.ndarray, to_centres: np.ndarray, before: np.ndarray,
    share: np.ndarray, rotations: np.ndarray, turns: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Points (n, 3) m, turned about their centres (n, 3), which move (n, 3): double precision.

    The rotation is rotations[before] exp(share turns[before]), (k, 3, 3) and (k, 3) rad.
    """
    n = xyz.shape[0]
    moved = np.zeros((n, 3))
    for i in range(n):
        k, s = before[i], share[i]
        x = xyz[i, 0] - from_centres[i, 0]
        y = xyz[i, 1] - from_centres[i, 1]
        z = xyz[i, 2] - from_centres[i, 2]
        ax, ay, az = s * turns[k, 0], s * turns[k, 1], s * turns[k, 2]
        angle = np.sqrt(ax * ax + ay * ay + az * az)
        # Rodrigues: x + sin(a)/a (a x x) + (1 - cos a)/a^2 (a x (a x x)).
        first = np.sin(angle) / angle if angle > 1e-9 else 1.0
        second = (1 - np.cos(angle)) / (angle * angle) if angle > 1e-9 else 0.5
        bx, by, bz = ay * z - az * y, az * x - ax * z, ax * y - ay * x
        qx = x + first * bx + second * (ay * bz - az * by)
        qy = y + first * by + second * (az * bx - ax * bz)
        qz = z + first * bz + second * (ax * by - ay * bx)
        for j in range(3):
            turned = rotations[k, j, 0] * qx + rotations[k, j, 1] * qy + rotations[k, j, 2] * qz
            moved[i, j] = turned + to_centres[i, j]
    return moved
