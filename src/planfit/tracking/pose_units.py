"""Poses in a unit of their own: of structure from motion, of trackers with one camera."""

import numpy as np
from jaxtyping import Float

from planfit.geometry import se3
from planfit.tracking.motions import MeasuredMotions

PREFIX = "unit:"
"""Of the convention's name, before the metres that a unit is."""
MIN_DEPARTURE = 1.1
"""Factor from which on poses are in another unit. What is less may as well be depth that is a little off:
which of the two, calibration decides."""

Poses = Float[np.ndarray, "n 4 4"]


def unit_named(metres: float) -> str:
    """Name of the convention: translations are in units of so many metres."""
    return f"{PREFIX}{metres:.5g}"


def metres_named(name: str) -> float | None:
    """Metres of the unit that a convention names; None where it names none, or nothing above 0."""
    if not name.startswith(PREFIX):
        return None
    try:
        metres = float(name[len(PREFIX) :])
    except ValueError:
        return None
    return metres if 0 < metres < np.inf else None


def unit_of(convention: str) -> float:
    """Metres of the unit of their own that poses in this convention have; 1 where they have none."""
    named = [metres_named(part) for part in convention.split(", ")]
    return next((metres for metres in named if metres is not None), 1.0)


def in_metres(poses: Poses, metres: float) -> Poses:
    """Poses whose translations are in units of so many metres."""
    return se3.make_transform(poses[:, :3, :3], poses[:, :3, 3] * metres)


def unit_by_motions(poses: Poses, motions: MeasuredMotions) -> float | None:
    """Metres of the unit in which recorded steps are as long as those measured; None where that is a metre.

    Recorded steps are smooth where a tracker is good, so what was measured is taken as a share of them.
    Where they are noisier than what was measured, that share is too low, and the inverse share the right one:
    both have to say so. Directions that measured motions leave free weigh nothing: surfaces are brought
    together from the recorded motion, and stay there in these.
    """
    low, high = (
        _share(poses, motions, of_recorded=True),
        1 / max(share_of_measured(poses, motions), 1e-12),
    )
    is_metre = min(low, high) < MIN_DEPARTURE and max(low, high) > 1 / MIN_DEPARTURE
    return None if low <= 0 or is_metre else low


def share_of_measured(poses: Poses, motions: MeasuredMotions) -> float:
    """Of the length of measured steps, how long recorded ones are along these.

    Noise makes steps longer but not along the measured direction.
    """
    return _share(poses, motions, of_recorded=False)


def _share(poses: Poses, motions: MeasuredMotions, of_recorded: bool) -> float:
    """Of one kind of steps along the other by the length of these: the median, each by how surely it is told;
    0 of none."""
    i, j = motions.pairs.T
    recorded = (se3.inverse(poses[i]) @ poses[j])[:, :3, 3]
    measured = motions.a_from_b[:, :3, 3]
    of = recorded if of_recorded else measured
    surety = np.linalg.inv(motions.covariance[:, 3:, 3:])
    squared = np.einsum("pi,pij,pj->p", of, surety, of)
    along = np.einsum("pi,pij,pj->p", recorded, surety, measured)
    moved = np.flatnonzero(squared > 0)
    if len(moved) == 0:
        return 0.0
    shares = along[moved] / squared[moved]
    order = np.argsort(shares)
    weight = np.cumsum(squared[moved][order])
    return float(shares[order][np.searchsorted(weight, weight[-1] / 2)])
