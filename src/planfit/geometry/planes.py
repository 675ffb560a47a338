"""Planes in 3D: `normal @ point == offset`, unit normal."""

import numpy as np


def fit_plane(
    points: np.ndarray, weights: np.ndarray | None = None
) -> tuple[np.ndarray, float, float]:
    """Total least-squares plane of points (n, 3), n >= 3: unit normal (3,), offset m, RMS distance m."""
    w = np.ones(len(points)) if weights is None else weights
    w = w / w.sum()
    centre = w @ points
    centred = points - centre
    values, vectors = np.linalg.eigh(centred.T @ (centred * w[:, None]))
    normal = vectors[:, 0]
    return normal, float(normal @ centre), float(np.sqrt(max(values[0], 0.0)))
