"""What the scan says about its own poses, as terms of the adjustment."""

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from planfit.adjust.options import AdjustOptions
from planfit.adjust.terms.effective_observations import as_mean
from planfit.adjust.terms.levels import floor_term
from planfit.adjust.terms.odometry import OdometryTerm
from planfit.adjust.terms.points import PointTerm
from planfit.adjust.terms.rays import RayTerm
from planfit.adjust.terms.reprojection import ReprojectionTerm
from planfit.errors import ScanError
from planfit.geometry.camera import Camera
from planfit.lsq.term import Term
from planfit.lsq.terms.prior import PosePriorTerm
from planfit.matching import Matches
from planfit.scan.odometry import Odometry
from planfit.segmentation import Structure

Chosen = TypeVar("Chosen")


@dataclass(frozen=True)
class Measurements:
    """What the scan says about its own poses.

    Raises:
        ScanError: a point or a recorded step is not finite.
    """

    matches: Matches
    structure: Structure
    odometry: Odometry
    cameras: tuple[Camera, ...] = ()
    """Camera of each frame; only the reprojection error asks for them."""
    frame_idx: np.ndarray | None = None
    """(n,) the scan's number of each frame, where only some are solved for."""

    def __post_init__(self) -> None:
        named = {
            "matched point": (self.matches.points_a, self.matches.points_b, self.matches.sigma),
            "floor point": (self.structure.floor.points_cam,),
            "wall point": (self.structure.walls.points_cam,),
            "ceiling point": (self.structure.ceiling.points_cam,),
            "point of a column": (self.structure.columns.points_cam,),
            "recorded step": (self.odometry.cam_from_next,),
        }
        for name, arrays in named.items():
            for array in arrays:
                # The sum is not finite where an entry is not, and needs no array of its own.
                if not np.isfinite(array.sum()) and not np.isfinite(array).all():
                    bad = int((~np.isfinite(array)).reshape(len(array), -1).any(axis=1).sum())
                    raise ScanError(
                        f"adjustment: expected finite numbers, found {bad} {name}(s) with NaN or "
                        "infinity; drop them before refining"
                    )

    def terms(self, options: AdjustOptions) -> list[Term]:
        """Terms that need no plan; those without data or weight are left out."""
        terms = self.geometric_terms(options)
        if options.floor.weight > 0 and self.structure.has_floor:
            floor = options.floor
            if options.averaging == "mean":
                floor = as_mean(floor, len(self.structure.floor))
            terms.append(floor_term(self.structure, floor, options.solver.device))
        if options.odometry.weight > 0 and len(self.odometry.cam_from_next):
            terms.append(OdometryTerm(self.odometry, options.odometry))
        return terms

    def geometric_terms(self, options: AdjustOptions) -> list[Term]:
        """What the matches are held to; nothing without matches or weight."""
        matches = self.matches
        if matches.n_matches == 0 or getattr(options, options.geometric).weight == 0:
            return []
        if options.averaging == "mean":
            matches = replace(matches, sigma=np.ones_like(matches.sigma))
        if options.geometric == "points":
            points = self._averaged(options.points, options)
            return [PointTerm(matches, points, device=options.solver.device)]
        if options.geometric == "rays":
            return [RayTerm(matches, self._averaged(options.rays, options))]
        chosen = self._averaged(options.reprojection, options)
        return [ReprojectionTerm(matches, self.cameras, chosen)]

    def pose_prior(self, target_from_cams: np.ndarray, options: AdjustOptions) -> PosePriorTerm:
        """Holds the first frame where it is, but for what the floor holds: height and tilt."""
        has_floor = options.floor.weight > 0 and self.structure.has_floor
        free = np.inf if has_floor else 1e-3
        sigma = np.array([free, free, 1e-3, 1e-3, 1e-3, free])
        return PosePriorTerm(np.array([0]), target_from_cams[:1], sigma)

    def _averaged(self, chosen: Chosen, options: AdjustOptions) -> Chosen:
        return as_mean(chosen, self.matches.n_matches) if options.averaging == "mean" else chosen
