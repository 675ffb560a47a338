"""Places seen again, each judged by a solve that did without them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from planfit.evaluation import match_distances
from planfit.pipeline.folds import NOT_KEPT_OUT, Folds
from planfit.pipeline.prepare import PreparedScan


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


def judge_visits(
    prepared: PreparedScan,
    folds: Folds,
    recorded: Float[np.ndarray, "k 4 4"],
    by_fold: Sequence[Float[np.ndarray, "k 4 4"]],
    solved: Float[np.ndarray, "k 4 4"],
) -> tuple[Visit, ...]:
    """Each visit by the fold that kept it out.

    Args:
        prepared: the scan.
        folds: which visits each fold kept out.
        recorded: poses of the keyframes as recorded.
        by_fold: the same as each fold solved for them.
        solved: the same by the result.
    """
    matches = prepared.measurements.matches
    sizes = np.diff(matches.start)
    fold_of_match = np.repeat(folds.of_pairs, sizes)
    visit_of_match = np.repeat(folds.visit, sizes)
    before_m, after_m = match_distances(matches, recorded), match_distances(matches, solved)
    kept_out_m = after_m.copy()
    for fold, poses in enumerate(by_fold):
        own = matches.of_pairs(folds.of_pairs == fold)
        kept_out_m[fold_of_match == fold] = match_distances(own, poses)
    # Sorted by visit, a visit's matches are a run; those of no visit stand before the first.
    order = np.argsort(visit_of_match, kind="stable")
    n_visits = int(folds.visit.max(initial=NOT_KEPT_OUT)) + 1
    borders = np.searchsorted(visit_of_match[order], np.arange(n_visits + 1))
    pair_of_match = np.repeat(np.arange(len(sizes)), sizes)
    steps_m = np.linalg.norm(np.diff(solved[:, :3, 3], axis=0), axis=1)
    walked_m = np.concatenate([[0.0], np.cumsum(steps_m)])[matches.pairs]
    way_m = np.abs(walked_m[:, 1] - walked_m[:, 0])[pair_of_match]
    visits = []
    for k in range(n_visits):
        own = order[borders[k] : borders[k + 1]]
        if len(own) == 0:  # frames that surfaces alone brought together
            continue
        a, b = folds.stretch[matches.pairs[pair_of_match[own[0]]]]
        medians = (float(np.median(each[own])) for each in (before_m, kept_out_m, after_m))
        visits.append(
            Visit(
                frames_of_stretch(prepared, folds, a),
                frames_of_stretch(prepared, folds, b),
                *medians,
                mean_m=float(np.mean(after_m[own])),
                n_points=len(own),
                way_m=float(np.median(way_m[own])),
            )
        )
    return tuple(visits)


def frames_of_stretch(
    prepared: PreparedScan, folds: Folds, stretch: int | np.integer
) -> tuple[int, int]:
    """First and last frame of a stretch, as numbered in the scan."""
    own: Int[np.ndarray, " k"] = prepared.keyframes.frame_idx[folds.stretch == stretch]
    return int(own[0]), int(own[-1])
