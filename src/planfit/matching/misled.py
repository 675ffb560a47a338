"""Motions of neighbours that a repeating pattern misled: images choose between them and the recorded ones.

Where the same picture hangs four times on a wall, keypoints of one agree with those of the next: a motion a
metre or a quarter turn off, with as many matches as the right one. The rest of the views tells, as it does of
revisits. It is asked only where measured and recorded motion contradict each other: where the tracker jumped,
the recorded one explains nothing.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from planfit.geometry import se3
from planfit.matching.cycles import is_near
from planfit.matching.options import MatchingOptions
from planfit.matching.relative_motions import NeighbourMotions, VerifiedPairs
from planfit.matching.verify import match_sigma
from planfit.matching.view_agreement import explained_by_rest
from planfit.scan.odometry import Odometry


def without_misled(
    known: NeighbourMotions,
    world_from_cams: Float[np.ndarray, "n 4 4"],
    odometry: Odometry,
    options: MatchingOptions,
) -> NeighbourMotions:
    """Leave out verified pairs whose views the recorded motion explains better than the measured one.

    Args:
        known: neighbours that keypoints brought together.
        world_from_cams: recorded poses.
        odometry: how far they may be off.
        options: when two motions agree, and when views do.
    """
    verified = known.verified
    pairs, measured = verified.relative_poses.pairs, verified.relative_poses.a_from_b
    recorded = se3.inverse(world_from_cams[pairs[:, 0]]) @ world_from_cams[pairs[:, 1]]
    sigmas = odometry.sigma_between(*pairs.T)
    agrees = is_near(measured, recorded, sigmas, options.cycle_consistency)
    if agrees.all():
        return known
    by_measured, by_recorded = (
        _explained(verified, motions, agrees, known, options) for motions in (measured, recorded)
    )
    return replace(known, verified=verified.where(agrees | (by_recorded <= by_measured)))


def _explained(
    verified: VerifiedPairs,
    motions: Float[np.ndarray, "p 4 4"],
    agrees: Bool[np.ndarray, " p"],
    known: NeighbourMotions,
    options: MatchingOptions,
) -> Float[np.ndarray, " p"]:
    """How much of the views of each pair a motion explains, its matches aside."""
    sigma_m = np.array(
        [
            np.median(match_sigma(a, b, options.verify))
            for a, b in zip(verified.points_a, verified.points_b, strict=True)
        ]
    )
    return explained_by_rest(
        replace(verified.relative_poses, a_from_b=motions),
        verified.points_a,
        verified.points_b,
        sigma_m,
        agrees,
        known.keypoints.grids,
        options.agreement,
    )
