"""2D segments: `ends`, the first axis over segments, the second over the two ends, metres."""

import numpy as np
from jaxtyping import Float, Int


def lengths(ends: Float[np.ndarray, "n 2 2"]) -> Float[np.ndarray, " n"]:
    """Lengths, metres."""
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1)


def directions(ends: Float[np.ndarray, "n 2 2"]) -> Float[np.ndarray, "n 2"]:
    """Unit vectors from the first end to the second; segments must not be points."""
    return (ends[:, 1] - ends[:, 0]) / lengths(ends)[:, None]


def left_normals(ends: Float[np.ndarray, "n 2 2"]) -> Float[np.ndarray, "n 2"]:
    """Unit normals to the left of the way from the first end to the second."""
    along = directions(ends)
    return np.stack([-along[:, 1], along[:, 0]], axis=-1)


def turns(
    one: Float[np.ndarray, "n 2"], other: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, " n"]:
    """Angles from vectors to others, rad, to the left > 0."""
    cross = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    return np.arctan2(cross, np.einsum("ni,ni->n", one, other))


def sample(
    ends: Float[np.ndarray, "n 2 2"], spacing_m: float
) -> tuple[Float[np.ndarray, "m 2"], Int[np.ndarray, " m"]]:
    """Points (m) about every `spacing_m` along the segments, and the segment of each."""
    return spread(ends, np.maximum(np.ceil(lengths(ends) / spacing_m).astype(int), 1))


def spread(
    ends: Float[np.ndarray, "n 2 2"], counts: Int[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "m 2"], Int[np.ndarray, " m"]]:
    """The middles of so many equal parts of each segment, and the segment of each."""
    idx = np.repeat(np.arange(len(ends)), counts)
    # Counts up from 0 within each segment: the running number less that of the segment's first point.
    step = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    t = ((step + 0.5) / counts[idx])[:, None]
    return ends[idx, 0] * (1 - t) + ends[idx, 1] * t, idx


def moved(
    points: Float[np.ndarray, "*n 2"], there_from_here: Float[np.ndarray, "_ 3"]
) -> Float[np.ndarray, "*n 2"]:
    """Points under an affine map, of whose matrix the first two rows count."""
    return points @ there_from_here[:2, :2].T + there_from_here[:2, 2]
