"""The paper's cost as terms: unsquared norms, each term the mean over its own points.

L = mean |p - p'| + lambda_floor mean dist(floor) + lambda_walls mean dist(wall point, its face).

The paper's text says "mean" and "averaging" where its formulas sum; its weights only make sense with
means, and its authors' code takes means. In planfit's terms that is a spread of 1 m, no limit on
readings, and a weight of lambda over the term's number of points. No trajectory prior.
"""

from dataclasses import dataclass, replace

import numpy as np

from planfit.adjust.association import Association
from planfit.adjust.robust import Loss, LossKind
from planfit.adjust.terms.base import Term
from planfit.adjust.terms.floor import FloorOptions, FloorTerm
from planfit.adjust.terms.points import PointOptions, PointTerm
from planfit.adjust.terms.walls import WallOptions, WallTerm
from planfit.errors import require_positive
from planfit.floorplan import Floorplan
from planfit.matching import Matches
from planfit.structure import Structure


@dataclass(frozen=True)
class PaperWeights:
    """Weights of the paper's terms; the 3D point error has weight 1."""

    lambda_floor: float = 10.0
    """Factor on the mean distance to the floor; 0 switches the term off."""
    lambda_walls: float = 0.5
    """Factor on the mean distance to the walls: 0.5 for phone scans, 0.6 for Redwood; 0: off."""
    rounding_m: float = 1e-6
    """Norms are rounded off below this: sqrt(d^2 + r^2) - r, which has a slope everywhere."""

    def __post_init__(self) -> None:
        require_positive(self, "rounding_m")


def paper_terms(
    matches: Matches,
    structure: Structure,
    floorplan: Floorplan,
    association: Association,
    weights: PaperWeights,
) -> list[Term]:
    """Terms whose costs add up to the paper's L, in metres; those without points are left out."""
    loss = Loss(LossKind.NORM, weights.rounding_m)
    terms: list[Term] = []
    if matches.n_matches:
        metric = replace(matches, sigma=np.ones(matches.n_matches))
        options = PointOptions(1.0 / matches.n_matches, loss, max_readings=np.inf)
        terms.append(PointTerm(metric, options))
    n_floor = len(structure.floor_points_cam)
    if n_floor and weights.lambda_floor > 0:
        weight = weights.lambda_floor / n_floor
        terms.append(FloorTerm(structure, FloorOptions(weight, 1.0, loss, np.inf, 1.0)))
    n_walls = int(np.diff(structure.patch_start)[association.face_idx >= 0].sum())
    if n_walls and weights.lambda_walls > 0:
        weight = weights.lambda_walls / n_walls
        wall_options = WallOptions(weight, 1.0, loss, np.inf, 1.0)
        terms.append(WallTerm(structure, floorplan, association, wall_options))
    return terms
