"""Residuals of control and check points when all is done, and what a surveyor should look at."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from planfit.adjust.left_out import CONTRADICTED_SIGMAS, PointLeftOut
from planfit.findings import Finding, SurveyKind
from planfit.geometry.se3 import Poses
from planfit.pipeline.on_plan import SurveyOnPlan
from planfit.pipeline.survey import SurveyedScan
from planfit.survey import (
    LiftedMarks,
    PointResidual,
    SurveyResiduals,
    measure_residuals,
    with_swaps,
)


def survey_residuals(
    surveyed: SurveyedScan,
    marks: LiftedMarks,
    on_plan: SurveyOnPlan,
    plan_from_cams: Poses,
    left_out: Sequence[PointLeftOut] = (),
) -> SurveyResiduals:
    """Residuals of control and check points where the poses ended, and of control points without each.

    Args:
        surveyed: the survey.
        marks: its marks as the corrected sensor sees them.
        on_plan: where the points are.
        plan_from_cams: of all frames.
        left_out: control points that took part, without each.
    """
    survey = surveyed.survey
    points = measure_residuals(survey, marks, on_plan.targets, plan_from_cams)
    of_point = {survey.points[each.point_idx].id: each for each in left_out}
    points = with_swaps([_with_left_out(point, of_point.get(point.id)) for point in points])
    seen = {point.id for point in points}
    return SurveyResiduals(
        points,
        tuple(point.id for point in survey.points if point.id not in seen),
        survey.axes,
        on_plan.height_datum_m,
        on_plan.site_from_plan,
        on_plan.site_origin,
    )


def _with_left_out(point: PointResidual, without: PointLeftOut | None) -> PointResidual:
    """A point with what the rest says of it. One that was not used took no part to begin with."""
    if point.is_check:
        return point
    if without is None:
        return replace(point, left_out_m=point.residual_m, is_used=False)
    is_told = bool(np.isfinite(without.sigma_m))
    return replace(
        point,
        left_out_m=point.residual_m + without.shift_m if is_told else None,
        left_out_sigma_m=without.sigma_m if is_told else np.nan,
        left_out_sigmas=without.sigmas if is_told else np.nan,
        is_contradicted=without.is_contradicted,
    )


BELIEVED_FACTOR = 2.0
"""Check points whose RMS is by this factor above the predicted error, and above their own sigmas, show that
something is not known."""


def contradicted_points(points: Sequence[PointResidual]) -> list[Finding]:
    """Points that the rest puts elsewhere; where it names some, those beside them are only drawn along."""
    found, told = [], set()
    for point in points:
        if point.swapped_with and point.swapped_with not in told:
            both = {"point": point.id, "other_point": point.swapped_with}
            found.append(Finding(SurveyKind.POINTS_SWAPPED, both))
            told.add(point.id)
        elif point.is_contradicted and not point.swapped_with:
            facts = {"point": point.id, "residual_m": point.length_m}
            facts |= {"left_out_m": point.left_out_length_m}
            facts |= {"left_out_sigmas": point.left_out_sigmas}
            found.append(Finding(SurveyKind.POINT_CONTRADICTED, facts))
    if any(point.is_contradicted for point in points):
        return found
    return found + [
        Finding(
            SurveyKind.POINT_OFF,
            {"point": point.id, "residual_m": point.length_m, "sigma_m": point.sigma_m},
        )
        for point in points
        if not (point.is_check or point.swapped_with)
        and point.length_m > CONTRADICTED_SIGMAS * np.sqrt(3) * point.sigma_m
    ]


def survey_findings(residuals: SurveyResiduals, predicted_rms_m: float) -> tuple[Finding, ...]:
    """What a surveyor should look at."""
    found = contradicted_points(residuals.points)
    if residuals.unseen:
        found.insert(0, Finding(SurveyKind.POINTS_UNSEEN, {"points": residuals.unseen}))
    check = residuals.check
    if check is not None:
        sigma_m = np.sqrt(3) * np.median([p.sigma_m for p in residuals.points if p.is_check])
        if check.rms_m > BELIEVED_FACTOR * np.hypot(predicted_rms_m, sigma_m):
            facts = {"rms_m": check.rms_m, "predicted_rms_m": predicted_rms_m}
            found.append(Finding(SurveyKind.CHECK_POINTS_OFF, facts))
    return tuple(found)
