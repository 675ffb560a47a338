"""Which terms an adjustment has: the one place that decides, for loops and for the plan.

`build_problem` looks at what was measured, at the options and at what was found in the plan, and gives each
term its role. All that depends on which terms are on (solves, costs, observability, the refit of a scale, the
paper's preset) reads the problem and does not ask again.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from planfit.adjust.association import Association, PlanCorrespondences
from planfit.adjust.measurements import Measurements
from planfit.adjust.moved_walls import MOVED_SIGMA_M
from planfit.adjust.options import AdjustOptions, check_extra_terms
from planfit.adjust.paper.descent import PAPER_SCHEDULE, PaperWeights, descend
from planfit.adjust.rigid_motion import hold_whole
from planfit.adjust.scan_terms import (
    by_hand_term,
    floor_points_term,
    geometric_term,
    odometry_term,
    surfaces_term,
)
from planfit.adjust.terms.between import OdometryTerm, PointTerm, SurfaceTerm
from planfit.adjust.terms.control import control_term
from planfit.adjust.terms.levels import LevelTerm
from planfit.adjust.terms.nearest import NearestTerm
from planfit.adjust.terms.observation_models import PAPER_ROUNDING_M
from planfit.adjust.terms.rays import RayTerm
from planfit.adjust.terms.reprojection import ReprojectionTerm
from planfit.adjust.terms.wall_offsets import (
    OffsetWallTerm,
    offset_prior,
    offset_sigmas,
    read_offsets,
    with_offsets,
)
from planfit.adjust.terms.walls import WallTerm
from planfit.errors import require
from planfit.floorplan import Floorplan
from planfit.geometry.se3 import Poses
from planfit.lsq.bounded import Allowance, solve_bounded
from planfit.lsq.pose_terms import PosePriorTerm
from planfit.lsq.problem import Problem
from planfit.lsq.residual_term import ResidualTerm
from planfit.lsq.solver import Cost, Solution
from planfit.lsq.term import Term
from planfit.segmentation import WallPatches


@dataclass(frozen=True)
class AdjustmentProblem:
    """Terms by role, and unknowns to begin with. A role without data or weight is None."""

    measurements: Measurements
    options: AdjustOptions
    correspondences: PlanCorrespondences | None
    """What was found in the plan; None while loops are closed."""
    unknowns: Float[np.ndarray, "u 4 4"]
    """Poses target_from_cams; behind them, with wall offsets, one a face."""
    n_cams: int
    geometric: PointTerm | RayTerm | ReprojectionTerm | None = None
    """What matches are held to."""
    by_hand: PointTerm | None = None
    """Matches that a person vouches for."""
    surfaces: SurfaceTerm | None = None
    """Pairs of frames matched by geometry."""
    floor: LevelTerm | None = None
    odometry: OdometryTerm | None = None
    ceiling: LevelTerm | None = None
    columns: WallTerm | None = None
    walls: WallTerm | NearestTerm | None = None
    """Faces as drawn."""
    offset_walls: OffsetWallTerm | None = None
    """Solved for instead of `walls` where faces may stand off where they are drawn."""
    offset_prior: PosePriorTerm | None = None
    moved_walls: OffsetWallTerm | None = None
    """Wall on faces that stand elsewhere than drawn: it holds frames to each other, not to the plan."""
    moved_prior: PosePriorTerm | None = None
    control: ResidualTerm | None = None
    """Points whose coordinates are known; None while nothing tells where they lie in the target frame."""
    extra: tuple[Term, ...] = ()
    """The user's."""
    gauge: PosePriorTerm | None = None
    """Holds the first frame where nothing else holds the whole."""

    @property
    def scan_terms(self) -> list[Term]:
        """Those that need no plan."""
        return _present(self.geometric, self.by_hand, self.surfaces, self.floor, self.odometry)

    @property
    def plan_terms(self) -> list[Term]:
        """Those that hold the scan to the plan, faces as drawn."""
        return _present(self.ceiling, self.columns, self.walls)

    @property
    def fixed_terms(self) -> list[Term]:
        """Those that hold poses to something that does not move: plan, control points, the user's."""
        return [*self.plan_terms, *_present(self.control), *self.extra]

    @property
    def terms(self) -> list[Term]:
        """All that are solved for. Costs are summed in this order."""
        return [*_present(self.geometric), *self.terms_but_geometric]

    @property
    def terms_but_geometric(self) -> list[Term]:
        """What geometry pays for in a bounded solve."""
        if self.offset_walls is None:
            walls = _present(self.walls)
        else:
            walls = _present(self.offset_walls, self.offset_prior)
        walls += _present(self.moved_walls, self.moved_prior)
        level = _present(
            self.by_hand, self.surfaces, self.floor, self.odometry, self.ceiling, self.columns
        )
        return [*level, *walls, *_present(self.control), *self.extra, *_present(self.gauge)]

    def costs(self, target_from_cams: Poses) -> dict[str, float]:
        """Robust cost of each term at poses, for reports; faces as drawn, without the gauge's prior."""
        terms = [*self.scan_terms, *self.fixed_terms]
        return {term.name: term.reweight(target_from_cams)[1] for term in terms}

    def solve(self, start: Float[np.ndarray, "u 4 4"] | None = None) -> Solution:
        """Solve from `start`, or from the problem's own unknowns, by the method of the options.

        Loops are closed by Levenberg-Marquardt whatever the method: the others weigh matches against a plan.

        Raises:
            OptionError: PyTorch is needed and absent.
        """
        start, options = self.unknowns if start is None else start, self.options
        if self.correspondences is None:
            return Problem(self.terms, start).solve(options.solver)
        if options.method == "sgd":
            return self._descend(self.correspondences, start)
        if options.is_bounded and self.geometric is not None:
            others = self.terms_but_geometric
            # The paper's cost is in metres: its bound is 1.05 times the least mean distance, and no more.
            allowance = (
                Allowance(slack=PAPER_ROUNDING_M) if options.cost == "paper" else Allowance()
            )
            bounded = solve_bounded([self.geometric], others, start, allowance, options.solver)
            return bounded.solution
        return Problem(self.terms, start).solve(options.solver)

    def offsets(
        self, unknowns: Float[np.ndarray, "u 4 4"]
    ) -> tuple[Float[np.ndarray, " f"], Float[np.ndarray, " f"]]:
        """Offset (m) of each face of the plan where a solve ended, and its standard deviation (m).

        Zero and NaN for faces without an offset of their own.
        """
        assert self.correspondences is not None  # there are no faces without a plan
        floorplan, face_idx = (
            self.correspondences.floorplan,
            self.correspondences.walls.face_idx,
        )
        offsets_m, sigmas_m = np.zeros(len(floorplan)), np.full(len(floorplan), np.nan)
        if self.moved_walls is not None:
            faces = self.correspondences.moved_faces
            normals = floorplan.normals[faces]
            own = self.n_cams + np.arange(len(faces))
            offsets_m[faces] = read_offsets(unknowns, self.n_cams, self.moved_walls.floorplan)
            sigmas_m[faces] = offset_sigmas(self.terms, unknowns, own, normals)
        elif self.offset_walls is not None:
            seen = np.unique(face_idx[face_idx >= 0])
            offsets_m = read_offsets(unknowns, self.n_cams, floorplan)
            sigmas_m[seen] = offset_sigmas(
                self.terms, unknowns, self.n_cams + seen, floorplan.normals[seen]
            )
        return offsets_m, sigmas_m

    def _descend(self, correspondences: PlanCorrespondences, start: Poses) -> Solution:
        """The paper's gradient descent on its own cost."""
        o, measurements, walls = self.options, self.measurements, correspondences.walls
        if measurements.kept is not None:
            measurements, walls = measurements.without_rest(), walls[measurements.kept.patches]
        descent = descend(
            measurements.matches,
            measurements.structure,
            correspondences.floorplan,
            walls,
            start,
            PaperWeights(o.floor.weight, o.walls.weight),
            PAPER_SCHEDULE,
        )
        costs = {
            term.name: Cost(term.reweight(start)[1], term.reweight(descent.target_from_cams)[1])
            for term in self.terms
        }
        return Solution(descent.target_from_cams, descent.stop, int(descent.steps[-1]), costs)


