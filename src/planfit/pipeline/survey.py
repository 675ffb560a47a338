"""Control and check points in a refinement: seen, brought onto the plan, held to, measured in the end.

Control points first straighten the scan, whose drift would else keep them from agreeing with any one
alignment; three of them then say where on the plan it is, whatever the walls look like; in the adjustment
they are a term beside the others. Check points are measured when all is done.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from planfit.adjust import build_problem
from planfit.adjust.terms.control import ControlMarks
from planfit.alignment import SETTLED_BY_POINTS
from planfit.alignment.options import ControlPoint
from planfit.alignment.refine import AlignmentHypothesis, explained
from planfit.alignment.wall_samples import thin
from planfit.errors import OptionError
from planfit.findings import Finding, SurveyKind, some_ids
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.lsq import Problem
from planfit.matching.verify import point_sigma
from planfit.pipeline.align import align_to_plan, wall_samples
from planfit.pipeline.given import Given
from planfit.pipeline.on_plan import STANDS_ALONE, ScanOnPlan, SurveyOnPlan
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.places_and_walls import against_walls
from planfit.pipeline.prepare import PreparedScan
from planfit.runtime import StageTimer, short_repr
from planfit.scan import Scan
from planfit.survey import (
    LiftedMarks,
    PlacedPoints,
    SiteFit,
    Survey,
    find_marks,
    fit_site,
    place_points,
)
from planfit.survey.fit import are_apart, are_on_a_line, height_shift, require_fit
from planfit.survey.residuals import find_blunders
from planfit.tracking import choose_keyframes

WELL_PLACED_M = 0.1
"""Where the furthest camera is surer than this (standard deviation), control points alone place the scan:
walls find their faces from there."""
NARROWING = 4.0
"""Factor between the widths of the loss while the scan is straightened, from what the worst mark asks for."""


@dataclass(frozen=True)
class SurveyedScan:
    """A survey, and where the scan sees it."""

    survey: Survey
    marks: LiftedMarks
    """Of control and check points, as the nominal sensor lifts them."""
    placed: PlacedPoints

    __repr__ = short_repr

    @property
    def control(self) -> ControlMarks:
        """Marks of control points alone, without targets: all that the solves are told."""
        own = self.marks[~self.survey.is_check[self.marks.point_idx]]
        sigma_m = np.hypot(self.survey.sigmas_m[own.point_idx], own.sigma_m)
        return ControlMarks(own.points_cam, own.frame_idx, own.point_idx, sigma_m)


def observe_survey(given: Given, timer: StageTimer) -> SurveyedScan | None:
    """Lift all marks, and refuse now what could not be used after an hour of matching; None without a survey.

    Raises:
        OptionError: points lie off the plan, marks have no depth, there are too few points, or points on a
            line where nothing else tells where the scan is.
        ScanError: an image cannot be read.
    """
    survey, scan, floorplan, options = given.survey, given.scan, given.floorplan, given.options
    if survey is None:
        return None
    with timer.stage("survey"):
        if isinstance(floorplan, Mapping):
            raise OptionError(
                "the survey: expected one plan, found plans by storey, on which control and check points are "
                "not supported yet; refine each storey with its own plan"
            )
        placed = place_points(survey, floorplan)
        frames = choose_keyframes(scan.world_from_cams, scan.timestamps, options.keyframes)
        marks = find_marks(scan, survey, frames, point_sigma, given.runtime)
        surveyed = SurveyedScan(survey, marks, placed)
        if not survey.is_check.all() and options.adjust.control.weight <= 0:
            raise OptionError(
                "adjust.control.weight: expected a weight above 0 with control points, found 0 (the paper's "
                "preset has no such term); give a weight, or give the points as check points"
            )
        if floorplan is None:
            _require_three(surveyed)
        return surveyed


def _require_three(surveyed: SurveyedScan) -> None:
    """Without a plan, control points alone tell where the site's axes lie."""
    seen = np.unique(surveyed.control.point_idx)
    if len(seen) < 3:
        raise OptionError(
            f"the survey: expected three control points or more that frames see, as there is no plan, found "
            f"{len(seen)}; mark more points, or give a plan"
        )
    if are_on_a_line(surveyed.placed.xyz[seen]):
        names = [surveyed.survey.points[k].id for k in seen]
        raise OptionError(
            f"the survey: expected control points that do not stand on one line, found {some_ids(names)} on "
            "one; add a point beside it"
        )


