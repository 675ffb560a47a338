"""What matches should be: which frames are covisible, which places were visited again, which matches hold."""

from dataclasses import dataclass

import numpy as np
from matching_scans import TestScan
from scipy.ndimage import binary_dilation

from planfit.geometry import se3
from planfit.matching import Matches

MIN_OVERLAP = 0.5
"""Share of either view that the other must show."""
MIN_APART = 30
"""Frames between two visits."""
CELL_M = 1.5
"""Places are squares of this size about what the camera looks at, and eighths of the compass."""
NEAR = 3
"""Of many frames that show the same only some are tried: a verified pair stands for those so near to it."""
VISIT_FRAMES = 30
"""A place seen by frames further apart than this was visited twice."""


@dataclass(frozen=True)
class Revisits:
    """Pairs of frames, far apart in time, that show the same."""

    pairs: np.ndarray  # (p, 2)
    covisibility: np.ndarray  # (p,)
    place: np.ndarray  # (p,) number of the place of the first frame
    visit: np.ndarray  # (p,) number of (place, first visit, second visit)


@dataclass(frozen=True)
class Quality:
    """How good a set of verified matches is."""

    precision: float
    """Share of matches whose true distance is below three sigmas."""
    wrong_pairs: int
    """Verified pairs most of whose matches are wrong."""
    n_pairs: int
    place_recall: float
    """Share of places visited again of which some pair was verified."""
    place_recall_near: float
    """The same, counting verified pairs up to `NEAR` frames from a covisible one."""
    visit_recall: float
    """Share of each two visits of a place of which some pair was verified, up to `NEAR` frames off."""
    n_places: int
    n_visits: int
    merged: int
    """Verified pairs across two look-alike wings."""


def find_revisits(test: TestScan) -> Revisits:
    """Every pair of covisible views, by projecting the depth of one into the other."""
    true, scan = test.true_world_from_cams, test.scan
    n = len(scan)
    camera = scan.cameras[0]
    rows, columns = np.mgrid[8 : camera.height : 16, 8 : camera.width : 16]
    uv = np.stack([columns.ravel(), rows.ravel()], axis=1).astype(float)
    depths = [scan.files.depth(i) for i in range(n)]
    clouds = [camera.lift(uv, d[rows.ravel(), columns.ravel()]) for d in depths]
    share = np.zeros((n, n), dtype=np.float32)
    centres, forward = true[:, :3, 3], true[:, :3, 2]
    near = np.linalg.norm(centres[:, None] - centres, axis=2) < 5.0
    near &= forward @ forward.T > np.cos(np.deg2rad(60.0))
    cams_from_world = se3.inverse(true)
    for i in range(n):
        points = clouds[i][np.isfinite(clouds[i][:, 2])]
        if len(points) < 0.3 * len(uv):
            continue
        world = se3.transform(true[i], points)
        for j in np.flatnonzero(near[i]):
            if abs(i - j) <= MIN_APART:
                continue
            seen = se3.transform(cams_from_world[j], world)
            ahead = seen[:, 2] > 0.2
            at = np.rint(camera.project(seen[ahead])).astype(int)
            inside = (at >= 0).all(axis=1) & (at[:, 0] < camera.width) & (at[:, 1] < camera.height)
            there = depths[j][at[inside, 1], at[inside, 0]]
            z = seen[ahead][inside, 2]
            share[i, j] = np.sum(np.abs(there - z) < 0.05 * z) / len(uv)
    both = np.minimum(share, share.T)
    i, j = np.nonzero(np.triu(both > MIN_OVERLAP))
    ahead = centres + 1.5 * forward
    # The vertical of the world is y.
    cell = np.floor(ahead[:, [0, 2]] / CELL_M).astype(int)
    compass = np.floor(np.arctan2(forward[:, 2], forward[:, 0]) / (np.pi / 4)).astype(int)
    place = _numbered(np.column_stack([cell, compass])[i])
    visit = _numbered(np.column_stack([place, i // VISIT_FRAMES, j // VISIT_FRAMES]))
    return Revisits(np.column_stack([i, j]), both[i, j], place, visit)


def judge(test: TestScan, matches: Matches, revisits: Revisits) -> Quality:
    """Metrics of a set of verified matches."""
    sizes = np.diff(matches.start)
    a, b = (np.repeat(matches.pairs[:, k], sizes) for k in range(2))
    true = test.true_world_from_cams
    world = [
        np.einsum("nij,nj->ni", true[idx, :3, :3], points) + true[idx, :3, 3]
        for idx, points in ((a, matches.points_a), (b, matches.points_b))
    ]
    holds = np.linalg.norm(world[0] - world[1], axis=1) < 3 * matches.sigma
    pair = np.repeat(np.arange(len(sizes)), sizes)
    share = np.bincount(pair, holds, len(sizes)) / np.maximum(sizes, 1)
    verified = set(map(tuple, matches.pairs[share > 0.5].tolist()))
    is_found = np.array([tuple(p) in verified for p in revisits.pairs.tolist()], dtype=bool)
    n = len(true)
    grid = np.zeros((n, n), dtype=bool)
    right = matches.pairs[share > 0.5]
    far = right[right[:, 1] - right[:, 0] > MIN_APART - 2 * NEAR]
    grid[far[:, 0], far[:, 1]] = True
    grid = binary_dilation(grid, np.ones((2 * NEAR + 1, 2 * NEAR + 1)))
    is_near = grid[revisits.pairs[:, 0], revisits.pairs[:, 1]]
    wings = test.wing[matches.pairs]
    return Quality(
        precision=float(holds.mean()) if len(holds) else 1.0,
        wrong_pairs=int(np.sum(share <= 0.5)),
        n_pairs=len(sizes),
        place_recall=_recall(revisits.place, is_found),
        place_recall_near=_recall(revisits.place, is_near),
        visit_recall=_recall(revisits.visit, is_near),
        n_places=len(np.unique(revisits.place)),
        n_visits=len(np.unique(revisits.visit)),
        merged=int(np.sum((wings >= 0).all(axis=1) & (wings[:, 0] != wings[:, 1]))),
    )


def _recall(group: np.ndarray, is_found: np.ndarray) -> float:
    if len(group) == 0:
        return 1.0
    return float(np.mean(np.bincount(group, is_found) > 0))


def _numbered(rows: np.ndarray) -> np.ndarray:
    if len(rows) == 0:
        return np.zeros(0, dtype=int)
    return np.unique(rows, axis=0, return_inverse=True)[1].ravel()
