"""Places seen again, each judged by a solve that did without them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from planfit.evaluation import match_distances
from planfit.pipeline.folds import Folds
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
    steps_m = np.linalg.norm(np.diff(solved[:, :3, 3], axis=0), axis=1)
    walked_m = np.concatenate([[0.0], np.cumsum(steps_m)])
    visits = []
    # Visit by visit: numbers for each match of the scan would take as much memory as the matches.
    for pairs in folds.pairs_of_visits:
        own = matches.taken(pairs)
        if own.n_matches == 0:  # frames that surfaces alone brought together
            continue
        a, b = folds.stretch[own.pairs[0]]
        kept_out = by_fold[int(folds.of_pairs[pairs[0]])]
        before_m, kept_out_m, after_m = (
            match_distances(own, poses) for poses in (recorded, kept_out, solved)
        )
        way_m = np.abs(np.diff(walked_m[own.pairs], axis=1)[:, 0])
        visits.append(
            Visit(
                frames_of_stretch(prepared, folds, a),
                frames_of_stretch(prepared, folds, b),
                *(float(np.median(each)) for each in (before_m, kept_out_m, after_m)),
                mean_m=float(np.mean(after_m)),
                n_points=own.n_matches,
                way_m=float(np.median(np.repeat(way_m, np.diff(own.start)))),
            )
        )
    return tuple(visits)


def frames_of_stretch(
    prepared: PreparedScan, folds: Folds, stretch: int | np.integer
) -> tuple[int, int]:
    """First and last frame of a stretch, as numbered in the scan."""
    own: Int[np.ndarray, " k"] = prepared.keyframes.frame_idx[folds.stretch == stretch]
    return int(own[0]), int(own[-1])
