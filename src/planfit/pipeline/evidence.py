"""What speaks for and against a result: above all, solves that do without whole visits and walls.

Each fold of a cross-validation keeps out a fifth of the visits and of the walls (`planfit.pipeline.folds`)
and solves again from the result. What was kept out is then measured where these poses put it: it had no say
in them. And how far the poses move between folds shows how far they may be off: what is wrong pulls one way,
what is right another (delete-a-group jackknife, Shao and Wu 1989).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float

from planfit.adjust import (
    AdjustmentProblem,
    AdjustOptions,
    Measurements,
    PlanAdjustment,
    TornStep,
    build_problem,
    costs,
    moved_wall_findings,
)
from planfit.adjust.association import PlanCorrespondences
from planfit.adjust.calibration import NOT_CALIBRATED, Calibration, CalibrationPriors
from planfit.adjust.left_out import PointLeftOut, leave_out_control
from planfit.adjust.observability import frames_held
from planfit.adjust.torn_steps import find_broken_steps
from planfit.adjust.uncertainty import probability_within
from planfit.alignment import AdjustedAlignment, AlignOptions, OtherScale, judge_adjusted
from planfit.findings import Finding
from planfit.lsq import Term
from planfit.lsq.covariance import blocks_of_inverse
from planfit.matching.cycles import TRANSLATION_SLACK_M
from planfit.pipeline.align import wall_samples
from planfit.pipeline.calibrate import shared_error
from planfit.pipeline.disagreements import Disagreement, find_disagreements
from planfit.pipeline.folds import (
    FoldedSolves,
    choose_folds,
    walls_near_plan,
    without_fold,
)
from planfit.pipeline.links import Link, Visit, judge_links, judge_visits
from planfit.pipeline.on_plan import ScanOnPlan, Storey
from planfit.pipeline.predicted_error import (
    StatedCovariances,
    brought_close,
    frames_compared,
    interpolated,
    predicted_covariance,
    spread_of_rivals,
)
from planfit.pipeline.prepare import PreparedScan
from planfit.pipeline.storeys import judge_storeys
from planfit.pipeline.strength import DirectionStrength, directions_held
from planfit.runtime import blas_on_one_thread, give_back_memory, in_threads, short_repr

FOLD_TOLERANCE = 1e-4
"""A fold's solve ends when a round lowers the cost by less than this share of itself."""
CONTRADICTED_M = TRANSLATION_SLACK_M
"""A visit whose matches end further apart (median) is contradicted by the result."""
DRIFT_COST = 3.0
"""See `Evidence.scan_costs`."""


@dataclass(frozen=True)
class Stretch:
    """A stretch of the walk, and what the evidence says of it."""

    frames: tuple[int, int]
    """First and last frame, as numbered in the scan."""
    predicted_m: float
    """Predicted error of the camera positions, root mean square."""
    open_direction: tuple[float, float] | None
    """Unit direction on the plan along which nearly all of it lies; None where it lies all ways."""
    n_patches: int
    """Wall patches seen; none where there is no plan to hold them to."""
    near_before: float
    """Share of them within `NEAR_FACE_M` of a face of their side, poses as recorded; NaN without patches."""
    near_kept_out: float
    """The same by the solve that did without them."""
    beside: float
    """Share of them that the solve without them puts beside a face: further off, but within `BESIDE_M`."""