def build_problem(
    measurements: Measurements,
    options: AdjustOptions,
    target_from_cams: Poses,
    correspondences: PlanCorrespondences | None = None,
    extra_terms: Sequence[Term] = (),
) -> AdjustmentProblem:
    """Decide which terms are on, and what the unknowns are.

    Args:
        measurements: what the scan says.
        options: weights, cost, and what is solved for.
        target_from_cams: poses to begin with: plan_from_cams with correspondences, else level_from_cams.
        correspondences: what was found in the plan; None closes loops.
        extra_terms: terms of the user's own over the poses of the solved frames (see `planfit.lsq.term`).

    Raises:
        OptionError: extra terms share a name, or the method does not minimise them.
    """
    extra = tuple(extra_terms)
    problem = AdjustmentProblem(
        measurements,
        options,
        correspondences,
        target_from_cams,
        len(target_from_cams),
        geometric=geometric_term(measurements, options),
        by_hand=by_hand_term(measurements, options),
        surfaces=surfaces_term(measurements, options),
        floor=floor_points_term(measurements, options),
        odometry=odometry_term(measurements, options),
        control=control_term(measurements.control, options.model("control")),
        extra=extra,
    )
    if correspondences is not None:
        problem = _with_plan(problem, correspondences)
    # Terms of the user's own may name all unknowns, but for face offsets behind the poses.
    check_extra_terms(
        extra, options, problem.n_cams if measurements.frame_idx is not None else None
    )
    Problem(extra, target_from_cams)  # checks what every problem of the engine must be
    names = [term.name for term in problem.terms]
    shared = next((term.name for term in extra if names.count(term.name) > 1), None)
    require(
        shared is None,
        f"extra_terms: expected a name that no other term has, found {shared!r}",
    )
    is_held = problem.walls is not None or problem.columns is not None
    if not is_held and not hold_whole([*_present(problem.control), *extra], target_from_cams):
        problem = replace(problem, gauge=_gauge_prior(target_from_cams, problem.floor is not None))
    return problem


