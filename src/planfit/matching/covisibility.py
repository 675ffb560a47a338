"""Covisibility of two frames: how much of one view the other shows.

Guessed from a few lifted keypoints a frame, and from recorded poses or a motion between the two.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from planfit.geometry import se3
from planfit.geometry.camera import Camera
from planfit.geometry.se3 import Poses
from planfit.matching.pair_kernels import covisible_share
from planfit.matching.types import Rows

N_POINTS = 24
"""Points of each frame; a share of 24 is known to a tenth, and drift spoils more than that."""
CHUNK = 100_000
"""Pairs looked at together: 24 points of 8 bytes each, three coordinates, are 58 MB."""
MARGIN = 0.15
"""Points this share of the image beyond its border count too: drift of a few degrees moves as much."""


@dataclass(frozen=True)
class ViewSamples(Rows):
    """A few points that each frame shows."""

    points_cam: Float[np.ndarray, "n s 3"]
    """m, camera frame; NaN where a frame has fewer."""
    bounds: Float[np.ndarray, "n 2 2"]
    """Smallest and largest x / z, and y / z, that a frame shows."""

    def covisibility(
        self, world_from_cams: Poses, pairs: Int[np.ndarray, "p 2"]
    ) -> Float[np.ndarray, " p"]:
        """Share of the points of either frame of a pair that the other shows, the smaller of the two."""
        result = np.zeros(len(pairs))
        for first in range(0, len(pairs), CHUNK):
            part = pairs[first : first + CHUNK]
            motion = se3.inverse(world_from_cams[part[:, 0]]) @ world_from_cams[part[:, 1]]
            result[first : first + CHUNK] = self.covisibility_by_motion(part, motion)
        return result

    def covisibility_by_motion(
        self, pairs: Int[np.ndarray, "p 2"], a_from_b: Float[np.ndarray, "p 4 4"]
    ) -> Float[np.ndarray, " p"]:
        """The same for given motions between the frames of each pair."""
        motion = np.ascontiguousarray(a_from_b, dtype=np.float64)
        return covisible_share(self.points_cam, self.bounds, motion, pairs.astype(np.int64))


def sample_views(
    points_cam: Sequence[Float[np.ndarray, "_ 3"]], cameras: Sequence[Camera]
) -> ViewSamples:
    """Samples of the lifted keypoints (m) of each frame, evenly taken from its list."""
    n = len(points_cam)
    samples = np.full((n, N_POINTS, 3), np.nan)
    for i, points in enumerate(points_cam):
        if len(points):
            taken = np.unique(np.linspace(0, len(points) - 1, N_POINTS).astype(int))
            samples[i, : len(taken)] = points[taken]
    bounds = np.array(
        [
            [
                [(-MARGIN * c.width - c.cx) / c.fx, ((1 + MARGIN) * c.width - c.cx) / c.fx],
                [(-MARGIN * c.height - c.cy) / c.fy, ((1 + MARGIN) * c.height - c.cy) / c.fy],
            ]
            for c in cameras
        ]
    )
    return ViewSamples(samples, bounds)