@dataclass(frozen=True)
class Evidence:
    """What speaks for and against a result; n frames."""

    pose_covariances: Float[np.ndarray, "n 6 6"]
    """Of each camera pose [rad^2, rad m, m^2], tangents (rotation, translation) as in
    `planfit.geometry.se3`, axes of the plan, which is taken to be at the scale that was used; where nothing
    fixed holds the whole, once brought to the truth as one. Infinite variances where nothing was measured."""
    correction_m: Float[np.ndarray, " n"]
    """How far each camera was moved from where it was recorded; where nothing fixed holds the whole, once
    the recorded positions are brought to the refined ones as one."""
    stretches: tuple[Stretch, ...]
    visits: tuple[Visit, ...]
    torn: tuple[TornStep, ...]
    """Steps of the path, in their order, where the result breaks it."""
    alignment: AdjustedAlignment | None
    """Of the adjusted walls; None without a plan or walls."""
    scan_costs: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Misfit (robust cost) of each term that needs no plan: loops closed, and when the walls have pulled. At
    least `DRIFT_COST` a frame, which is what correcting drift by walls costs where nothing else corrects
    it."""
    is_placed: bool = True
    """Whether the scan stands on its plan, if there is one."""
    rival_error_m: float = 0.0
    """Part of the predicted error (RMS) that other optima have in it: where else the scan fits the plan about
    as well, with other walls taken for moved."""
    moved_walls: tuple[Finding, ...] = ()
    """Walls that were taken for moved."""
    is_alone: bool = False
    """Whether nothing fixed holds the whole: no plan, and no positions that are known."""
    is_measured: bool = True
    """Whether anything but the recorded motion holds any frame: a match, the floor, a wall of the plan."""
    unplaced: tuple[tuple[int, int], ...] = ()
    """Runs of frames, first and last, at whose place nothing was tracked or matched."""
    tracking_doubt: Finding | None = None
    """Why the recorded poses as a whole say nothing of the images; None where they do."""
    disagreements: tuple[Disagreement, ...] = ()
    """Visits and walls that the rest puts elsewhere, the most suspect first, and what they stand against."""
    without_plan: tuple[Storey, ...] = ()
    """Storeys that were walked and have no plan, where others have one."""
    strength: tuple[DirectionStrength, ...] = ()
    """What fixes x, y, z and heading; in this order."""
    left_out: tuple[PointLeftOut, ...] = ()
    """Control points that took part, each left out in turn."""
    leaps: tuple[tuple[int, int], ...] = ()
    """Frames before and after jumps by whose correction the walk leaps, as none can."""
    links: tuple[Link, ...] = ()
    """Stretches of the walk that pairs of frames hold together: by how much they overlap and agree."""

    __repr__ = short_repr

    @property
    def predicted_error_m(self) -> Float[np.ndarray, " n"]:
        """Of each camera position, one standard deviation of its length."""
        return np.sqrt(np.trace(self.pose_covariances[:, 3:, 3:], axis1=1, axis2=2))

    def probability_within(self, tolerance_m: float) -> Float[np.ndarray, " n"]:
        """That each camera's position is off by no more than a tolerance."""
        return probability_within(self.pose_covariances[:, 3:, 3:], tolerance_m)

    def share_within(self, tolerance_m: float) -> float:
        """Share of the frames that are expected to be off by no more than a tolerance, but for frames that
        nothing places."""
        return float(self.probability_within(tolerance_m)[self._is_placed_frame].mean())

    @property
    def worst_frame(self) -> int:
        """The frame whose position is predicted to be off most, but for frames that nothing places."""
        return int(np.argmax(np.where(self._is_placed_frame, self.predicted_error_m, -1.0)))

    @property
    def is_place_sure(self) -> bool:
        """Whether the adjusted walls surely lie where they belong on the plan."""
        return self.alignment is not None and self.alignment.doubt is None

    @property
    def other_scale(self) -> OtherScale | None:
        """At which a plan in metres, taken as drawn, would fit clearly better; None where there is none."""
        return None if self.alignment is None else self.alignment.other_scale

    @property
    def predicted_rms_m(self) -> float:
        """Predicted error of the whole but for frames that nothing places, root mean square."""
        return _rms(self.predicted_error_m[self._is_placed_frame])

    @property
    def correction_rms_m(self) -> float:
        """How far the cameras were moved but for frames that nothing places, root mean square."""
        return _rms(self.correction_m[self._is_placed_frame])

    @property
    def _is_placed_frame(self) -> Bool[np.ndarray, " n"]:
        is_placed = np.ones(len(self.pose_covariances), dtype=bool)
        for first, last in self.unplaced:
            is_placed[first : last + 1] = False
        return is_placed

    @property
    def near_shares(self) -> tuple[float, float] | None:
        """Share of wall patches near the plan: as recorded, and kept out; None where none was seen."""
        counts = np.array([s.n_patches for s in self.stretches], dtype=float)
        if counts.sum() == 0:
            return None
        seen = [s for s in self.stretches if s.n_patches]
        shares = np.array([[s.near_before, s.near_kept_out] for s in seen])
        before, after = counts[counts > 0] @ shares / counts.sum()
        return float(before), float(after)

    @property
    def visit_distances_m(self) -> tuple[float, float] | None:
        """Median over visits of the distance between sightings: as recorded, and kept out."""
        if not self.visits:
            return None
        both = np.array([[v.before_m, v.kept_out_m] for v in self.visits])
        before, after = np.median(both, axis=0)
        return float(before), float(after)


