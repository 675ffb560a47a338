"""What each judging solve does without: whole visits, and the wall of whole stretches of the walk.

Matches of one visit share what is wrong of it, and so do the patches of one wall: kept out one by one, the
rest of them still hold the poses where they are, right or wrong. So the walk is cut into stretches, a visit
being all pairs of frames between two of them, and each fold of a cross-validation keeps out whole visits and
all wall that whole stretches see."""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.adjust import AdjustOptions, Kept, Measurements, PlanAdjustment
from planfit.adjust.association import PlanCorrespondences, associate
from planfit.evaluation import NEAR_FACE_M
from planfit.floorplan import Floorplan
from planfit.pipeline.prepare import PreparedScan

STRETCH_M = 6.0
"""Path length of a stretch: a room, or a piece of a corridor, which the walls beside it hold as one."""
MIN_FRAMES = 6
"""Frames of a stretch at least."""
N_FOLDS = 5
"""Solves that each do without one part in so many of the visits and of the walls, which then judge it."""
BESIDE_M = 0.6
"""A wall patch this near to a face that looks the same way lies on it or beside it."""
NOT_KEPT_OUT = -1


@dataclass(frozen=True)
class Folds:
    """Which fold keeps out what; k frames that are solved for."""

    count: int
    stretch: Int[np.ndarray, " k"]
    """Stretch of the walk that each frame belongs to; increasing."""
    visit: Int[np.ndarray, " p"]
    """Visit that each pair of frames belongs to; `NOT_KEPT_OUT` within a stretch and between neighbours."""
    of_pairs: Int[np.ndarray, " p"]
    """Fold that keeps out each pair, `NOT_KEPT_OUT` where none does."""
    of_patches: Int[np.ndarray, " w"]
    """Fold that keeps out each wall patch."""
    of_surfaces: Int[np.ndarray, " q"]
    """Fold that keeps out each pair matched by its surfaces, as for other pairs of the same visit."""

    @property
    def n_stretches(self) -> int:
        """Stretches of the walk."""
        return int(self.stretch[-1]) + 1

    @cached_property
    def pairs_of_visits(self) -> tuple[Int[np.ndarray, " q"], ...]:
        """Pairs of frames of each visit, increasing; none for one that surfaces alone brought together."""
        order = np.argsort(self.visit, kind="stable")
        n_visits = int(self.visit.max(initial=NOT_KEPT_OUT)) + 1
        borders = np.searchsorted(self.visit[order], np.arange(n_visits + 1))
        return tuple(order[first:last] for first, last in pairwise(borders))


@dataclass(frozen=True)
class FoldedSolves:
    """A result of k keyframes, and its scan solved once more without what each fold keeps out."""

    prepared: PreparedScan
    adjustment: PlanAdjustment
    folds: Folds
    recorded: Float[np.ndarray, "k 4 4"]
    """Poses of the keyframes as recorded, in any frame."""
    by_fold: tuple[Float[np.ndarray, "k 4 4"], ...]
    """The same as each fold solved for them."""

    @property
    def solved(self) -> Float[np.ndarray, "k 4 4"]:
        """The same by the result."""
        return self.adjustment.solution.target_from_cams

    def frames_of(self, stretch: int | np.integer) -> tuple[int, int]:
        """First and last frame of a stretch of the walk, as numbered in the scan."""
        own: Int[np.ndarray, " k"] = self.prepared.keyframes.frame_idx[
            self.folds.stretch == stretch
        ]
        return int(own[0]), int(own[-1])


