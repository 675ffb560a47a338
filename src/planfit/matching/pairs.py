"""Which frames are worth matching: neighbours in time, and places that were visited again."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from planfit.errors import require_positive
from planfit.scan.odometry import Odometry


@dataclass(frozen=True)
class PairOptions:
    """Which pairs of frames are tried."""

    neighbours: int = 4
    """Each frame is tried with this many that follow it."""
    loops_per_frame: int = 12
    """Pairs a frame may take part in as a revisit, the nearest views first."""
    base_distance_m: float = 2.5
    """Cameras of a revisit are at most this far apart, plus what drift may add."""
    max_distance_m: float = 8.0
    """Largest distance between cameras, drift included."""
    max_angle_deg: float = 50.0
    """Largest angle between the viewing directions of a revisit."""
    view_distance_m: float = 4.0
    """Views are compared at this distance in front of the camera: two cameras that look at one spot
    from different places are nearer than two that stand together and look apart."""

    def __post_init__(self) -> None:
        require_positive(self, "neighbours", "max_distance_m", "max_angle_deg")


def choose_pairs(
    world_from_cams: np.ndarray, odometry: Odometry, options: PairOptions
) -> np.ndarray:
    """Pairs (p, 2) of frame indices, first < second, sorted."""
    n = len(world_from_cams)
    near_time = {(i, i + k) for k in range(1, options.neighbours + 1) for i in range(n - k)}
    return np.array(
        sorted(near_time | _revisits(world_from_cams, odometry, options)), dtype=int
    ).reshape(-1, 2)


def _revisits(
    world_from_cams: np.ndarray, odometry: Odometry, options: PairOptions
) -> set[tuple[int, int]]:
    centres, forward = world_from_cams[:, :3, 3], world_from_cams[:, :3, 2]
    reach = options.max_distance_m
    candidates = cKDTree(centres).query_pairs(reach, output_type="ndarray")
    i, j = candidates.min(axis=1), candidates.max(axis=1)
    later = j - i > options.neighbours
    i, j = i[later], j[later]
    _, drift = odometry.spread_between(i, j)
    distance = np.linalg.norm(centres[i] - centres[j], axis=1)
    ahead = centres + options.view_distance_m * forward
    view_gap = np.linalg.norm(ahead[i] - ahead[j], axis=1) + distance
    ok = (distance < options.base_distance_m + 2 * drift) & (
        np.sum(forward[i] * forward[j], axis=1) > np.cos(np.deg2rad(options.max_angle_deg))
    )
    i, j, view_gap = i[ok], j[ok], view_gap[ok]
    used = np.zeros(len(world_from_cams), dtype=int)
    chosen = set()
    for k in np.lexsort((j, i, view_gap)):
        a, b = int(i[k]), int(j[k])
        if max(used[a], used[b]) < options.loops_per_frame:
            used[a] += 1
            used[b] += 1
            chosen.add((a, b))
    return chosen
