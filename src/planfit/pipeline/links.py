"""Links of the registration: stretches of the walk that see the same, by how much they overlap and agree."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from planfit.evaluation import match_distances
from planfit.geometry import se3
from planfit.matching import Matches, SurfacePairs
from planfit.pipeline.folds import FoldedSolves
from planfit.runtime import let_go
from planfit.segmentation import LevelPoints, Structure

CUBE_M = 0.15
"""Side of the cubes by whose centres stretches are compared, so that surface counts by its area."""
WITHIN_CUBES = 2.0
"""One cube alone would part a floor that lies on the border of two; these are 0.3 m, narrow beside a room."""
AXIS_BITS = 16
"""Of a cube's number along each axis: 10 km."""

Poses = Float[np.ndarray, "k 4 4"]


@dataclass(frozen=True)
class Visit:
    """All pairs of frames between two stretches of the walk, judged by a solve that did without them."""

    first_frames: tuple[int, int]
    """First and last frame of the earlier stretch, as numbered in the scan."""
    last_frames: tuple[int, int]
    """First and last frame of the later one."""
    before_m: float
    """Median distance between the two sightings of a point, poses as recorded."""
    kept_out_m: float
    """The same by the solve that did without this visit."""
    after_m: float
    """The same by the result."""
    mean_m: float
    """Mean distance instead, by the result."""
    n_points: int
    """Points that were seen both times."""
    way_m: float
    """Length of the way walked between both: median over those points, by the result."""


@dataclass(frozen=True)
class Link:
    """Two stretches of the walk that matched keypoints or surfaces hold together."""

    first_frames: tuple[int, int]
    """First and last frame of the earlier stretch, as numbered in the scan."""
    last_frames: tuple[int, int]
    """Of the later one; neighbours, unless a place was seen again."""
    overlap: float
    """Of the floor, walls and ceiling of the stretch that sees less of them, the share within `WITHIN_CUBES`
    of some of the other, poses of the result; NaN where either sees none."""
    before_m: float
    """Mean distance between the two sightings of a point, poses as recorded; by surfaces alone, how far their
    motion is from that of the poses, in the directions that they hold."""
    after_m: float
    """The same by the result."""
    n_points: int
    """Points that both saw; 0 where surfaces alone hold them together."""
    n_pairs: int
    """Pairs of frames, by keypoints and by surfaces."""


def judge_links(solves: FoldedSolves) -> tuple[Link, ...]:
    """Every two stretches that pairs of frames hold together, in the order of the walk."""
    folds, measurements, n = solves.folds, solves.prepared.measurements, solves.folds.n_stretches
    matches, surfaces = measurements.matches, measurements.surfaces
    has_points = np.flatnonzero(np.diff(matches.start) > 0)
    by_points = _by_link(matches.pairs[has_points], folds.stretch, n)
    by_surfaces = _by_link(surfaces.pairs, folds.stretch, n)
    cubes = _cubes_seen(measurements.structure, solves.solved, folds.stretch, n)
    none = np.zeros(0, dtype=int)
    links = []
    for cell in sorted({*by_points, *by_surfaces}):
        a, b = divmod(cell, n)
        own = matches.taken(has_points[by_points.get(cell, none)])
        pairs = surfaces[by_surfaces.get(cell, none)]
        before_m, after_m = (
            _mean_off_m(own, pairs, poses) for poses in (solves.recorded, solves.solved)
        )
        links.append(
            Link(
                solves.frames_of(a),
                solves.frames_of(b),
                _overlap(cubes[a], cubes[b]),
                before_m,
                after_m,
                own.n_matches,
                len(own.pairs) + len(pairs),
            )
        )
    return tuple(links)


def _mean_off_m(own: Matches, pairs: SurfacePairs, poses: Poses) -> float:
    """Between matched points; where there are none, by what surfaces hold."""
    return float(np.mean(match_distances(own, poses) if own.n_matches else pairs.held_off_m(poses)))