@dataclass(frozen=True)
class HeldScan:
    """A scan whose drift control points have taken out, and what they say of its alignment."""

    prepared: PreparedScan
    fit: SiteFit | None
    """To the level frame; None where fewer than two points tell no heading."""
    pins: tuple[ControlPoint, ...]
    """Points as the search takes them."""
    is_placed: bool
    """Whether control points alone say where the scan is, not the walls near there."""
    height_shift_m: float
    """Added to heights of the survey: heights above the floor."""
    findings: tuple[Finding, ...] = ()

    __repr__ = short_repr


def hold_by_control(
    prepared: PreparedScan, surveyed: SurveyedScan, is_metric: bool, options: RefineOptions
) -> HeldScan:
    """Straighten a scan by its control points, as they lie to each other.

    Raises:
        OptionError: points and scan do not fit, and a mistake in the survey explains it.
    """
    placed, own_datum = surveyed.placed, surveyed.placed.has_own_datum
    idx, level, walked_m = _seen_points(prepared)
    site = placed.xyz[idx]
    if not are_apart(level):
        return _near_points(prepared, level, site, own_datum)
    fit = fit_site(level, site, is_metric, own_datum)
    require_fit(fit, level, site)
    in_metres = site * (fit.scale, fit.scale, 1.0)
    is_off = find_blunders(level, in_metres, walked_m)
    prepared = _without_points(prepared, idx[is_off])
    level, site = level[~is_off], site[~is_off]
    findings = _findings(surveyed.survey, idx[is_off], site)
    if not are_apart(level):
        return replace(_near_points(prepared, level, site, own_datum), findings=findings)
    fit = fit_site(level, site, is_metric, own_datum, is_robust=False)
    prepared = _straightened(prepared, fit.to_level(placed.xyz), options)
    # Once more: drift has bent what the first fit went by.
    _, level, _ = _seen_points(prepared)
    fit = fit_site(level, site, is_metric, own_datum, is_robust=False)
    # Two points tell heading and place, as gravity is known. But of two, or of points on a line, a
    # mirrored site looks like a right one, and points close together tell the heading badly: the walls keep
    # a say then, near where the points are.
    return HeldScan(
        prepared,
        fit,
        tuple(ControlPoint(p[:2], q[:2]) for p, q in zip(level, site, strict=True)),
        is_metric and not are_on_a_line(site) and _reach_m(prepared, level) < WELL_PLACED_M,
        height_shift(level, site, own_datum),
        findings,
    )


def _near_points(
    prepared: PreparedScan,
    level: Float[np.ndarray, "p 3"],
    site: Float[np.ndarray, "p 3"],
    own_datum: bool,
) -> HeldScan:
    """What points at one place tell: where it is, and no heading."""
    pins = tuple(ControlPoint(p[:2], q[:2]) for p, q in zip(level, site, strict=True))
    return HeldScan(prepared, None, pins, False, height_shift(level, site, own_datum))


def _reach_m(prepared: PreparedScan, level: Float[np.ndarray, "p 3"]) -> float:
    """Standard deviation of the furthest camera if control points alone say where the scan is, m."""
    middle = level[:, :2].mean(axis=0)
    lever = np.linalg.norm(level[:, :2] - middle)
    far_m = np.linalg.norm(prepared.level_from_keys[:, :2, 3] - middle, axis=1).max()
    sigma_m = np.median(prepared.measurements.control.sigma_m)
    return float(sigma_m * np.hypot(1.0 / np.sqrt(len(level)), far_m / lever))


