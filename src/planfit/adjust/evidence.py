"""What the scan says about its own poses, as terms of the adjustment."""

from dataclasses import dataclass

import numpy as np

from planfit.adjust.association import Association
from planfit.adjust.options import AdjustOptions
from planfit.adjust.terms.base import Term
from planfit.adjust.terms.floor import FloorTerm
from planfit.adjust.terms.points import PointTerm
from planfit.adjust.terms.trajectory import TrajectoryTerm
from planfit.adjust.terms.walls import WallTerm
from planfit.floorplan import Floorplan
from planfit.matching import Matches
from planfit.scan.odometry import Odometry
from planfit.structure import Structure


@dataclass(frozen=True)
class Evidence:
    """What the scan says about its own poses."""

    matches: Matches
    structure: Structure
    odometry: Odometry

    def terms(self, options: AdjustOptions) -> list[Term]:
        """Terms that need no plan; those without data or weight are left out."""
        terms: list[Term] = []
        if options.points.weight > 0 and self.matches.n_matches:
            terms.append(PointTerm(self.matches, options.points))
        if options.floor.weight > 0 and len(self.structure.floor_points_cam):
            terms.append(FloorTerm(self.structure, options.floor))
        if options.trajectory.weight > 0 and len(self.odometry.cam_from_next):
            terms.append(TrajectoryTerm(self.odometry, options.trajectory))
        return terms

    def costs(
        self,
        target_from_cams: np.ndarray,
        options: AdjustOptions,
        walls: tuple[Floorplan, Association] | None = None,
    ) -> dict[str, float]:
        """Robust cost of each term at poses (n, 4, 4), for reports."""
        terms = self.terms(options)
        if walls is not None and options.walls.weight > 0:
            terms.append(WallTerm(self.structure, *walls, options.walls))
        return {term.name: term.reweight(target_from_cams)[1] for term in terms}