def _by_link(
    pairs: Int[np.ndarray, "p 2"], stretch: Int[np.ndarray, " k"], n: int
) -> dict[int, Int[np.ndarray, " q"]]:
    """Pairs of frames of each link, which is numbered first stretch times n plus second."""
    a, b = stretch[pairs].reshape(-1, 2).T
    cell = a * n + b
    between = np.flatnonzero(a != b)
    order = between[np.argsort(cell[between], kind="stable")]
    cells, start = np.unique(cell[order], return_index=True)
    borders = pairwise([*start.tolist(), len(order)])
    return {int(c): order[i:j] for c, (i, j) in zip(cells, borders, strict=True)}


def _overlap(a: Int[np.ndarray, "c 3"], b: Int[np.ndarray, "d 3"]) -> float:
    """Of two stretches, whose cubes these are."""
    less, more = sorted((a, b), key=len)
    if len(less) == 0:
        return float("nan")
    distance, _ = cKDTree(more).query(less, distance_upper_bound=WITHIN_CUBES + 0.5)
    return float(np.mean(distance <= WITHIN_CUBES))


def _cubes_seen(
    structure: Structure, solved: Poses, stretch: Int[np.ndarray, " k"], n: int
) -> list[Int[np.ndarray, "c 3"]]:
    """Cubes in which each stretch sees floor, wall, ceiling or column, numbered along each axis."""
    origin = solved[:, :3, 3].mean(axis=0)
    parts = [np.zeros(0, dtype=np.int64)]  # of neighbouring frames, which see the same: few a part
    for points, frames in _points_in_parts(structure):
        at = (se3.transform_each(solved[frames], points) - origin) / CUBE_M
        half = 1 << (AXIS_BITS - 1)
        x, y, z = (np.floor(at).clip(-half, half - 1).astype(np.int64) + half).T
        # One number for stretch and cube, the stretch first: sorted, each stretch is a run of them.
        number = (((stretch[frames] << AXIS_BITS) + x << AXIS_BITS) + y << AXIS_BITS) + z
        parts.append(np.unique(number))
        let_go(points)
    seen = np.unique(np.concatenate(parts))
    borders = np.searchsorted(seen, np.arange(n + 1) << 3 * AXIS_BITS)
    shifts = np.array([2, 1, 0]) * AXIS_BITS
    runs = pairwise(borders.tolist())
    return [(seen[i:j, None] >> shifts) & ((1 << AXIS_BITS) - 1) for i, j in runs]


def _points_in_parts(
    structure: Structure,
) -> Iterator[tuple[Float[np.ndarray, "m 3"], Int[np.ndarray, " m"]]]:
    """Points of level surfaces and of upright patches, some at a time, and the frame of each."""
    for surface in (structure.floor, structure.ceiling, structure.walls, structure.columns):
        for part, group in se3.points_in_parts(surface.start):
            is_level = isinstance(surface, LevelPoints)
            yield surface.points_cam[part], group if is_level else surface.frame_idx[group]


def judge_visits(solves: FoldedSolves) -> tuple[Visit, ...]:
    """Each visit by the fold that kept it out."""
    matches, folds, solved = solves.prepared.measurements.matches, solves.folds, solves.solved
    steps_m = np.linalg.norm(np.diff(solved[:, :3, 3], axis=0), axis=1)
    walked_m = np.concatenate([[0.0], np.cumsum(steps_m)])
    visits = []
    # Visit by visit: numbers for each match of the scan would take as much memory as the matches.
    for pairs in folds.pairs_of_visits:
        own = matches.taken(pairs)
        if own.n_matches == 0:  # frames that surfaces alone brought together
            continue
        a, b = folds.stretch[own.pairs[0]]
        kept_out = solves.by_fold[int(folds.of_pairs[pairs[0]])]
        before_m, kept_out_m, after_m = (
            match_distances(own, poses) for poses in (solves.recorded, kept_out, solved)
        )
        way_m = np.abs(np.diff(walked_m[own.pairs], axis=1)[:, 0])
        visits.append(
            Visit(
                solves.frames_of(a),
                solves.frames_of(b),
                *(float(np.median(each)) for each in (before_m, kept_out_m, after_m)),
                mean_m=float(np.mean(after_m)),
                n_points=own.n_matches,
                way_m=float(np.median(np.repeat(way_m, np.diff(own.start)))),
            )
        )
    return tuple(visits)
