"""Control points that cannot be where they were written, told before any of them pulls.

A solve follows a point that is metres off where only recorded motion contradicts it: it costs a detour,
and what follows the detour fits. So each point is first predicted by those beside it. However a tracker
drifts, it loses a small share of the path walked between them; a point that is off by more is wrong, or
they are.
"""

from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float

from planfit.errors import OptionError
from planfit.priors import DRIFT_SHARE
from planfit.survey.axes import UNITS
from planfit.survey.fit import EXPECTED, are_apart, fit_rigid_2d, other_axes

LEAST_M = 0.5
"""Points may be off by so much anyway: marks, depth."""
MAX_DRIFT_SHARE = DRIFT_SHARE.value
"""And by this share of the path between: no tracker loses as much."""
NEIGHBOURS = 4
"""Points that predict one, the nearest along the path: the further, the more drift explains."""
MAX_SUSPECTS = 12
"""Points of which pairs are tried for swapped ids, those that contradict most."""
BETTER = 1 / 3
"""A mistake in all points must bring the worst contradiction down to this share."""
FEWEST = 4
"""Of fewer points that contradict each other, nothing tells which is wrong."""


def find_blunders(
    level: Float[np.ndarray, "p 3"],
    site: Float[np.ndarray, "p 3"],
    walked_m: Float[np.ndarray, " p"],
) -> Bool[np.ndarray, " p"]:
    """Points that contradict their neighbours, the worst first, until none does.

    Args:
        level: points as the scan has them, z up.
        site: the same as surveyed, z up, m; z may be NaN.
        walked_m: how far the camera had walked where it saw each.

    Raises:
        OptionError: one mistake in all of them explains it (axes, unit), or so few contradict each other that
            nothing tells which is wrong.
    """
    is_bad = np.zeros(len(level), dtype=bool)
    off = _excesses(level, site, walked_m)
    if len(level) >= FEWEST and off.max() > 1.0:
        _require_no_mistake(level, site, walked_m, off)
        swapped = _swapped(level, site, walked_m, off)
        if swapped is not None:
            is_bad[list(swapped)] = True
            return is_bad
    while True:
        left = np.flatnonzero(~is_bad)
        off = _excesses(level[left], site[left], walked_m[left])
        if len(left) < 2 or off.max() <= 1.0:
            return is_bad
        if len(left) < FEWEST:
            raise OptionError(
                f"{EXPECTED}, found {len(left)} that contradict each other by more than drift can; check "
                "their coordinates and marks, or mark more points"
            )
        is_bad[left[np.argmax(off)]] = True


def _require_no_mistake(
    level: Float[np.ndarray, "p 3"],
    site: Float[np.ndarray, "p 3"],
    walked_m: Float[np.ndarray, " p"],
    off: Float[np.ndarray, " p"],
) -> None:
    """Raise where points contradict each other and, as one mistake would have them, all agree.

    The median of the fit can hide it: of seven points with y and z swapped, four that stood in a row of 3 m
    fitted within drift, and the other three were left out as wrong.
    """
    named = [(f"with {remedy}", changed) for remedy, changed in other_axes(site)]
    for unit, metres in UNITS.items():
        named.append((f"as {unit}: multiply x, y and z by {metres:g}", site * metres))
    for remedy, changed in named:
        if _excesses(level, changed, walked_m).max() <= min(1.0, BETTER * float(off.max())):
            raise OptionError(
                f"{EXPECTED}, found {np.sum(off > 1.0)} of {len(off)} that contradict those beside them by "
                f"more than drift can; they fit {remedy}"
            )


def _swapped(
    level: Float[np.ndarray, "p 3"],
    site: Float[np.ndarray, "p 3"],
    walked_m: Float[np.ndarray, " p"],
    off: Float[np.ndarray, " p"],
) -> tuple[int, int] | None:
    """The one pair of points with which, once their ids are swapped, nothing contradicts anything; None where
    no pair alone explains it. Two wrong points among few are else a riddle."""
    suspects = np.argsort(-off)[:MAX_SUSPECTS]
    found = []
    for first, second in combinations(suspects.tolist(), 2):
        order = np.arange(len(level))
        order[[first, second]] = second, first
        if _excesses(level, site[order], walked_m).max() <= 1.0:
            found.append((first, second))
    return found[0] if len(found) == 1 else None


def _excesses(
    level: Float[np.ndarray, "p 3"],
    site: Float[np.ndarray, "p 3"],
    walked_m: Float[np.ndarray, " p"],
) -> Float[np.ndarray, " p"]:
    """Of each point, as of `_excess`."""
    return np.array([_excess(level, site, walked_m, k) for k in range(len(level))])


def _excess(
    level: Float[np.ndarray, "p 3"],
    site: Float[np.ndarray, "p 3"],
    walked_m: Float[np.ndarray, " p"],
    k: int,
) -> float:
    """How far a point is from where its neighbours predict it, by what drift explains."""
    path_m = np.abs(walked_m - walked_m[k])
    path_m[k] = np.inf
    near = np.argsort(path_m, kind="stable")[: min(NEIGHBOURS, len(level) - 1)]
    if len(near) == 0:
        return 0.0
    allowed = max(LEAST_M, MAX_DRIFT_SHARE * float(path_m[near].mean()))
    z = level[:, 2] - site[:, 2]
    known = near[np.isfinite(z[near])]
    up = abs(z[k] - np.median(z[known])) if len(known) and np.isfinite(z[k]) else 0.0
    if are_apart(level[near]):
        factor, shift = fit_rigid_2d(site[near], level[near])
        at = factor * complex(*site[k, :2]) + shift
        across = abs(at - complex(*level[k, :2]))
    else:  # a distance is all that points at one place tell
        middle = level[near, :2].mean(axis=0), site[near, :2].mean(axis=0)
        lengths = [np.linalg.norm(p[k, :2] - m) for p, m in zip((level, site), middle, strict=True)]
        across = abs(lengths[0] - lengths[1])
    return float(max(across, up)) / allowed
