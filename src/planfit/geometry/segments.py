"""2D segments: `ends` (n, 2, 2) m, the first axis over segments, the second over the two ends."""

import numba
import numpy as np


def lengths(ends: np.ndarray) -> np.ndarray:
    """Lengths (n,) m."""
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1)


def directions(ends: np.ndarray) -> np.ndarray:
    """Unit vectors (n, 2) from the first end to the second; segments must not be points."""
    return (ends[:, 1] - ends[:, 0]) / lengths(ends)[:, None]


def left_normals(ends: np.ndarray) -> np.ndarray:
    """Unit normals (n, 2) to the left of the way from the first end to the second."""
    along = directions(ends)
    return np.stack([-along[:, 1], along[:, 0]], axis=-1)


def nearest_distance(xy: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Distance (m,) m from each point (m, 2) to the nearest segment (n, 2, 2), ends included."""
    return _nearest_distance(np.ascontiguousarray(xy, dtype=float), np.ascontiguousarray(ends))


@numba.njit(cache=True, nogil=True)
def _nearest_distance(xy, ends):  # pragma: no cover - compiled; has a NumPy twin in the tests
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


def sample(ends: np.ndarray, spacing_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (m, 2) about every `spacing_m` along the segments, and the segment (m,) of each."""
    counts = np.maximum(np.ceil(lengths(ends) / spacing_m).astype(int), 1)
    idx = np.repeat(np.arange(len(ends)), counts)
    step = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    t = ((step + 0.5) / counts[idx])[:, None]
    return ends[idx, 0] * (1 - t) + ends[idx, 1] * t, idx
