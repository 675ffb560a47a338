"""How much of one view another shows, guessed from recorded poses and a few lifted keypoints a frame."""

from dataclasses import dataclass

import numba
import numpy as np

from planfit.geometry import se3
from planfit.geometry.camera import Camera

N_POINTS = 24
"""Points of each frame; a share of 24 is known to a tenth, and drift spoils more than that."""
CHUNK = 100_000
MARGIN = 0.15
"""Points this share of the image beyond its border count too: drift of a few degrees moves as much."""


@dataclass(frozen=True)
class ViewSamples:
    """A few points that each frame shows."""

    points_cam: np.ndarray  # (n, N_POINTS, 3) m; NaN where a frame has fewer
    half_view: np.ndarray  # (n, 2, 2): smallest and largest x / z, and y / z, that a frame shows

    def overlap(self, world_from_cams: np.ndarray, pairs: np.ndarray) -> np.ndarray:
        """Share (p,) of the points of either frame that the other shows, the smaller of the two."""
        result = np.zeros(len(pairs))
        for first in range(0, len(pairs), CHUNK):
            part = pairs[first : first + CHUNK]
            motion = se3.inverse(world_from_cams[part[:, 0]]) @ world_from_cams[part[:, 1]]
            result[first : first + CHUNK] = self.overlap_of(part, motion)
        return result

    def overlap_of(self, pairs: np.ndarray, a_from_b: np.ndarray) -> np.ndarray:
        """The same for given motions (p, 4, 4) between the frames of each pair (p, 2)."""
        motion = np.ascontiguousarray(a_from_b, dtype=np.float64)
        return _overlap(self.points_cam, self.half_view, motion, pairs.astype(np.int64))


def sample_views(points_cam: list[np.ndarray], cameras: tuple[Camera, ...]) -> ViewSamples:
    """Samples of lifted keypoints, each (k, 3) m, evenly taken from the list of each frame."""
    n = len(points_cam)
    samples = np.full((n, N_POINTS, 3), np.nan)
    for i, points in enumerate(points_cam):
        if len(points):
            taken = np.unique(np.linspace(0, len(points) - 1, N_POINTS).astype(int))
            samples[i, : len(taken)] = points[taken]
    borders = np.array(
        [
            [
                [(-MARGIN * c.width - c.cx) / c.fx, ((1 + MARGIN) * c.width - c.cx) / c.fx],
                [(-MARGIN * c.height - c.cy) / c.fy, ((1 + MARGIN) * c.height - c.cy) / c.fy],
            ]
            for c in cameras
        ]
    )
    return ViewSamples(samples, borders)


@numba.njit(cache=True, nogil=True)
def _overlap(
    points: np.ndarray, borders: np.ndarray, a_from_b: np.ndarray, pairs: np.ndarray
) -> np.ndarray:
    result = np.zeros(len(pairs))
    for k in range(len(pairs)):
        i, j = pairs[k]
        turn, shift = a_from_b[k, :3, :3], a_from_b[k, :3, 3]
        back = np.zeros(3)
        for r in range(3):
            back[r] = -(turn[0, r] * shift[0] + turn[1, r] * shift[1] + turn[2, r] * shift[2])
        result[k] = min(
            _shown(points[j], turn, shift, borders[i]), _shown(points[i], turn.T, back, borders[j])
        )
    return result


@numba.njit(cache=True, nogil=True)
def _shown(points: np.ndarray, turn: np.ndarray, shift: np.ndarray, border: np.ndarray) -> float:
    """Share of points (s, 3), once turned and shifted, that lie within the borders of an image."""
    n, seen = 0, 0
    for p in points:
        if np.isnan(p[0]):
            continue
        n += 1
        z = turn[2, 0] * p[0] + turn[2, 1] * p[1] + turn[2, 2] * p[2] + shift[2]
        if z > 0.1:
            x = (turn[0, 0] * p[0] + turn[0, 1] * p[1] + turn[0, 2] * p[2] + shift[0]) / z
            y = (turn[1, 0] * p[0] + turn[1, 1] * p[1] + turn[1, 2] * p[2] + shift[1]) / z
            if border[0, 0] < x < border[0, 1] and border[1, 0] < y < border[1, 1]:
                seen += 1
    return seen / n if n > 0 else 0.0