def costs(
    measurements: Measurements,
    target_from_cams: Poses,
    options: AdjustOptions,
    correspondences: PlanCorrespondences | None = None,
    extra_terms: Sequence[Term] = (),
) -> dict[str, float]:
    """Robust cost of each term at poses, for reports; faces as drawn."""
    problem = build_problem(measurements, options, target_from_cams, correspondences, extra_terms)
    return problem.costs(target_from_cams)


def _present(*terms: Term | None) -> list[Term]:
    return [term for term in terms if term is not None]


def _with_plan(
    problem: AdjustmentProblem, correspondences: PlanCorrespondences
) -> AdjustmentProblem:
    """The problem with all that the plan and the ceilings add to it."""
    measurements, options, n = problem.measurements, problem.options, problem.n_cams
    problem = replace(
        problem,
        ceiling=ceiling_term(measurements, correspondences.ceiling_heights_m, options),
        columns=_columns_term(measurements, correspondences, options),
        walls=_walls_term(measurements, correspondences, options),
    )
    if correspondences.is_moved.any():
        return _with_moved_walls(problem, correspondences)
    floorplan, sigma_m = correspondences.floorplan, options.wall_offset_sigma_m
    if problem.walls is None or options.wall_strategy != "fixed" or sigma_m <= 0:
        return problem
    patches, association = measurements.structure.walls, correspondences.walls
    return replace(
        problem,
        unknowns=with_offsets(problem.unknowns, floorplan),
        offset_walls=OffsetWallTerm(patches, floorplan, association, options.model("walls"), n),
        offset_prior=offset_prior(n, floorplan, sigma_m),
    )


