"""The registration as surveyors report it: what fits, what was held out, and the accuracy that follows.

How well something fits that was fitted is no accuracy. So each figure stands in one of two columns, and the
accuracy rests on what was held out alone: check points, and solves without parts of the evidence.
"""

from dataclasses import dataclass

import numpy as np

from planfit.adjust.uncertainty import radius_95
from planfit.pipeline.evidence import Evidence
from planfit.pipeline.links import Link, Visit
from planfit.pipeline.strength import DirectionStrength
from planfit.pipeline.validation import Check
from planfit.runtime import short_repr
from planfit.survey import SurveyResiduals

LOA_CLASSES = (("LOA50", 0.001), ("LOA40", 0.005), ("LOA30", 0.015), ("LOA20", 0.05))
"""Levels of accuracy of the U.S. Institute of Building Documentation (Level of Accuracy Specification, Guide
C120, version 3), each with the largest deviation (m) that 95 % keep to; beyond, LOA10."""
FACTOR_95, FACTOR_95_FLAT = (float(radius_95(np.eye(d)[None] / d)[0]) for d in (3, 2))
"""From the RMS of lengths of residuals to the radius that holds 95 %, residuals being normal and alike along
all axes: in space; and seen from above, where no height is known."""
MANY_CHECK_POINTS = 20
"""The U.S. National Standard for Spatial Data Accuracy (FGDC-STD-007.3-1998) asks for as many."""


@dataclass(frozen=True)
class RegistrationRow:
    """One kind of residual."""

    name: str
    unit: str
    before: float | None
    """Poses as recorded; None where it was not measured."""
    fit: float | None
    """Of what the poses were fitted to."""
    held_out: float | None
    """Of what had no say in them."""
    count: int


@dataclass(frozen=True)
class Registration:
    """Residuals, fitted and held out, and the accuracy of the poses."""

    rows: tuple[RegistrationRow, ...]
    predicted_95_m: float
    """95 of 100 camera positions are predicted to be as near to the truth, or nearer."""
    checked_95_m: float | None
    """The same by the residuals of check points; None without any."""
    stated_95_m: float | None
    """The larger of both; None where nothing but the fit to the plan tells."""
    loa: str
    """Class of that; empty where none is stated."""
    basis: str
    """What the accuracy rests on, in a sentence."""
    strength: tuple[DirectionStrength, ...] = ()
    """What fixes x, y, z and heading."""
    loops: tuple[Visit, ...] = ()
    """Places seen again, that with the largest mean distance first."""
    links: tuple[Link, ...] = ()
    """Stretches of the walk held together by what both see, the one that agrees least first."""

    __repr__ = short_repr


def register(
    evidence: Evidence, checks: tuple[Check, ...], survey: SurveyResiduals | None
) -> Registration:
    """Gather residuals, and say how accurate the poses are by what was held out.

    Args:
        evidence: solves without parts of the evidence.
        survey: control and check points, where there are some.
    """
    of_frames = radius_95(evidence.pose_covariances[:, 3:, 3:])
    is_placed = np.isfinite(of_frames)
    for first, last in evidence.unplaced:
        is_placed[first : last + 1] = False
    predicted = float(np.quantile(of_frames[is_placed], 0.95)) if is_placed.any() else np.inf
    check = None if survey is None else survey.check
    control = None if survey is None else survey.control
    checked = None
    if check is not None:
        factor = FACTOR_95_FLAT if check.rms_height_m is None else FACTOR_95
        checked = factor * check.rms_m
    is_told = check is not None or control is not None or len(evidence.visits) > 0
    stated = max(predicted, checked or 0.0) if is_told else None
    return Registration(
        (*_rows_of_scan(evidence, checks), *_rows_of_survey(survey)),
        predicted,
        checked,
        stated,
        "" if stated is None else loa_class(stated),
        _basis(evidence, survey),
        evidence.strength,
        tuple(sorted(evidence.visits, key=lambda visit: -visit.mean_m)),
        tuple(sorted(evidence.links, key=lambda link: -link.after_m)),
    )


def loa_class(deviation_m: float) -> str:
    """The level of accuracy whose bound 95 % of deviations keep to."""
    return next((name for name, bound_m in LOA_CLASSES if deviation_m <= bound_m), "LOA10")


def _rows_of_scan(evidence: Evidence, checks: tuple[Check, ...]) -> list[RegistrationRow]:
    rows = []
    if evidence.visits:
        both = np.array([[v.before_m, v.after_m, v.kept_out_m] for v in evidence.visits])
        before, fit, held_out = (float(v) for v in np.median(both, axis=0))
        name = "places seen again, median distance"
        rows.append(RegistrationRow(name, "m", before, fit, held_out, len(both)))
    shares = evidence.near_shares
    if shares is not None:
        fit = next((check.after for check in checks if check.unit == "share"), None)
        n = sum(stretch.n_patches for stretch in evidence.stretches)
        name = "wall on the plan (fit: points, held out: patches)"
        rows.append(RegistrationRow(name, "share", shares[0], fit, shares[1], n))
    return rows


def _rows_of_survey(survey: SurveyResiduals | None) -> list[RegistrationRow]:
    rows: list[RegistrationRow] = []
    if survey is None:
        return rows
    roles = (
        ("control points", survey.control),
        ("control points, each left out", survey.left_out),
        ("check points", survey.check),
    )
    for role, found in roles:
        if found is None:
            continue
        amounts = {
            "RMS": found.rms_m,
            "horizontal RMS": found.rms_horizontal_m,
            "height RMS": found.rms_height_m,
            f"worst ({found.worst_id})": found.worst_m,
        }
        for what, amount in amounts.items():
            if amount is not None:
                both = (amount, None) if role == "control points" else (None, amount)
                rows.append(RegistrationRow(f"{role}, {what}", "m", None, *both, found.count))
    return rows


def _basis(evidence: Evidence, survey: SurveyResiduals | None) -> str:
    check = None if survey is None else survey.check
    if check is not None:
        few = ""
        if check.count < MANY_CHECK_POINTS:
            few = f" (the NSSDA asks for {MANY_CHECK_POINTS} or more)"
        return (
            f"the larger of what {check.count} check points show{few} and what solves without parts of the "
            "evidence predict"
        )
    if survey is not None and survey.control is not None:
        return (
            "predicted by solves without parts of the evidence; no check point confirms it, and how well "
            "control points fit is no accuracy"
        )
    if evidence.visits:
        return (
            "predicted by solves without parts of the evidence, and relative to the plan as drawn; no check "
            "point confirms it"
        )
    return (
        "not stated: nothing but the fit to the plan tells, which is no accuracy; give check points, or walk "
        "so that places are seen again"
    )