def _without_points(prepared: PreparedScan, points: Int[np.ndarray, " b"]) -> PreparedScan:
    """The scan without marks of some points."""
    marks = prepared.measurements.control
    kept = ~np.isin(marks.point_idx, points)
    return replace(prepared, measurements=replace(prepared.measurements, control=marks[kept]))


def _seen_points(
    prepared: PreparedScan,
) -> tuple[Int[np.ndarray, " p"], Float[np.ndarray, "p 3"], Float[np.ndarray, " p"]]:
    """Numbers of control points that have marks, their weighted means, level frame, and how far the camera
    had walked where it first saw them, m."""
    marks = prepared.measurements.control
    seen = se3.transform_each(prepared.level_from_keys[marks.pose_idx], marks.points_cam)
    weights = marks.sigma_m**-2.0
    idx, own = np.unique(marks.point_idx, return_inverse=True)
    total = np.bincount(own, weights, len(idx))
    sums = [np.bincount(own, weights * seen[:, axis], len(idx)) for axis in range(3)]
    steps_m = np.linalg.norm(np.diff(prepared.level_from_keys[:, :3, 3], axis=0), axis=1)
    walked_m = np.concatenate([[0.0], np.cumsum(steps_m)])
    first = np.full(len(idx), np.inf)
    np.minimum.at(first, own, walked_m[marks.pose_idx])
    return idx, np.stack(sums, axis=1) / total[:, None], first


def _straightened(
    prepared: PreparedScan, level: Float[np.ndarray, "p 3"], options: RefineOptions
) -> PreparedScan:
    """The scan's own terms and the control points, whose loss narrows from where drift has put them."""
    marks, poses = prepared.measurements.control, prepared.level_from_keys
    held = replace(prepared.measurements, control=replace(marks, targets=level[marks.point_idx]))
    problem = build_problem(held, options.adjust, poses)
    control = problem.control
    assert control is not None
    seen = se3.transform_each(poses[marks.pose_idx], marks.points_cam)
    off = np.linalg.norm(np.nan_to_num(seen - level[marks.point_idx]), axis=1) / marks.sigma_m
    width = max(float(off.max()) / options.adjust.model("control").loss.scale, 1.0)
    n_stages = 1 + int(np.ceil(np.log(width) / np.log(NARROWING)))
    others = [term for term in problem.terms if term is not control]
    for factor in np.geomspace(width, 1.0, n_stages) if n_stages > 1 else [1.0]:
        terms = [*others, control.with_wider_loss(float(factor))]
        poses = Problem(terms, poses).solve(options.adjust.solver).target_from_cams
    return replace(prepared, level_from_keys=poses)


def _findings(
    survey: Survey, off: Int[np.ndarray, " b"], site: Float[np.ndarray, "p 3"]
) -> tuple[Finding, ...]:
    found = [Finding(SurveyKind.POINT_NOT_USED, {"point": survey.points[k].id}) for k in off]
    if 0 < len(site) < 3:
        found.append(Finding(SurveyKind.FEW_POINTS_SEEN, {"point_count": len(site)}))
    elif len(site) >= 3 and are_on_a_line(site):
        found.append(Finding(SurveyKind.POINTS_ON_A_LINE))
    return tuple(found)


