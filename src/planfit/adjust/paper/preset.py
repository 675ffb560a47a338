"""The paper's adjustment, to the letter: the `paper` preset.

L = mean |p - p'| + lambda_floor mean dist(floor) + lambda_walls mean dist(wall point, its face).

The paper's text says "mean" and "averaging" where its formulas sum; its weights only make sense with
means, and its authors' code takes means. Unsquared norms, in metres. No odometry term, no wall
offsets, no ceiling, no columns; faces are not told apart by the side they look to; all terms act at
once, from one distance, and association and solving alternate.
"""

import numpy as np

from planfit.adjust.association import Association, AssociationOptions, PlanCorrespondences
from planfit.adjust.measurements import Measurements
from planfit.adjust.options import AdjustOptions, TermOptions
from planfit.adjust.paper.descent import PaperWeights
from planfit.adjust.problem import build_problem
from planfit.floorplan import Floorplan
from planfit.lsq.term import Term
from planfit.matching import Matches
from planfit.scan.odometry import OdometryOptions, make_odometry
from planfit.segmentation import Structure


def paper_options(weights: PaperWeights | None = None) -> AdjustOptions:
    """Options under which the costs of an adjustment's terms add up to the paper's L, in metres."""
    weights = weights or PaperWeights()
    none = TermOptions(0.0)
    return AdjustOptions(
        cost="paper",
        floor=TermOptions(weights.lambda_floor),
        walls=TermOptions(weights.lambda_walls),
        ceiling=none,
        columns=none,
        odometry=none,
        surfaces=none,
        control=none,
        association=AssociationOptions(oriented=False, mutual=True),
        loops_first=False,
        gnc_schedule=(1.0,),
        # The paper sets no limit; mutually nearest planes of one building are rarely further apart.
        wall_distances_m=(2.0,),
        max_alternations=10,
    )


def paper_terms(
    matches: Matches,
    structure: Structure,
    floorplan: Floorplan,
    association: Association,
    weights: PaperWeights,
) -> list[Term]:
    """Terms whose costs add up to the paper's L, in metres; those without points are left out."""
    options, n = paper_options(weights), len(structure.floor_heights_m)
    measurements = Measurements(
        matches, structure, make_odometry(np.eye(4)[None], OdometryOptions())
    )
    columns = Association(np.zeros(0, dtype=int), np.zeros(0))
    correspondences = PlanCorrespondences(
        floorplan, association, columns, np.full(n, np.nan), np.inf
    )
    poses = np.tile(np.eye(4), (n, 1, 1))  # terms do not depend on where a solve begins
    problem = build_problem(measurements, options, poses, correspondences)
    return [*problem.scan_terms, *problem.plan_terms]
