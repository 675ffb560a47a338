"""The tracking of several scans as that of one walk that breaks between them: no step is believed across."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from planfit.geometry import se3
from planfit.scan.joined import FramesOfScan
from planfit.scan.odometry import Odometry
from planfit.tracking.types import Tracking, submaps_of

APART_RAD, APART_M = 1.0, 10.0
"""Sigmas of the step from the last frame of a scan to the first of the next: it says nothing, beside a
degree and a centimetre of others, and holds a scan that nothing else does."""


def join_trackings(
    trackings: Sequence[Tracking],
    scans: Sequence[FramesOfScan],
    joined_from_worlds: Sequence[Float[np.ndarray, "4 4"]],
) -> Tracking:
    """One tracking of all frames, in the joined world.

    Findings of breaks name their scan. What was found of clocks and conventions is each
    scan's own.

    Args:
        trackings: of the scans, in their order.
        scans: which frames are whose.
        joined_from_worlds: where each scan stands.
    """
    moves, firsts = list(joined_from_worlds), [scan.first for scan in scans]
    recorded, poses = (
        np.concatenate([move @ getattr(t, name) for move, t in zip(moves, trackings, strict=True)])
        for name in ("recorded_world_from_cams", "world_from_cams")
    )
    borders = np.array(firsts[1:], dtype=int) - 1
    steps = se3.inverse(poses[:-1]) @ poses[1:]
    rotation, translation = np.full(len(steps), APART_RAD), np.full(len(steps), APART_M)
    for tracking, scan in zip(trackings, scans, strict=True):
        of = slice(scan.first, scan.last)
        steps[of] = tracking.odometry.cam_from_next
        rotation[of] = tracking.odometry.sigma_rotation
        translation[of] = tracking.odometry.sigma_translation
    open_steps, undecided, contradicted = (
        np.concatenate([getattr(t, name) + f for t, f in zip(trackings, firsts, strict=True)])
        for name in ("open_steps", "undecided_steps", "contradicted_steps")
    )
    breaks = [
        replace(
            found,
            first_frame=found.first_frame + scan.first,
            last_frame=found.last_frame + scan.first,
            finding=found.finding.about(scan.name),
        )
        for tracking, scan in zip(trackings, scans, strict=True)
        for found in tracking.breaks
    ]
    own_links = [
        (a + first, b + first)
        for tracking, first in zip(trackings, firsts, strict=True)
        for a, b in tracking.linked
    ]
    mains = [_main_frame(t) + first for t, first in zip(trackings, firsts, strict=True)]
    return Tracking(
        recorded_world_from_cams=recorded,
        world_from_cams=poses,
        odometry=Odometry(steps, rotation, translation),
        sigma_factors=(
            max(t.sigma_factors[0] for t in trackings),
            max(t.sigma_factors[1] for t in trackings),
        ),
        breaks=tuple(breaks),
        n_motions=sum(t.n_motions for t in trackings),
        open_steps=np.union1d(open_steps, borders).astype(int),
        undecided_steps=undecided,
        contradicted_steps=contradicted,
        n_repeated=sum(t.n_repeated for t in trackings),
        # Between the scans nothing was tracked, but what is placed of each is placed against the others.
        linked=(*own_links, *((mains[0], other) for other in mains[1:])),
    )


def _main_frame(tracking: Tracking) -> int:
    """A frame of the largest part of a scan that hangs together."""
    submap = submaps_of(len(tracking.world_from_cams), tracking.open_steps, tracking.linked)
    return int(np.argmax(submap == np.argmax(np.bincount(submap))))
