"""Which rectangle each pixel of a camera sees, by a depth buffer.

Each rectangle is drawn row by row between its edges. Measured on buildings of 1,476 and 7,672 rectangles, in
640 x 480: 7 ms a view, where rays cast by embree took 110; of 5.5 million pixels 11 at edges differed.
"""

import math

import numpy as np
from jaxtyping import Float, Int

from planfit.compiled import kernel
from planfit.geometry import se3
from planfit.geometry.camera import Camera

_NEAR_M = 1e-6
"""What is nearer to the camera's plane than this is cut off."""
_IN_PLANE_M = 1e-9
"""A rectangle whose plane passes so near to the camera is seen edge-on: not at all."""
_EDGE_PX = 1e-6
"""By which rectangles are drawn larger, so that no pixel falls between two that share an edge."""


def first_rectangles(
    camera: Camera,
    plan_from_cam: Float[np.ndarray, "4 4"],
    origin: Float[np.ndarray, "n 3"],
    u_axis: Float[np.ndarray, "n 3"],
    v_axis: Float[np.ndarray, "n 3"],
    size: Float[np.ndarray, "n 2"],
) -> Int[np.ndarray, "h w"]:
    """Index of the first rectangle on each pixel's ray, from either side; -1 for none.

    Args:
        camera: intrinsics and image size.
        plan_from_cam: pose, OpenCV camera axes.
        origin: a corner of each rectangle, plan frame, m.
        u_axis: unit vectors, plan frame.
        v_axis: unit vectors at right angles to `u_axis`.
        size: lengths along both axes, m.
    """
    u, v = u_axis * size[:, :1], v_axis * size[:, 1:]
    corners = np.stack([origin, origin + u, origin + u + v, origin + v], axis=1).reshape(-1, 3)
    corners = se3.transform(se3.inverse(plan_from_cam), corners).reshape(-1, 4, 3)
    normal = np.cross(u_axis, v_axis) @ plan_from_cam[:3, :3]
    hit = np.full((camera.height, camera.width), -1)
    nearest = np.full(hit.shape, np.inf)
    _draw(corners, normal, camera.fx, camera.fy, camera.cx, camera.cy, hit, nearest)
    return hit


@kernel
def _draw(
    corners: np.ndarray, normal: np.ndarray, fx: float, fy: float, cx: float, cy: float,
    hit: np.ndarray, nearest: np.ndarray,
) -> None:  # fmt: skip
    """Draw rectangles, camera frame, one after the other where they are nearer than what was drawn."""
    height, width = hit.shape
    outline = np.zeros((5, 2))
    for q in range(len(corners)):
        ahead = 0.0
        for a in range(3):
            ahead += normal[q, a] * corners[q, 0, a]
        n = _outline(corners, q, fx, fy, cx, cy, outline)
        if n == 0 or abs(ahead) < _IN_PLANE_M:
            continue
        low, high = outline[0, 1], outline[0, 1]
        for k in range(1, n):
            low, high = min(low, outline[k, 1]), max(high, outline[k, 1])
        first_row = int(max(0.0, math.ceil(low - _EDGE_PX)))
        last_row = int(min(height - 1.0, math.floor(high + _EDGE_PX)))
        for row in range(first_row, last_row + 1):
            left, right = _span(outline, n, row)
            first = int(max(0.0, math.ceil(left - _EDGE_PX)))
            last = int(min(width - 1.0, math.floor(right + _EDGE_PX)))
            # Along a row the inverse of depth is linear.
            start = (normal[q, 1] * (row - cy) / fy + normal[q, 2] - normal[q, 0] * cx / fx) / ahead
            step = normal[q, 0] / (fx * ahead)
            for column in range(first, last + 1):
                inverse = start + step * column
                if inverse > 0.0 and inverse * nearest[row, column] > 1.0:
                    nearest[row, column] = 1.0 / inverse
                    hit[row, column] = q


@kernel
def _outline(
    corners: np.ndarray, q: int, fx: float, fy: float, cx: float, cy: float, outline: np.ndarray
) -> int:
    """Pixels of the corners of what lies in front of the camera, in order; how many there are."""
    n = 0
    for k in range(4):
        z, next_z = corners[q, k, 2], corners[q, (k + 1) % 4, 2]
        if z >= _NEAR_M:
            outline[n, 0] = fx * corners[q, k, 0] / z + cx
            outline[n, 1] = fy * corners[q, k, 1] / z + cy
            n += 1
        if (z >= _NEAR_M) != (next_z >= _NEAR_M):
            t = (_NEAR_M - z) / (next_z - z)
            x = corners[q, k, 0] + t * (corners[q, (k + 1) % 4, 0] - corners[q, k, 0])
            y = corners[q, k, 1] + t * (corners[q, (k + 1) % 4, 1] - corners[q, k, 1])
            outline[n, 0] = fx * x / _NEAR_M + cx
            outline[n, 1] = fy * y / _NEAR_M + cy
            n += 1
    return n


@kernel
def _span(outline: np.ndarray, n: int, row: int) -> tuple[float, float]:
    """Columns at which the outline begins and ends in a row."""
    left, right = np.inf, -np.inf
    for k in range(n):
        x, y = outline[k, 0], outline[k, 1]
        next_x, next_y = outline[(k + 1) % n, 0], outline[(k + 1) % n, 1]
        # A row that just misses an edge is drawn at the edge's end.
        if min(y, next_y) - _EDGE_PX <= row <= max(y, next_y) + _EDGE_PX:
            t = (row - y) / (next_y - y) if next_y != y else 0.0
            at = x + min(max(t, 0.0), 1.0) * (next_x - x)
            left, right = min(left, at), max(right, at)
            if next_y == y:
                left, right = min(left, next_x), max(right, next_x)
    return left, right
