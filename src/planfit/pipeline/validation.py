"""Never make it worse: held-out matches, wall on the plan, and misfit, before and after the solve."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from planfit.evaluation import NEAR_FACE_M, median_match_distance, wall_distances
from planfit.floorplan import Floorplan
from planfit.matching import Matches
from planfit.segmentation import Structure

MIN_HELD_OUT = 30
"""The median distance of fewer held-out matches tells too little."""
MAX_INCONSISTENCY = 1.25
"""Cost of matches, floor and odometry with the wall terms over that without. Measured on synthetic scans and
ConSLAM: right plans 1.00 to 1.05, plans of other buildings mostly 1.1 to 1.9."""


@dataclass(frozen=True)
class Check:
    """One number that should not get worse."""

    name: str
    before: float
    after: float
    unit: str
    is_worse: bool
    advice: str = "do not use these poses without looking at the report"
    """What to do where it got worse."""


def hold_out(matches: Matches, share: float, rng: np.random.Generator) -> tuple[Matches, Matches]:
    """Split matches at random, within every pair: those to solve with, and those held out."""
    held = rng.random(matches.n_matches) < share
    return _keep(matches, ~held), _keep(matches, held)


def match_check(
    held_out: Matches,
    before_from_cams: Float[np.ndarray, "n 4 4"],
    after_from_cams: Float[np.ndarray, "n 4 4"],
) -> Check | None:
    """Median distance between held-out matched points; None where there are too few to tell."""
    if held_out.n_matches < MIN_HELD_OUT:
        return None
    first = median_match_distance(held_out, before_from_cams)
    last = median_match_distance(held_out, after_from_cams)
    return Check("held-out matches, median distance", first, last, "m", last > 1.02 * first)


def wall_check(
    structure: Structure,
    floorplan: Floorplan,
    before_from_cams: Float[np.ndarray, "n 4 4"],
    after_from_cams: Float[np.ndarray, "n 4 4"],
    workers: int = 1,
) -> Check | None:
    """Share of wall points near a face of the plan; None where no flat wall was seen."""
    if not structure.has_walls:
        return None
    before = wall_distances(structure, floorplan, before_from_cams, workers)
    after = wall_distances(structure, floorplan, after_from_cams, workers)
    if before is None or after is None:
        return None
    name = f"wall points within {NEAR_FACE_M:g} m of the plan"
    is_worse = after.near_share < before.near_share - 0.01
    return Check(name, before.near_share, after.near_share, "share", is_worse)


def consistency_check(cost_without: float, cost_with: float, n_frames: int) -> Check | None:
    """Whether plan and scan contradict each other; None where they do not.

    Args:
        cost_without: cost of the terms that need no plan, loops closed, solved without the wall terms.
        cost_with: the same, solved with the wall terms.
        n_frames: at least three a frame are allowed for `cost_without`, which is what correcting
            drift by walls costs a trajectory that nothing else corrects.
    """
    ratio = cost_with / max(cost_without, 3.0 * n_frames)
    if ratio <= MAX_INCONSISTENCY:
        return None
    return Check(
        "misfit of matches and odometry, without and with the walls of the plan,",
        1.0,
        ratio,
        "times",
        is_worse=True,
        advice="the plan may differ from the building where the report shows large distances, or "
        "be of another place",
    )


def _keep(matches: Matches, keep: Bool[np.ndarray, " m"]) -> Matches:
    """Some of the matches; pairs of frames that keep none are dropped."""
    # The matches of a pair follow each other: sums over the ranges that begin at `start` count what each
    # pair keeps. (reduceat refuses an empty list of ranges.)
    sizes = np.zeros(0, dtype=int)
    if len(matches.pairs):
        sizes = np.add.reduceat(keep.astype(int), matches.start[:-1])
    some = sizes > 0
    return replace(
        matches,
        pairs=matches.pairs[some],
        start=np.cumsum([0, *sizes[some]]),
        points_a=matches.points_a[keep],
        points_b=matches.points_b[keep],
        sigma=matches.sigma[keep],
    )