def gather_evidence(
    prepared: PreparedScan,
    on_plan: ScanOnPlan,
    adjustment: PlanAdjustment,
    options: AdjustOptions,
    align_options: AlignOptions,
    n_folds: int,
    rng: np.random.Generator,
    extra_terms: Sequence[Term] = (),
    calibration: Calibration = NOT_CALIBRATED,
    priors: CalibrationPriors | None = None,
) -> Evidence:
    """Solve without each fold, and measure what was kept out.

    Args:
        n_folds: two or more.
        extra_terms: the user's own; they are kept in all folds.
        priors: of what was not; None takes the sensor to be as its files say.
    """
    measurements, keyframes = prepared.measurements, prepared.keyframes
    solved = adjustment.solution.target_from_cams
    recorded = on_plan.recorded_plan_from_level @ prepared.level_from_cams
    recorded = recorded[keyframes.frame_idx]
    folds = choose_folds(measurements, recorded, n_folds, rng)
    # A fold begins where the result ended; what changes its cost by less moves no pose by a sigma.
    tolerance = max(FOLD_TOLERANCE, options.solver.cost_tolerance)
    of_folds = replace(options, solver=replace(options.solver, cost_tolerance=tolerance))

    def problem_of(
        reduced: Measurements, correspondences: PlanCorrespondences | None
    ) -> AdjustmentProblem:
        return build_problem(reduced, of_folds, solved, correspondences, extra_terms)

    def solve(
        reduced: Measurements, correspondences: PlanCorrespondences | None
    ) -> Float[np.ndarray, "k 4 4"]:
        return problem_of(reduced, correspondences).solve().target_from_cams[: len(solved)]

    compared = frames_compared(folds.stretch)

    def without(fold: int) -> tuple[Float[np.ndarray, "k 4 4"], Float[np.ndarray, "s 6 6"]]:
        problem = problem_of(*without_fold(measurements, adjustment.correspondences, folds, fold))
        stated = blocks_of_inverse(problem.terms, problem.unknowns, compared)
        return problem.solve().target_from_cams[: len(solved)], stated

    with blas_on_one_thread():
        by_fold, stated = zip(*in_threads(without, range(folds.count)), strict=True)
    solves = FoldedSolves(prepared, adjustment, folds, recorded, by_fold)
    give_back_memory()  # each fold had a copy of the points that it kept
    problem = build_problem(measurements, options, solved, adjustment.correspondences, extra_terms)
    shared = None if priors is None else shared_error(problem, on_plan, calibration, priors)
    covariances = StatedCovariances(
        compared, blocks_of_inverse(problem.terms, problem.unknowns, compared), np.array(stated)
    )
    covariance = predicted_covariance(
        problem, adjustment.rivals, folds, by_fold, covariances, rng, shared
    )
    spread = spread_of_rivals(solved, adjustment.rivals)
    near = walls_near_plan(solves, on_plan.floorplan, options)
    of_positions = covariance[:, 3:, 3:]
    before = recorded[:, :3, 3]
    if problem.gauge is not None:
        before = brought_close(before, solved[:, :3, 3])
    correction_m = np.linalg.norm(solved[:, :3, 3] - before, axis=1)
    every, keys = np.arange(len(keyframes.nearest)), keyframes.frame_idx
    found = Evidence(
        pose_covariances=interpolated(covariance, every, keys),
        correction_m=np.interp(every, keys, correction_m),
        stretches=_stretches(solves, of_positions, near),
        visits=judge_visits(solves),
        torn=find_broken_steps(measurements, solved),
        disagreements=find_disagreements(solves, solve),
        alignment=_judge_alignment(prepared, on_plan, solved, align_options),
        scan_costs=_scan_costs(prepared, solved, options),
        is_placed=on_plan.is_placed,
        rival_error_m=_rms(np.sqrt(np.trace(spread, axis1=1, axis2=2))),
        moved_walls=_moved_walls(on_plan, adjustment),
        is_alone=problem.gauge is not None,
        unplaced=prepared.unplaced,
        tracking_doubt=prepared.tracking_doubt,
        leaps=prepared.leaps,
        without_plan=on_plan.storeys.without_plan if on_plan.storeys else (),
        left_out=leave_out_control(problem, solved),
        links=judge_links(solves),
        strength=directions_held(problem, solved, folds.stretch, covariance, keyframes.frame_idx),
    )
    is_measured = problem.by_hand is not None or bool(frames_held(problem, solved).any())
    return found if is_measured else _of_nothing(found)


