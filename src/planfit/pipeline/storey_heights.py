"""Whether a walk has storeys, how far apart their floors are, and which shape one floor has.

A tracker whose tilt drifts climbs or sinks by metres on a long walk; by heights alone, what it sees then is
the floor of another storey. What was measured on the way tells (`settle_floors`).

A storey's floor as recorded lies where the tracker had drifted to by then, decimetres off after a long walk.
At its right height, matches, floors and recorded motion strain each other least: their total cost, as a
function of the height, is a bowl, as that of a plan's scale is (`planfit.adjust.scale`). Synthetic walks of
120 to 400 frames: found 0.02, 0.01 and 0.12 m off, refitted within 0.003 m.

Whether one floor is level, or has pieces that lie higher or slope, is asked likewise: both are solved, and
compared by their evidence, what they strain, and what each height and slope of a piece costs by its prior
(Laplace's approximation; MacKay 2003, chapter 28). A floor that is pressed level though it is not strains
recorded motion and matches, or makes walls lean. The cost of the floor itself does not count: clutter that
was labelled floor fits pieces better, whatever the floor does.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from planfit.adjust import AdjustOptions, build_problem, close_loops
from planfit.adjust.ceilings import level_middles
from planfit.adjust.floor_pieces import (
    LEAN_SIGMA_RAD,
    SIGMA_M,
    FloorPieces,
    find_pieces,
    flattened,
    lean_of_walls,
    set_upright,
)
from planfit.adjust.keyframes import follow_keyframes
from planfit.adjust.scale import bottom_of_bowl
from planfit.pipeline.observations import Observations
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.prepare import PreparedScan, prepare
from planfit.priors import (
    CLEAR_ODDS,
    FLOOR_NOT_LEVEL_SHARE,
    FLOOR_PIECE_SIGMA_M,
    FLOOR_SLOPE_SIGMA_SHARE,
)
from planfit.runtime import StageTimer
from planfit.scan import Scan
from planfit.segmentation import Structure, no_level_points
from planfit.segmentation.storeys import MAX_DRIFT_M

STEP_M = 0.1
"""Heights are tried this far apart."""
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
        return _follow_floor(scan, observations, prepared, options, timer)
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
        step_m = STEP_M * above
        steps, _ = bottom_of_bowl(lambda n, at=refitted_m, by=step_m: cost(at + n * by))
        refitted_m = refitted_m + steps * step_m
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


def _follow_floor(
    scan: Scan,
    observations: Observations,
    level: PreparedScan,
    options: RefineOptions,
    timer: StageTimer,
) -> tuple[Observations, PreparedScan]:
    """The scan on the pieces of its floor where that explains it better than one level plane; else as it is.

    Args:
        observations: of one storey.
        level: the scan prepared, its floor held level.

    Returns:
        observations whose floor points are as if the floor were level, and the scan prepared by them.
    """
    adjust, structure = options.adjust, observations.structure
    strain = _strain(level, options)
    if adjust.floor.weight <= 0 or not adjust.loops_first or strain < np.log(CLEAR_ODDS.value):
        return observations, level
    unheld = replace(options, adjust=replace(adjust, floor=replace(adjust.floor, weight=0.0)))
    free = prepare(scan, observations, unheld, timer)
    seen, poses = free.measurements.structure, free.level_from_keys
    poses = set_upright(poses, lean_of_walls(seen.walls, poses))
    pieces = find_pieces(seen.floor, poses, np.random.default_rng(options.seed))
    if pieces is None or pieces.is_level:
        return observations, level
    floor = flattened(structure.floor, follow_keyframes(poses, free.keyframes), pieces)
    # Ceilings follow floors, or do not: they tell nothing here.
    structure = replace(
        structure,
        floor=floor,
        ceiling=no_level_points(len(scan)),
        floor_pieces=tuple(zip(pieces.heights_where_walked_m, pieces.slopes, strict=True)),
    )
    followed = replace(observations, structure=structure)
    again = prepare(scan, followed, options, timer)
    if strain - _strain(again, options) - _price(pieces) < np.log(CLEAR_ODDS.value):
        return observations, level
    return followed, again


def _strain(prepared: PreparedScan, options: RefineOptions) -> float:
    """Cost of all terms but the floor's, without the plan, and of walls that lean, nats."""
    measured, poses = prepared.measurements, prepared.level_from_keys
    costs = build_problem(measured, options.adjust, poses).costs(poses)
    lean = lean_of_walls(measured.structure.walls, poses)
    variance = LEAN_SIGMA_RAD**2 + lean.sigma_rad**2
    of_lean = 0.5 * float(lean.tilt_rad @ lean.tilt_rad) / variance
    return sum(costs.values()) - costs.get("floor", 0.0) + of_lean


def _price(pieces: FloorPieces) -> float:
    """What heights and slopes cost by their priors, nats (Occam's factor)."""
    rarity = -np.log(FLOOR_NOT_LEVEL_SHARE.value)
    of_height = np.log(FLOOR_PIECE_SIGMA_M.value / SIGMA_M) + rarity
    of_slope = 2.0 * np.log(FLOOR_SLOPE_SIGMA_SHARE.value / LEAN_SIGMA_RAD) + rarity
    return float((len(pieces.planes) - 1) * of_height + pieces.n_slopes * of_slope)
