"""Residuals of control and check points when all is done, and what a surveyor should look at."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from planfit.adjust.left_out import PointLeftOut
from planfit.pipeline.on_plan import SurveyOnPlan
from planfit.pipeline.survey import SurveyedScan
from planfit.survey import (
    LiftedMarks,
    PointResidual,
    SurveyResiduals,
    measure_residuals,
    with_swaps,
)
from planfit.survey.types import some_ids


def survey_residuals(
    surveyed: SurveyedScan,
    marks: LiftedMarks,
    on_plan: SurveyOnPlan,
    plan_from_cams: Float[np.ndarray, "n 4 4"],
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


CONTRADICTED_SIGMAS = 4.0
"""A control point that ends further from its place than so many sigmas contradicts the rest."""
BELIEVED_FACTOR = 2.0
"""Check points whose RMS is by this factor above the predicted error, and above their own sigmas, show that
something is not known."""


def contradicted_words(points: Sequence[PointResidual]) -> list[str]:
    """Points that the rest puts elsewhere, a sentence each; where it names some, those beside them are only
    drawn along."""
    words, told = [], set()
    for point in points:
        if point.swapped_with and point.swapped_with not in told:
            words.append(
                f"control points {point.id!r} and {point.swapped_with!r} look swapped: without them, the "
                "other evidence puts each in the other's place; check their ids"
            )
            told.add(point.id)
        elif point.is_contradicted and not point.swapped_with:
            words.append(
                f"control point {point.id!r} contradicts the other evidence, which without it puts it "
                f"{point.left_out_length_m:.2f} m from where it was surveyed "
                f"({point.left_out_sigmas:.0f} sigmas); it ends {point.length_m:.2f} m off; check its "
                "coordinates and marks, or leave it out"
            )
    if any(point.is_contradicted for point in points):
        return words
    return words + [
        f"control point {point.id!r} ends {point.length_m:.2f} m from where it was surveyed, against "
        f"a sigma of {point.sigma_m:.3f} m: it contradicts the other evidence; check its coordinates "
        "and marks"
        for point in points
        if not (point.is_check or point.swapped_with)
        and point.length_m > CONTRADICTED_SIGMAS * np.sqrt(3) * point.sigma_m
    ]


def survey_warnings(residuals: SurveyResiduals, predicted_rms_m: float) -> tuple[str, ...]:
    """What a surveyor should look at, a sentence each."""
    words = []
    if residuals.unseen:
        words.append(f"no frame sees the surveyed points {some_ids(list(residuals.unseen))}")
    words += contradicted_words(residuals.points)
    check = residuals.check
    if check is not None:
        sigma_m = np.sqrt(3) * np.median([p.sigma_m for p in residuals.points if p.is_check])
        if check.rms_m > BELIEVED_FACTOR * np.hypot(predicted_rms_m, sigma_m):
            words.append(
                f"check points are off by {check.rms_m:.2f} m (RMS), more than the predicted error of "
                f"{predicted_rms_m:.2f} m: believe the check points, and see which are off in the report"
            )
    return tuple(words)
