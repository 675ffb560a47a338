"""Whether a walk has storeys, and how far apart their floors are, by all that was measured between them.

A tracker whose tilt drifts climbs or sinks by metres on a long walk; by heights alone, what it sees then is
the floor of another storey. What was measured on the way tells (`settle_floors`).

A storey's floor as recorded lies where the tracker had drifted to by then, decimetres off after a long walk.
At its right height, matches, floors and recorded motion strain each other least: their total cost, as a
function of the height, is a bowl, as that of a plan's scale is (`planfit.adjust.scale`). Synthetic walks of
120 to 400 frames: found 0.02, 0.01 and 0.12 m off, refitted within 0.003 m.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from planfit.adjust import AdjustOptions, build_problem, close_loops
from planfit.adjust.ceilings import level_middles
from planfit.adjust.scale import FLAT
from planfit.pipeline.floor_shape import follow_floor
from planfit.pipeline.observations import Observations
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.prepare import PreparedScan, prepare
from planfit.runtime import StageTimer
from planfit.scan import Scan
from planfit.segmentation import Structure
from planfit.segmentation.storeys import MAX_DRIFT_M

STEP_M = 0.1
"""Heights are tried this far apart."""
MAX_MOVES = 4
"""Times that the bowl's bottom is looked for further on."""
MAX_MOVE_M = 0.5
"""Further than this it is not taken from one bowl: robust losses level off."""

MIN_GAIN, MAX_STRAIN = 10.0, 15.0
"""Cost that one floor saves, at least, and that it adds to matches and recorded motion, at most. On ConSLAM
with three and six times its drift, where storeys are false: saved 2,500 to 3,700, added -240 to 5. On five
synthetic walks with true ones: saved -70 to -1,000, added 13 to 310; torn stairs add 34 and more."""


def settle_floors(
    scan: Scan, observations: Observations, options: RefineOptions, timer: StageTimer
) -> tuple[Observations, PreparedScan]:
    """Prepare a scan; on one floor, if that explains it better than the storeys that recorded heights show.

    Both are solved without the plan. On storeys, frames that see a floor between them cost as much as those
    that are as far off their floor as drift may be: without that, leaving frames out would pay. True storeys
    brought onto one floor stay off it, or strain the motions between them.

    Returns:
        the observations, all frames on the main floor where that is so; and the scan prepared by them.
    """
    prepared = prepare(scan, observations, options, timer)
    heights_m = observations.structure.floor_heights_m
    others_m = np.unique(heights_m[np.isfinite(heights_m) & (heights_m != 0)])
    adjust = options.adjust
    if len(others_m) == 0:
        return follow_floor(scan, observations, prepared, options, timer)
    if adjust.floor.weight <= 0 or not adjust.loops_first:
        return observations, prepared
    structure = replace(
        observations.structure,
        floor_heights_m=np.zeros(len(heights_m)),
        drifted_floors_m=tuple(float(height) for height in others_m),
    )
    on_one = replace(observations, structure=structure)
    again = prepare(scan, on_one, options, timer)
    storeys, one = (_costs_on_floors(each, adjust) for each in (prepared, again))
    strain = sum(one.values()) - one["floor"] - (sum(storeys.values()) - storeys["floor"])
    if sum(storeys.values()) - sum(one.values()) < MIN_GAIN or strain > MAX_STRAIN:
        return observations, prepared
    return on_one, again


def _costs_on_floors(prepared: PreparedScan, options: AdjustOptions) -> dict[str, float]:
    """Cost of each term that needs no plan; a frame whose floor is on no storey is `MAX_DRIFT_M` off one."""
    measured, poses = prepared.measurements, prepared.level_from_keys
    structure = measured.structure
    middles_m = level_middles(structure.floor, poses)
    heights_m = structure.floor_heights_m
    is_off = np.isnan(heights_m) & np.isfinite(middles_m)
    held = replace(structure, floor_heights_m=np.where(is_off, middles_m - MAX_DRIFT_M, heights_m))
    return build_problem(replace(measured, structure=held), options, poses).costs(poses)


def refit_floors(
    prepared: PreparedScan, floors_m: Float[np.ndarray, " k"], options: AdjustOptions
) -> Float[np.ndarray, " k"]:
    """Heights (m) of floors at which what needs no plan strains itself least; the first stays.

    Args:
        prepared: loops closed with the floors at `floors_m`.
        floors_m: as found, from the lowest.
        options: terms and solver.
    """
    refitted_m = floors_m.copy()
    narrow = replace(options, gnc_schedule=options.gnc_schedule[-1:])

    def cost(heights_m: Float[np.ndarray, " k"]) -> float:
        tried = with_floors(prepared, floors_m, heights_m)
        solution = close_loops(tried.measurements, tried.level_from_keys, narrow)
        return sum(each.after for each in solution.cost_by_term.values())

    for k in range(1, len(floors_m)):
        # A storey and all above it: what moves is the climb from the storey below.
        above = (np.arange(len(floors_m)) >= k).astype(float)
        for _ in range(MAX_MOVES):
            low, here, high = (
                cost(refitted_m + step * STEP_M * above) for step in (-1.0, 0.0, 1.0)
            )
            curvature = low + high - 2 * here
            if curvature <= FLAT:
                break  # nothing measures the climb
            move_m = float(
                np.clip(0.5 * STEP_M * (low - high) / curvature, -MAX_MOVE_M, MAX_MOVE_M)
            )
            refitted_m = refitted_m + move_m * above
            if abs(move_m) < STEP_M:
                break
    return refitted_m


def with_floors(
    prepared: PreparedScan, found_m: Float[np.ndarray, " k"], floors_m: Float[np.ndarray, " k"]
) -> PreparedScan:
    """The scan with its floors at other heights (m) than those found, stairs in proportion."""
    measured = prepared.measurements
    heights_m = measured.structure.floor_heights_m
    seen = np.flatnonzero(np.isfinite(heights_m))
    off_m = (floors_m - found_m)[np.searchsorted(found_m, heights_m[seen])]
    lifted = prepared.level_from_keys.copy()
    lifted[:, 2, 3] += np.interp(np.arange(len(lifted)), seen, off_m)
    structure = structure_with_floors(measured.structure, found_m, floors_m)
    return replace(
        prepared,
        measurements=replace(measured, structure=structure),
        level_from_keys=lifted,
    )


def structure_with_floors(
    structure: Structure, found_m: Float[np.ndarray, " k"], floors_m: Float[np.ndarray, " k"]
) -> Structure:
    """Frames that stand on a floor found at one height (m) stand on it at another."""
    heights_m = structure.floor_heights_m.copy()
    seen = np.isfinite(heights_m)
    heights_m[seen] = floors_m[np.searchsorted(found_m, heights_m[seen])]
    return replace(structure, floor_heights_m=heights_m)
