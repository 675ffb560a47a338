"""Whether a storey's floor is level, or has pieces that lie higher or slope, by all that the scan shows.

Two explanations of one scan are solved, and compared by their evidence: what they strain, and what each
height and slope of a piece costs by its prior (Laplace's approximation; MacKay 2003, chapter 28). A floor
that is pressed level though it is not strains recorded motion and matches, or makes walls lean. The cost of
the floor itself does not count: clutter that was labelled floor fits pieces better, whatever the floor does.
"""

from dataclasses import replace

import numpy as np

from planfit.adjust import build_problem
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
from planfit.segmentation import no_level_points


def follow_floor(
    scan: Scan,
    observations: Observations,
    level: PreparedScan,
    options: RefineOptions,
    timer: StageTimer,
) -> tuple[Observations, PreparedScan]:
    """The scan on the pieces of its floor where that explains it better than one level plane; else as it is.

    Args:
        scan: images and cameras.
        observations: of one storey.
        level: the scan prepared, its floor held level.
        options: terms and solver.
        timer: times the stages.

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
