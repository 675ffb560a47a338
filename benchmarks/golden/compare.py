"""Runs beside the kept ones: how far poses are apart, and whether that is a change of results."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from golden.kept import Run
from planfit.geometry import se3

MAX_M, MAX_RAD = 1e-6, 1e-6
"""What order of sums and other processors do; choices that fall differently do centimetres."""
MAX_SCALE_SHARE = 1e-7
"""Of the plan's scale; over ten metres it is `MAX_M`."""


@dataclass(frozen=True)
class Difference:
    """A run beside the kept one."""

    name: str
    position_m: float = math.nan
    """Largest distance between camera positions; NaN where poses cannot be compared."""
    rotation_rad: float = math.nan
    """Largest angle between rotations."""
    are_bits_equal: bool = False
    """Whether all poses are the same to the last bit."""
    faults: tuple[str, ...] = ()
    """Why it is a change of results, in words; none: it passes."""


def compare_runs(found: Sequence[Run], kept: Mapping[str, Run]) -> list[Difference]:
    """Each run beside the kept one of its name; kept ones that were not made, and new ones, are faults."""
    made = {run.name: run for run in found}
    missing = [Difference(name, faults=("was not run",)) for name in kept if name not in made]
    new = [Difference(name, faults=("is not kept",)) for name in made if name not in kept]
    return [_compare(run, kept[name]) for name, run in made.items() if name in kept] + missing + new


def _compare(run: Run, kept: Run) -> Difference:
    faults = []
    if run.outcome != kept.outcome:
        faults.append(f"outcome is {run.outcome!r}, was {kept.outcome!r}")
    if not _is_same_scale(run.metres_per_unit, kept.metres_per_unit):
        faults.append(f"scale is {run.metres_per_unit:.12g}, was {kept.metres_per_unit:.12g}")
    poses, before = run.plan_from_cams, kept.plan_from_cams
    if poses.shape != before.shape:
        faults.append(f"has {len(poses)} poses, had {len(before)}")
        return Difference(run.name, faults=tuple(faults))
    are_numbers = np.isfinite(poses).all(axis=(1, 2))
    if not are_numbers.all():
        faults.append(f"frame {int(np.argmin(are_numbers))} is no number")
        return Difference(run.name, faults=tuple(faults))
    apart = se3.difference(poses, before)
    turned_rad, moved_m = (np.linalg.norm(apart[:, of], axis=1) for of in (slice(3), slice(3, 6)))
    i, j = int(np.argmax(moved_m)), int(np.argmax(turned_rad))
    if moved_m[i] > MAX_M:
        faults.append(f"frame {i} is {moved_m[i]:.3g} m away, at most {MAX_M:g} m may be")
    if turned_rad[j] > MAX_RAD:
        faults.append(f"frame {j} is turned by {turned_rad[j]:.3g} rad, at most {MAX_RAD:g} may be")
    return Difference(
        run.name,
        float(moved_m[i]),
        float(turned_rad[j]),
        poses.tobytes() == before.tobytes(),
        tuple(faults),
    )


def _is_same_scale(scale: float, kept: float) -> bool:
    if math.isnan(scale) or math.isnan(kept):
        return math.isnan(scale) and math.isnan(kept)
    return abs(scale / kept - 1.0) <= MAX_SCALE_SHARE
