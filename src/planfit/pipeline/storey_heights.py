"""How far apart the floors of a walk's storeys are, by all that was measured on the stairs between them.

A storey's floor as recorded lies where the tracker had drifted to by then, decimetres off after a long walk.
At its right height, matches, floors and recorded motion strain each other least: their total cost, as a
function of the height, is a bowl, as that of a plan's scale is (`planfit.adjust.scale`). Synthetic walks of
120 to 400 frames: found 0.02, 0.01 and 0.12 m off, refitted within 0.003 m.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from planfit.adjust import AdjustOptions, close_loops
from planfit.pipeline.prepare import PreparedScan
from planfit.segmentation import Structure

STEP_M = 0.1
"""Heights are tried this far apart."""
MAX_MOVES = 4
"""Times that the bowl's bottom is looked for further on."""
MAX_MOVE_M = 0.5
"""Further than this it is not taken from one bowl: robust losses level off."""


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
            if curvature <= 1e-9:
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