def on_plan_by_control(held: HeldScan, surveyed: SurveyedScan, on_plan: ScanOnPlan) -> ScanOnPlan:
    """Where control points say that the scan is, and where they themselves are."""
    placed, found = surveyed.placed, on_plan.alignment
    xyz = placed.xyz.copy()
    xyz[:, 2] += held.height_shift_m
    plan_from_level, site_from_plan = on_plan.plan_from_level, None
    if on_plan.floorplan is None:
        # The target is the level frame: the site's axes are where the fit puts them.
        assert held.fit is not None  # three points off a line were required
        xyz = held.fit.to_level(placed.xyz)
        site_from_plan = se3.inverse(held.fit.level_from_site)
    elif held.fit is not None and (
        held.is_placed or (found is None and on_plan.floorplan.is_metric)
    ):
        plan_from_level = se3.inverse(held.fit.level_from_site)
        plan_from_level[2, 3] = 0.0  # the floor is at z = 0 in both frames
        if found is not None:
            found = replace(found, plan_from_level=plan_from_level)
    elif found is not None:
        xyz[:, :2] *= found.scale_xy
    if found is not None and held.fit is not None:
        # The search was held to the points: that the walls would leave the place open says nothing any more.
        told = tuple(each for each in found.findings if each.kind not in SETTLED_BY_POINTS)
        found = replace(found, is_surveyed=True, is_sure=True, findings=told)
    has_datum = placed.has_own_datum and len(held.prepared.measurements.control) > 0
    if placed.has_own_datum and not has_datum:
        xyz[:, 2] = np.nan  # nothing tells where its heights count from
    return replace(
        on_plan,
        plan_from_level=plan_from_level,
        alignment=found,
        survey=SurveyOnPlan(
            targets=xyz,
            is_placed=held.fit is not None,
            height_datum_m=-held.height_shift_m + placed.origin[2] if has_datum else None,
            site_from_plan=site_from_plan,
            site_origin=placed.origin,
            findings=held.findings,
        ),
    )


def place_by_control(
    scan: Scan,
    prepared: PreparedScan,
    surveyed: SurveyedScan,
    floorplan: Floorplan | None,
    options: RefineOptions,
    timer: StageTimer,
) -> tuple[PreparedScan, ScanOnPlan]:
    """The scan straightened by its control points and brought onto the plan with their help.

    Points in the axes of a plan in metres say that it is, so its scale is not doubted then.

    Raises:
        FloorplanError: as for `align_to_plan`.
        OptionError: points and scan do not fit.
    """
    is_metric = floorplan is None or floorplan.is_metric
    with timer.stage("control points"):
        held = hold_by_control(prepared, surveyed, is_metric, options)
    on_plan = STANDS_ALONE
    if floorplan is not None:
        if held.fit is not None and is_metric:
            drawn = replace(options.align, metric_scale_tolerance=0.0)
            options = replace(options, align=drawn)
        on_plan = align_to_plan(scan, held.prepared, floorplan, options, timer, held.pins)
    on_plan = on_plan_by_control(held, surveyed, on_plan)
    if floorplan is not None:
        with timer.stage("align"):
            on_plan = _with_own_score(on_plan, held)
            idx = np.unique(held.prepared.measurements.control.point_idx)
            pins = {surveyed.survey.points[k].id: p for k, p in zip(idx, held.pins, strict=True)}
            on_plan = against_walls(on_plan, held.prepared, floorplan, options, pins)
    return with_targets(held.prepared, on_plan), on_plan


def _with_own_score(on_plan: ScanOnPlan, held: HeldScan) -> ScanOnPlan:
    """The share of wall that the plan explains where the points put the scan, not where the search ended."""
    found, plan = on_plan.alignment, on_plan.floorplan
    if found is None or plan is None or not held.is_placed:
        return on_plan
    walls = wall_samples(held.prepared.measurements.structure, held.prepared.level_from_keys)
    here = AlignmentHypothesis.from_transform(on_plan.plan_from_level)
    score, _ = explained(thin(walls), plan.used(), here)
    return replace(on_plan, alignment=replace(found, score=score))


def with_targets(prepared: PreparedScan, on_plan: ScanOnPlan) -> PreparedScan:
    """The scan with its marks told where the points are; the very same one without a survey or marks."""
    marks, survey = prepared.measurements.control, on_plan.survey
    if survey is None or len(marks) == 0:
        return prepared
    told = replace(marks, targets=survey.targets[marks.point_idx])
    return replace(prepared, measurements=replace(prepared.measurements, control=told))
