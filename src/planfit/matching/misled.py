"""Motions of neighbours that a repeating pattern misled: images choose between them and the recorded ones.

Where the same picture hangs four times on a wall, or on the next wall, keypoints of one agree with those of
the other: a motion a metre or a quarter turn off, with as many matches as the right one. It is doubted only
where measured and recorded motion contradict each other. Where the recorded motion has the two views overlap,
the rest of the views tells which of both is right. Where it does not, the recorded steps tell: who jumps does
so in one step, and a jump of that size among usual steps is long.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.geometry import se3
from planfit.matching.cycles import is_near, spans_any
from planfit.matching.relative_motions import NeighbourMotions, match_sigmas
from planfit.matching.view_agreement import MAX_CONTRADICTED, compare
from planfit.scan.odometry import LONG, Odometry, times_usual, usual_step

MIN_SHARED = 0.05
"""Share of the views that both could see by a motion, from which on they tell of it."""
CLEARLY = 0.1
"""A motion explains clearly more of two views than another by this share."""
MAX_USUAL = 1000
"""Of pairs whose motions agree, so many say what is usual. A walk of 25,000 frames has 38,000 of them, which
took a minute."""


def without_misled(
    known: NeighbourMotions,
    world_from_cams: Float[np.ndarray, "n 4 4"],
    odometry: Odometry,
) -> NeighbourMotions:
    """Leave out verified pairs where the recorded motion is the better explanation of both views.

    Args:
        known: neighbours that keypoints brought together.
        world_from_cams: recorded poses.
        odometry: how far they may be off.
    """
    verified = known.verified
    pairs, measured = verified.relative_poses.pairs, verified.relative_poses.a_from_b
    recorded = se3.inverse(world_from_cams[pairs[:, 0]]) @ world_from_cams[pairs[:, 1]]
    sigmas = odometry.sigma_between(*pairs.T)
    agrees = is_near(measured, recorded, sigmas)
    if agrees.all():
        return known
    is_asked = ~agrees
    usual = np.flatnonzero(agrees)
    is_asked[usual[:: max(1, -(-len(usual) // MAX_USUAL))]] = True
    asked = verified.where(is_asked)
    rest = match_sigmas(asked), known.keypoints.grids
    by_measured, by_recorded = (
        compare(
            replace(asked.relative_poses, a_from_b=motions[is_asked]),
            *(asked.points_a, asked.points_b),
            *rest,
        )
        for motions in (measured, recorded)
    )
    measured_share, recorded_share = (
        views.rest_explained(agrees[is_asked], MAX_CONTRADICTED)
        for views in (by_measured, by_recorded)
    )
    # By the views, where they share enough by the recorded motion; else, or where that is as good, by steps.
    tells = by_recorded.shared >= MIN_SHARED
    is_won = tells & (measured_share > recorded_share + CLEARLY)
    is_lost = tells & (recorded_share > measured_share)
    is_misled = is_lost | ~(is_won | _spans_long_step(pairs[is_asked], odometry))
    is_kept = agrees.copy()
    is_kept[is_asked] |= ~is_misled
    return replace(known, verified=verified.where(is_kept))


def _spans_long_step(pairs: Int[np.ndarray, "p 2"], odometry: Odometry) -> Bool[np.ndarray, " p"]:
    steps = odometry.cam_from_next
    return spans_any(pairs, times_usual(steps, usual_step(steps)) > LONG)