def _with_moved_walls(
    problem: AdjustmentProblem, correspondences: PlanCorrespondences
) -> AdjustmentProblem:
    """Faces that stand elsewhere than drawn, each with an offset of its own behind the poses."""
    floorplan, faces, n = correspondences.floorplan, correspondences.moved_faces, problem.n_cams
    assert correspondences.moved_m is not None
    own = Floorplan(
        floorplan.name,
        floorplan.ends[faces],
        floorplan.normals[faces],
        floorplan.is_oriented[faces],
    )
    # The number of each moved face among the moved ones; -1 for patches on faces as drawn.
    number = np.full(len(floorplan) + 1, -1)
    number[faces] = np.arange(len(faces))
    association = Association(
        number[correspondences.walls.face_idx], correspondences.walls.distance_m
    )
    unknowns = with_offsets(problem.unknowns, own)
    off = correspondences.moved_m[faces][:, None] * own.normals
    unknowns[n:, :2, 3] = off
    return replace(
        problem,
        unknowns=unknowns,
        moved_walls=OffsetWallTerm(
            problem.measurements.structure.walls,
            own,
            association,
            problem.options.model("walls"),
            n,
            "moved walls",
        ),
        moved_prior=offset_prior(n, own, MOVED_SIGMA_M, "moved walls, offsets"),
    )


def ceiling_term(
    measurements: Measurements, heights_m: Float[np.ndarray, " n"], options: AdjustOptions
) -> LevelTerm | None:
    """Ceilings at heights (m) that were found for each frame; None where no frame sees a common one."""
    ceiling, points = options.model("ceiling"), measurements.structure.ceiling
    has_height = np.isfinite(heights_m)
    if ceiling.weight <= 0 or not has_height.any():
        return None
    if options.cost == "paper":
        ceiling = ceiling.as_mean(int(np.diff(points.start)[has_height].sum()))
    return LevelTerm(points, heights_m, ceiling, "ceiling", options.solver.device)


def _columns_term(
    measurements: Measurements, correspondences: PlanCorrespondences, options: AdjustOptions
) -> WallTerm | None:
    columns, association = options.model("columns"), correspondences.columns
    patches, device = measurements.structure.columns, options.solver.device
    if columns.weight <= 0 or association.n_associated == 0:
        return None
    if options.cost == "paper":
        columns = columns.as_mean(_n_associated_points(patches, association))
    floorplan = correspondences.floorplan
    return WallTerm(patches, floorplan, association, columns, "columns", device=device)


def _walls_term(
    measurements: Measurements, correspondences: PlanCorrespondences, options: AdjustOptions
) -> WallTerm | NearestTerm | None:
    """The walls term of the chosen strategy, faces as drawn; None where no wall has a face."""
    walls, association = options.model("walls"), correspondences.walls_as_drawn
    patches, is_fixed = measurements.structure.walls, options.wall_strategy == "fixed"
    if walls.weight == 0 or association.n_associated == 0:
        return None
    if measurements.kept is not None and not is_fixed:
        patches = patches.of(measurements.kept.patches)  # copied: its patches name no faces
    if options.cost == "paper":
        n_points = len(patches.points_cam)  # any of them may find its nearest point
        if is_fixed:
            n_points = _n_associated_points(patches, association)
        walls = walls.as_mean(n_points)
    floorplan = correspondences.floorplan
    if is_fixed:
        device, widths = options.solver.device, correspondences.widths
        return WallTerm(patches, floorplan, association, walls, device=device, widths=widths)
    to = "line" if options.wall_strategy == "iterative" else "point"
    reach_m, oriented = correspondences.max_distance_m, options.association.oriented
    return NearestTerm(patches, floorplan, walls, to, reach_m, oriented)


def _n_associated_points(patches: WallPatches, association: Association) -> int:
    return int(np.diff(patches.start)[association.face_idx >= 0].sum())


def _gauge_prior(target_from_cams: Poses, has_floor: bool) -> PosePriorTerm:
    """Holds the first frame where it is, but for what the floor holds: height and tilt."""
    free = np.inf if has_floor else 1e-3
    sigma = np.array([free, free, 1e-3, 1e-3, 1e-3, free])
    return PosePriorTerm(np.array([0]), target_from_cams[:1], sigma, name="gauge")
