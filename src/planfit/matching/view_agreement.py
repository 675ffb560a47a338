"""Dense agreement: how much of two views the motion between them explains.

Keypoints of one poster agree wherever that poster hangs. The rest of the views tells: under the true motion
the surfaces of one view lie where the other sees them, and look alike there. Where the other camera looks
past a place at which this one saw a surface, one of them is elsewhere; a place hidden by something nearer
says nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.geometry import se3
from planfit.matching.agreement_kernels import compare_views
from planfit.matching.types import RelativePoses
from planfit.matching.view_grids import COLUMNS, ROWS, ViewGrids
from planfit.runtime import for_kernels, in_threads, let_go

BLOCK = 8
"""Greys are compared outside the blocks, of this many cells a side, with a matched keypoint."""
PAIRS_AT_A_TIME = 512
"""Views are compared in parts of so many pairs: what is needed of their matches takes 0.2 kB a match."""
MAX_OBSERVATIONS = 40.0
"""Effective observations that the matches of a pair are worth at most, as in the adjustment."""


BASE_M, PER_M = 0.06, 0.03
"""Departure in depth that is always allowed, m, and what it grows by with depth."""
SIGMAS_OF_ROTATION = 0.5
"""Growth of that departure with the standard deviation of the motion's rotation, times the distance from the
keypoints. Small, so that the motions of small objects are doubted."""
MAX_CONTRADICTED = 0.03
"""Share of what both views could see that the other looks past, from which on the motion explains nothing,
where depth is exact."""
USUAL_FACTOR = 1.5
"""The same as a multiple of what 95 % of the neighbouring frames stay below, where depth is not exact.
ConSLAM's interpolated depth: 13 %; a time-of-flight camera: 0.5 %."""
MAX_CONTRADICTED_BETWEEN = 0.5
"""`MAX_CONTRADICTED` of views of two scans of one building, between which things may have been moved. With
all furniture changed, right motions in a synthetic flat are contradicted by 8 % (median) and 27 % (19 of
20)."""


@dataclass(frozen=True)
class Agreement:
    """Of the views of each pair, both ways together."""

    matched: Float[np.ndarray, " p"]
    """Share of the views that the matches spread over."""
    contradicted: Float[np.ndarray, " p"]
    """Share of the cells that both could see at which one looks past the other's surface."""
    likeness: Float[np.ndarray, " p"]
    """Correlation of the greys where the surfaces agree, away from the matches; none is 0."""
    shared: Float[np.ndarray, " p"]
    """Share of the cells that both could see."""

    def rest_explained(
        self, is_neighbour: Bool[np.ndarray, " p"], max_contradicted: float
    ) -> Float[np.ndarray, " p"]:
        """What is not contradicted, times the likeness of what was not matched, 0 to 1.

        Args:
            is_neighbour: pairs whose motion is surely right: they say how exact depth is.
            max_contradicted: share from which on a motion explains nothing, where depth is exact.
        """
        most = max_contradicted
        if is_neighbour.any():
            usual = float(np.percentile(self.contradicted[is_neighbour], 95))
            most = max(most, USUAL_FACTOR * usual)
        return np.clip(1.0 - self.contradicted / most, 0.0, 1.0) * self.likeness


def explained_shares(
    relative_poses: RelativePoses,
    points_a: Sequence[Float[np.ndarray, "_ 3"]],
    points_b: Sequence[Float[np.ndarray, "_ 3"]],
    sigma_m: Float[np.ndarray, " p"],
    is_neighbour: Bool[np.ndarray, " p"],
    grids: ViewGrids,
    max_contradicted: float,
) -> Float[np.ndarray, " p"]:
    """How much of both views each motion explains, 0 (nothing, or it is contradicted) to 1.

    The share of the views with matches, less what is contradicted, times the likeness of the rest.

    Args:
        relative_poses: verified.
        points_a, points_b: m, matched points of each, camera frames.
        sigma_m: standard deviation of a match of each pair, m, each axis.
        is_neighbour: pairs whose motion is surely right: they say how exact depth is.
        grids: what all frames show.
        max_contradicted: see `Agreement.rest_explained`.
    """
    found = compare(relative_poses, points_a, points_b, sigma_m, grids)
    return found.matched * found.rest_explained(is_neighbour, max_contradicted)