def choose_folds(
    measurements: Measurements,
    recorded_from_cams: Float[np.ndarray, "k 4 4"],
    count: int,
    rng: np.random.Generator,
) -> Folds:
    """Cut the walk into stretches, and deal visits and stretches out to folds.

    Args:
        count: folds, two or more.
    """
    stretch = cut_into_stretches(recorded_from_cams, count)
    n = int(stretch[-1]) + 1
    n_matched = len(measurements.matches.pairs)
    pairs = np.concatenate([measurements.matches.pairs, measurements.surfaces.pairs])
    first, last = stretch[pairs].T
    # A visit is a pair of stretches that do not follow each other, numbered without gaps.
    is_visit = last - first > 1
    cells, visit = np.unique((first * n + last)[is_visit], return_inverse=True)
    visit_of_pairs = np.full(len(first), NOT_KEPT_OUT)
    visit_of_pairs[is_visit] = visit
    fold_of_visit = _dealt(len(cells), count, rng)
    of_pairs = np.full(len(first), NOT_KEPT_OUT)
    of_pairs[is_visit] = fold_of_visit[visit]
    # Stretches that follow each other are kept out by different folds, so that both sides stay held.
    fold_of_stretch = (np.arange(n) + rng.integers(count)) % count
    of_patches = fold_of_stretch[stretch[measurements.structure.walls.frame_idx]]
    return Folds(
        count,
        stretch,
        visit_of_pairs[:n_matched],
        of_pairs[:n_matched],
        of_patches,
        of_pairs[n_matched:],
    )


def cut_into_stretches(
    recorded_from_cams: Float[np.ndarray, "k 4 4"], count: int
) -> Int[np.ndarray, " k"]:
    """Stretch of each frame: about `STRETCH_M` of path each, at least `count` where frames suffice."""
    n_frames = len(recorded_from_cams)
    steps_m = np.linalg.norm(np.diff(recorded_from_cams[:, :3, 3], axis=0), axis=1)
    # A metre a frame at most counts: a tracker that jumped has not walked there.
    walked_m = np.concatenate([[0.0], np.cumsum(np.minimum(steps_m, 1.0))])
    most = max(n_frames // MIN_FRAMES, 1)
    n = int(np.clip(walked_m[-1] / STRETCH_M, min(count, most), most))
    if walked_m[-1] <= 0.0:
        return np.arange(n_frames) * n // n_frames
    at = np.minimum((walked_m / walked_m[-1] * n).astype(int), n - 1)
    return np.unique(at, return_inverse=True)[1]  # stretches without a frame are left out


def without_fold(
    measurements: Measurements,
    correspondences: PlanCorrespondences | None,
    folds: Folds,
    fold: int,
) -> tuple[Measurements, PlanCorrespondences | None]:
    """Measurements and plan correspondences (None without a plan) without what one fold keeps out.

    Its matches and wall points are those of the whole, marked as to which take part: no point is copied.
    """
    kept = Kept(folds.of_pairs != fold, folds.of_patches != fold)
    measurements = replace(
        measurements, surfaces=measurements.surfaces[folds.of_surfaces != fold], kept=kept
    )
    if correspondences is None:
        return measurements, None
    return measurements, replace(correspondences, walls=correspondences.walls.only(kept.patches))


def _dealt(n: int, count: int, rng: np.random.Generator) -> Int[np.ndarray, " n"]:
    """Folds of n things: each fold gets as many, at random."""
    return rng.permutation(np.arange(n) % count)


def walls_near_plan(
    solves: FoldedSolves, floorplan: Floorplan | None, options: AdjustOptions
) -> Bool[np.ndarray, "w 3"] | None:
    """Of each wall patch: near a face as recorded, near one kept out, beside one kept out. None without a
    plan."""
    structure = solves.prepared.measurements.structure
    patches, storeys = structure.walls, structure.storeys
    if floorplan is None:
        return None

    # Whether wall is near a face does not depend on what else is nearer.
    each_patch = replace(options.association, mutual=False)

    def distances_m(poses: Float[np.ndarray, "k 4 4"]) -> Float[np.ndarray, " w"]:
        found = associate(patches, floorplan, poses, BESIDE_M, each_patch, storeys)
        return np.where(found.face_idx >= 0, np.abs(found.distance_m), np.inf)

    kept_out_m = np.full(len(patches), np.inf)
    for fold, poses in enumerate(solves.by_fold):
        is_out = solves.folds.of_patches == fold
        kept_out_m[is_out] = distances_m(poses)[is_out]
    is_near = kept_out_m < NEAR_FACE_M
    is_beside = ~is_near & (kept_out_m < BESIDE_M)
    return np.column_stack([distances_m(solves.recorded) < NEAR_FACE_M, is_near, is_beside])
