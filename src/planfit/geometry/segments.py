"""2D segments: `ends` (n, 2, 2) m, the first axis over segments, the second over the two ends."""

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


def sample(ends: np.ndarray, spacing_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (m, 2) about every `spacing_m` along the segments, and the segment (m,) of each."""
    counts = np.maximum(np.ceil(lengths(ends) / spacing_m).astype(int), 1)
    idx = np.repeat(np.arange(len(ends)), counts)
    step = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    t = ((step + 0.5) / counts[idx])[:, None]
    return ends[idx, 0] * (1 - t) + ends[idx, 1] * t, idx
