"""Terms that need no plan, made of what a scan says; None where there is no data, or no weight."""

from dataclasses import replace

import numpy as np

from planfit.adjust.measurements import Measurements
from planfit.adjust.options import AdjustOptions
from planfit.adjust.terms.between import OdometryTerm, PointTerm, SurfaceTerm
from planfit.adjust.terms.levels import LevelTerm, floor_term
from planfit.adjust.terms.observation_models import POINTS
from planfit.adjust.terms.rays import RayTerm
from planfit.adjust.terms.reprojection import ReprojectionTerm
from planfit.lsq.robust import SQUARES


def geometric_term(
    measurements: Measurements, options: AdjustOptions
) -> PointTerm | RayTerm | ReprojectionTerm | None:
    """What the matches are held to; None without matches or weight."""
    matches, kept, chosen = (
        measurements.matches,
        measurements.kept,
        options.model(options.geometric),
    )
    if matches.n_matches == 0 or chosen.weight == 0:
        return None
    if kept is not None and (options.geometric != "points" or options.cost == "paper"):
        matches, kept = matches.of_pairs(kept.pairs), None  # a copy: they know no left out pairs
    if options.cost == "paper":
        # The paper's means know no sigmas: a metre is a metre for every match.
        matches = replace(matches, sigma=np.ones_like(matches.sigma))
        chosen = chosen.as_mean(matches.n_matches)
    if options.geometric == "points":
        is_kept = None if kept is None else kept.pairs
        return PointTerm(matches, chosen, device=options.solver.device, is_kept=is_kept)
    if options.geometric == "rays":
        return RayTerm(matches, chosen)
    return ReprojectionTerm(matches, measurements.cameras, chosen)


def by_hand_term(measurements: Measurements, options: AdjustOptions) -> PointTerm | None:
    """Plain least squares of 3D points, whatever the geometric term is; None where nobody vouches for any.

    A pair that a person vouches for is worth as much as the best matched one, be it a single point: as one
    observation it would bend the steps of a walk half way.
    """
    matches = measurements.by_hand
    if matches is None or matches.n_matches == 0:
        return None
    most = POINTS.max_observations
    counts = np.diff(matches.start)
    share = np.repeat(np.minimum(counts, most) / most, counts)
    sure = replace(POINTS, loss=SQUARES)
    matches = replace(matches, sigma=matches.sigma * np.sqrt(share))
    return PointTerm(matches, sure, name="loops by hand", device=options.solver.device)


def surfaces_term(measurements: Measurements, options: AdjustOptions) -> SurfaceTerm | None:
    """Pairs of frames that were matched by their surfaces."""
    if options.surfaces.weight <= 0 or len(measurements.surfaces) == 0:
        return None
    return SurfaceTerm(measurements.surfaces, options.model("surfaces"))


def floor_points_term(measurements: Measurements, options: AdjustOptions) -> LevelTerm | None:
    """Floor points on the floor of their storey."""
    structure, floor = measurements.structure, options.model("floor")
    if floor.weight <= 0 or not structure.has_floor:
        return None
    if options.cost == "paper":
        floor = floor.as_mean(len(structure.floor))
    return floor_term(structure, floor, options.solver.device)


def odometry_term(measurements: Measurements, options: AdjustOptions) -> OdometryTerm | None:
    """Recorded steps from frame to frame."""
    if options.odometry.weight <= 0 or not len(measurements.odometry.cam_from_next):
        return None
    return OdometryTerm(measurements.odometry, options.model("odometry"))