def compare(
    relative_poses: RelativePoses,
    points_a: Sequence[Float[np.ndarray, "_ 3"]],
    points_b: Sequence[Float[np.ndarray, "_ 3"]],
    sigma_m: Float[np.ndarray, " p"],
    grids: ViewGrids,
) -> Agreement:
    """Project either view of each pair into the other; arguments as of `explained_shares`."""

    def of(first: int) -> tuple[np.ndarray, ...]:
        part = slice(first, first + PAIRS_AT_A_TIME)
        ends = relative_poses.pairs[part], relative_poses.a_from_b[part]
        return _compare(*ends, points_a[part], points_b[part], sigma_m[part], grids)

    parts = in_threads(of, range(0, max(len(relative_poses), 1), PAIRS_AT_A_TIME))
    return Agreement(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def _compare(
    pairs: Int[np.ndarray, "p 2"],
    motions: Float[np.ndarray, "p 4 4"],
    points_a: Sequence[Float[np.ndarray, "_ 3"]],
    points_b: Sequence[Float[np.ndarray, "_ 3"]],
    sigma_m: Float[np.ndarray, " p"],
    grids: ViewGrids,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The parts of an `Agreement`, of some pairs."""
    tolerance = np.array([BASE_M, PER_M, SIGMAS_OF_ROTATION])
    matched, cells, likeness = [], [], []
    for ends, motion, points in (
        (pairs, motions, points_a),
        (pairs[:, ::-1], se3.inverse(motions), points_b),
    ):
        is_matched = _matched_blocks(ends[:, 0], points, grids)
        middle, sigma_rotation = _spread(points, sigma_m)
        counts = compare_views(
            np.ascontiguousarray(ends, dtype=np.int64),
            np.ascontiguousarray(motion, dtype=float),
            sigma_rotation,
            middle,
            is_matched,
            for_kernels(grids.depth_m),
            grids.grey,
            grids.cameras,
            tolerance,
        )
        let_go(grids.depth_m)
        matched.append(_covered(ends[:, 0], points, grids))
        cells.append(counts[:, :2])
        likeness.append(counts[:, 2])
    n_agreeing, n_past = np.sum(cells, axis=0).T
    return (
        np.mean(matched, axis=0),
        n_past / np.maximum(n_agreeing + n_past, 1),
        np.clip(np.mean(likeness, axis=0), 0.0, 1.0),
        (n_agreeing + n_past) / (2 * ROWS * COLUMNS),
    )


def _covered(
    frame_idx: np.ndarray, points: Sequence[np.ndarray], grids: ViewGrids
) -> Float[np.ndarray, " p"]:
    """Share of the view of each frame that its matched points (m, camera frame) spread over.

    The area of the rectangle, evenly filled, that has their covariance: a side L has the variance L^2 / 12.
    """
    size = np.array([len(p) for p in points], dtype=int)
    if len(points) == 0:
        return np.zeros(0)
    start = np.concatenate([[0], np.cumsum(size)[:-1]])
    every = np.concatenate(list(points)).astype(float)
    fx, fy, _, _ = np.repeat(grids.cameras[frame_idx], size, axis=0).T
    cell = np.column_stack([fx * every[:, 0], fy * every[:, 1]]) / every[:, 2:]
    off = cell - np.repeat(np.add.reduceat(cell, start) / size[:, None], size, axis=0)
    covariance = np.add.reduceat(off[:, :, None] * off[:, None, :], start) / size[:, None, None]
    area = 12.0 * np.sqrt(np.maximum(np.linalg.det(covariance), 0.0))
    return np.minimum(area / (ROWS * COLUMNS), 1.0)


def _matched_blocks(
    frame_idx: np.ndarray, points: Sequence[np.ndarray], grids: ViewGrids
) -> Bool[np.ndarray, "p r c"]:
    """Blocks of the view of each frame that a matched point (m, camera frame) lies in."""
    pair = np.repeat(np.arange(len(points)), [len(p) for p in points])
    every = np.concatenate([np.zeros((0, 3)), *points])
    fx, fy, cx, cy = grids.cameras[frame_idx[pair]].T
    column = np.rint(fx * every[:, 0] / every[:, 2] + cx).astype(int).clip(0, COLUMNS - 1)
    row = np.rint(fy * every[:, 1] / every[:, 2] + cy).astype(int).clip(0, ROWS - 1)
    is_matched = np.zeros((len(points), ROWS // BLOCK, COLUMNS // BLOCK), dtype=bool)
    is_matched[pair, row // BLOCK, column // BLOCK] = True
    return is_matched


def _spread(
    points: Sequence[np.ndarray], sigma_m: np.ndarray
) -> tuple[Float[np.ndarray, "p 3"], Float[np.ndarray, " p"]]:
    """Middle (m) of the points of each pair, and the sigma (rad) of a motion's rotation from them.

    Points of a small object hold a rotation by their spread across: the second of its three extents.
    """
    size = np.array([len(p) for p in points])
    start = np.concatenate([[0], np.cumsum(size)[:-1]]).astype(int)
    if len(points) == 0:
        return np.zeros((0, 3)), np.zeros(0)
    every = np.concatenate(list(points)).astype(float)
    middle = np.add.reduceat(every, start) / size[:, None]
    off = every - np.repeat(middle, size, axis=0)
    covariance = np.add.reduceat(off[:, :, None] * off[:, None, :], start) / size[:, None, None]
    extent = np.linalg.eigvalsh(covariance)[:, 1]
    n_effective = np.minimum(size, MAX_OBSERVATIONS)
    return middle, sigma_m / np.sqrt(n_effective * np.maximum(extent, 1e-4))