def _of_nothing(evidence: Evidence) -> Evidence:
    """Evidence of poses that nothing measured holds: how far they are off is not known."""
    unknown = np.diag(np.full(6, np.inf))
    return replace(
        evidence,
        is_measured=False,
        pose_covariances=np.repeat(unknown[None], len(evidence.pose_covariances), axis=0),
        stretches=tuple(
            replace(each, predicted_m=np.inf, open_direction=None) for each in evidence.stretches
        ),
        strength=tuple(replace(each, sigma=np.inf) for each in evidence.strength),
    )


def _moved_walls(on_plan: ScanOnPlan, adjustment: PlanAdjustment) -> tuple[Finding, ...]:
    if on_plan.floorplan is None:
        return ()
    return moved_wall_findings(adjustment.moved_walls, on_plan.floorplan)


def _stretches(
    solves: FoldedSolves,
    covariance: Float[np.ndarray, "k 3 3"],
    near: Bool[np.ndarray, "w 3"] | None,
) -> tuple[Stretch, ...]:
    folds = solves.folds
    of_patch = folds.stretch[solves.prepared.measurements.structure.walls.frame_idx]
    stretches = []
    for k in range(folds.n_stretches):
        mean = covariance[folds.stretch == k].mean(axis=0)
        seen = np.zeros((0, 3), dtype=bool) if near is None else near[of_patch == k]
        shares = seen.mean(axis=0) if len(seen) else np.full(3, np.nan)
        stretches.append(
            Stretch(
                frames=solves.frames_of(k),
                predicted_m=float(np.sqrt(np.trace(mean))),
                open_direction=_open_direction(mean[:2, :2]),
                n_patches=len(seen),
                near_before=float(shares[0]),
                near_kept_out=float(shares[1]),
                beside=float(shares[2]),
            )
        )
    return tuple(stretches)


def _open_direction(covariance: Float[np.ndarray, "2 2"]) -> tuple[float, float] | None:
    """Direction whose sigma is three times that across it or more."""
    variances, axes = np.linalg.eigh(covariance)
    if variances[1] < 9.0 * variances[0]:
        return None
    # Of an axis and its opposite, the one whose larger entry is positive.
    x, y = axes[:, 1] * (1 if axes[np.argmax(np.abs(axes[:, 1])), 1] > 0 else -1)
    return float(x), float(y)


def _judge_alignment(
    prepared: PreparedScan,
    on_plan: ScanOnPlan,
    solved: Float[np.ndarray, "k 4 4"],
    options: AlignOptions,
) -> AdjustedAlignment | None:
    structure = prepared.measurements.structure
    if on_plan.storeys is not None:
        return judge_storeys(structure, on_plan.storeys, solved, options)
    if on_plan.alignment is None or on_plan.floorplan is None:
        return None
    walls = wall_samples(structure, solved)
    return judge_adjusted(walls, on_plan.floorplan, on_plan.alignment, options)


def _scan_costs(
    prepared: PreparedScan, solved: Float[np.ndarray, "k 4 4"], options: AdjustOptions
) -> dict[str, tuple[float, float]]:
    measurements, least = prepared.measurements, DRIFT_COST * len(solved)
    before, after = (
        costs(measurements, poses, options) for poses in (prepared.level_from_keys, solved)
    )
    return {name: (max(before[name], least), max(after[name], least)) for name in before}


def _rms(values: Float[np.ndarray, " n"]) -> float:
    return float(np.sqrt(np.mean(values**2)))
