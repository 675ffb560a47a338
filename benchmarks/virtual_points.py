"""A few points with the same sums as many: planfit's moments, for a solver that knows only points.

The weighted second moments of the matches of two frames, 7 x 7 for (p, q, 1), are those of seven pairs of
points, too, and the 4 x 4 of points on a plane those of four points. A cost of squared distances sees
nothing else, so it is the same, at all poses.
"""

import numpy as np

from planfit.lsq.moments import PairMoments


def virtual_matches(moments: PairMoments) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Seven pairs of points (7k, 3) with the moments of each pair of frames, and their weight (k,)."""
    # Both points have the same last coordinate, one: (p, q, 1) has all the sums there are.
    cross = np.concatenate([moments.ab[:, :3, :3], moments.aa[:, :3, 3:]], axis=2)
    low = np.concatenate([np.swapaxes(moments.ab[:, :3, :3], 1, 2), moments.bb[:, :3]], axis=2)
    last = np.concatenate([moments.aa[:, 3:, :3], moments.bb[:, 3:]], axis=2)
    top = np.concatenate([moments.aa[:, :3, :3], cross], axis=2)
    points, weight = virtual_points(np.concatenate([top, low, last], axis=1))
    return points[:, :3], points[:, 3:], weight


def virtual_points(moments: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As many points (d k, d - 1) as make the moments (k, d, d) of homogeneous ones, and their weight (k,).

    M = L L^T = (L Q)(L Q)^T for any orthogonal Q. The last row of L is as long as that of the points wanted,
    which all weigh the same: Q is the mirror that takes the one to the other.
    """
    d = moments.shape[1]
    values, vectors = np.linalg.eigh(moments)
    root = vectors * np.sqrt(values.clip(0))[:, None]
    weight = moments[:, -1, -1] / d
    mirror = root[:, -1] - np.sqrt(weight)[:, None]
    along = np.einsum("kij,kj->ki", root, mirror) / np.maximum(
        np.sum(mirror**2, axis=1, keepdims=True), 1e-300
    )
    turned = root - 2.0 * along[:, :, None] * mirror[:, None]
    points = np.swapaxes(turned[:, :-1], 1, 2) / np.sqrt(weight)[:, None, None]
    return points.reshape(-1, d - 1), weight
