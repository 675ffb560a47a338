"""The order of the adjustment: loops first, then walls with shrinking distances, until nothing changes.

Pulling walls at once locks onto wrong walls where drift exceeds the spacing of walls. Once matches
have closed the loops and the whole is placed on the plan, what is left is small, and a shrinking
association distance lets go of the pieces that still belong elsewhere.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from planfit.adjust.association import Association, AssociationOptions, associate
from planfit.adjust.solver import Solution, SolverOptions, solve
from planfit.adjust.terms.anchor import AnchorTerm
from planfit.adjust.terms.base import Term
from planfit.adjust.terms.floor import FloorOptions, FloorTerm
from planfit.adjust.terms.points import PointOptions, PointTerm
from planfit.adjust.terms.trajectory import TrajectoryOptions, TrajectoryTerm
from planfit.adjust.terms.walls import WallOptions, WallTerm
from planfit.errors import OptionError
from planfit.floorplan import Floorplan
from planfit.matching import Matches
from planfit.scan.odometry import Odometry
from planfit.structure import Structure


@dataclass(frozen=True)
class AdjustOptions:
    """Terms, solver and schedule of the bundle adjustment."""

    points: PointOptions = field(default_factory=PointOptions)
    """3D point error."""
    floor: FloorOptions = field(default_factory=FloorOptions)
    """Floor term."""
    walls: WallOptions = field(default_factory=WallOptions)
    """Walls term."""
    trajectory: TrajectoryOptions = field(default_factory=TrajectoryOptions)
    """Trajectory prior."""
    association: AssociationOptions = field(default_factory=AssociationOptions)
    """Which face a piece of wall may belong to."""
    solver: SolverOptions = field(default_factory=SolverOptions)
    """When a solve ends."""
    wall_distances_m: tuple[float, ...] = (1.2, 0.8, 0.6, 0.45, 0.35)
    """Association distances, one after the other."""
    max_alternations: int = 5
    """Rounds of association and solve at one distance; ends earlier when no association changes."""

    def __post_init__(self) -> None:
        if not self.wall_distances_m or min(self.wall_distances_m) <= 0:
            raise OptionError(
                f"wall_distances_m: expected positive distances, found {self.wall_distances_m}"
            )


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


def close_loops(
    evidence: Evidence, level_from_cams: np.ndarray, options: AdjustOptions
) -> Solution:
    """Make the scan agree with itself: matches, floor and trajectory, the first frame held.

    The floor, where seen, gives height and tilt; of the first frame only the rest is held.
    """
    has_floor = bool(options.floor.weight > 0 and len(evidence.structure.floor_points_cam))
    free = np.inf if has_floor else 1e-3
    sigma = np.array([free, free, 1e-3, 1e-3, 1e-3, free])
    anchor = AnchorTerm(np.array([0]), level_from_cams[:1], sigma)
    return solve([*evidence.terms(options), anchor], level_from_cams, options.solver)


@dataclass(frozen=True)
class WallsPulled:
    """Poses on the plan, and what the walls were associated with in the end."""

    solution: Solution
    association: Association
    rounds: int
    """Associations made."""
    settled: bool
    """Whether the last association did not change any more."""


def pull_walls(
    evidence: Evidence,
    floorplan: Floorplan,
    plan_from_cams: np.ndarray,
    options: AdjustOptions,
    on_round: Callable[[int], None] | None = None,
) -> WallsPulled:
    """Alternate association and solve (paper, Sec. III-D), with association distances that shrink.

    Args:
        evidence: what the scan says.
        floorplan: the plan.
        plan_from_cams: (n, 4, 4) poses placed on the plan, loops closed.
        options: see there.
        on_round: told the number of each round.
    """
    base = evidence.terms(options)
    structure, rounds, settled = evidence.structure, 0, False
    solution: Solution | None = None
    association = Association(np.zeros(0, dtype=int), np.zeros(0))
    for max_distance_m in options.wall_distances_m:
        association = associate(
            structure, floorplan, plan_from_cams, max_distance_m, options.association
        )
        for _ in range(options.max_alternations):
            rounds += 1
            if on_round:
                on_round(rounds)
            terms = list(base)
            if association.n_associated and options.walls.weight > 0:
                terms.append(WallTerm(structure, floorplan, association, options.walls))
            else:
                # Nothing ties the scan to the plan: the place that was found holds it.
                sigma = np.full(6, 1e-3)
                terms.append(AnchorTerm(np.array([0]), plan_from_cams[:1], sigma))
            solution = solve(terms, plan_from_cams, options.solver)
            plan_from_cams = solution.target_from_cams
            again = associate(
                structure, floorplan, plan_from_cams, max_distance_m, options.association
            )
            settled = bool(np.array_equal(again.face_idx, association.face_idx))
            association = again
            if settled:
                break
    assert solution is not None  # wall_distances_m is never empty
    return WallsPulled(solution, association, rounds, settled)
