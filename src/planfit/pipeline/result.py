"""What a run gives: refined poses, and all that is needed to judge them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from PIL import Image

from planfit.adjust import PlanAdjustment
from planfit.adjust.calibration import NOT_CALIBRATED, Calibration
from planfit.alignment import Alignment
from planfit.findings import Finding, sentences_of
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.geometry.calibration import SensorCalibration
from planfit.geometry.se3 import Poses
from planfit.matching import Matches, SurfacePairs
from planfit.pipeline.contradicted import ByHand
from planfit.pipeline.depth_unit import AS_READ, DepthUnit
from planfit.pipeline.diagnostics import (
    adjustment_findings,
    alignment_findings,
    scan_findings,
    storey_findings,
)
from planfit.pipeline.evidence import Evidence
from planfit.pipeline.given import Given
from planfit.pipeline.on_plan import Storeys
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.registration import Registration, register
from planfit.pipeline.sensor import (
    SensorParameter,
    motion_findings,
    sensor_findings,
    sensor_parameters,
)
from planfit.pipeline.solve import Solved
from planfit.pipeline.survey_residuals import survey_findings, survey_residuals
from planfit.pipeline.validation import Check, Validation
from planfit.pipeline.verdict import Verdict
from planfit.runtime import html_table, short_repr
from planfit.scan import Scan
from planfit.scan.joined import FramesOfScan
from planfit.segmentation import Gravity, Structure
from planfit.survey import SurveyResiduals
from planfit.tracking import Tracking


@dataclass(frozen=True)
class MadeOf:
    """What `refine` was given."""

    scan: Scan
    floorplan: Floorplan | Mapping[int, Floorplan] | None
    options: RefineOptions

    __repr__ = short_repr


@dataclass(frozen=True)
class RefineResult:
    """Refined poses, and all that is needed to judge them."""

    floorplan: Floorplan | None
    """The plan in metres, at the scale that was found where it had no unit; None where there was none."""
    plan_from_cams: Poses
    """Refined; without a plan in the level frame: the scan's own axes, turned upright, floor at 0."""
    initial_plan_from_cams: Poses
    """Recorded poses, aligned with the plan as a whole; without a plan, levelled."""
    world_from_plan: Float[np.ndarray, "4 4"]
    """Back to the scan's own axes and height."""
    gravity: Gravity
    structure: Structure
    matches: Matches
    alignment: Alignment | None
    """None where no wall was seen, so that the scan could not be aligned by its walls, or without a plan."""
    adjustment: PlanAdjustment
    solved_frame_idx: Int[np.ndarray, " k"]
    """Keyframes: their images were looked at, and their poses were unknowns; the others followed."""
    cost_by_term: dict[str, tuple[float, float]]
    """Robust cost of each term, before and after."""
    checks: tuple[Check, ...]
    findings: tuple[Finding, ...]
    """What a user should know before trusting the result; the verdict has its own."""
    seconds_by_stage: dict[str, float]
    """All that it took; `other` is what was done between stages."""
    verdict: Verdict
    """What the evidence says of it: which poses to use, and which frames not to trust."""
    evidence: Evidence
    """That evidence."""
    tracking: Tracking | None = None
    """How far the recorded poses were believed; None where the observations were a user's own."""
    calibration: Calibration = NOT_CALIBRATED
    """What the sensor was found to do; points above are corrected by it."""
    storeys: Storeys | None = None
    """Where plans were given by storey: how they lie, and which frames stand on which. `floorplan` holds the
    faces of all, and `structure` the walls of frames on them."""
    sensor_parameters: tuple[SensorParameter, ...] = ()
    """The same, parameter by parameter, in words and units."""
    surfaces: SurfacePairs = field(default_factory=SurfacePairs.none)
    """Frames matched by geometry, where keypoints are few."""
    survey: SurveyResiduals | None = None
    """Residuals of control and check points, where some were given."""
    by_hand: ByHand | None = None
    """What corrections by hand came to; None where there were none."""
    depth_unit: DepthUnit = AS_READ
    """Unit of the scan's depth, where it is another than it was read in; `sensor` comes after it."""
    scans: tuple[FramesOfScan, ...] = ()
    """Which frames are whose, where several scans were refined together; else none."""
    made_of: MadeOf | None = None
    """What it was made of; None where a result was put together otherwise."""

    __repr__ = short_repr

    def _repr_html_(self) -> str:
        checks = [
            (each.name, *(f"{value:.3g} {each.unit}" for value in (each.before, each.after)))
            for each in self.checks
        ]
        warnings = [("warning", warning) for warning in self.warnings]
        return html_table(self.verdict.headline, [("", "before", "after"), *checks]) + (
            html_table("before you use it", warnings) if warnings else ""
        )

    def save(self, folder: str | Path, *, overwrite: bool = False) -> None:
        """Write all that `planfit refine` writes, its report too (docs/outputs.md).

        Args:
            folder: new, empty, or of an earlier run with the same scan and plan.
            overwrite: whether another run's results may be replaced.

        Raises:
            OptionError: the result does not know what it was made of.
            OutputError: the folder holds other files, is in use, or cannot be written.
        """
        above("planfit.saving").save_result(self, folder, overwrite=overwrite)

    def plot(self) -> Image.Image:
        """The scan's wall points over the plan, before and after, as a picture that notebooks show; without a
        plan, its walls from above."""
        return above("planfit.report.plots.overlay").plot_result(self)

    @property
    def warnings(self) -> tuple[str, ...]:
        """The findings in plain words."""
        return sentences_of(self.findings)

    @property
    def world_from_cams(self) -> Poses:
        """Refined poses in the scan's own axes."""
        return self.world_from_plan @ self.plan_from_cams

    @property
    def registration(self) -> Registration:
        """Residuals, fitted and held out, and the accuracy by what was held out."""
        return register(self.evidence, self.checks, self.survey)

    @property
    def sensor(self) -> SensorCalibration:
        """How the scan's sensor was corrected: for `planfit.scan.calibrated_scan`."""
        return self.calibration.sensor


def above(module: str) -> Any:
    """A module that stands above the pipeline and takes its results: only methods that are there for those
    who type reach up, and by name (docs/adr/0020-methods-that-reach-up.md)."""
    return import_module(module)


def to_recorded_axes(
    plan_from_world: Float[np.ndarray, "4 4"], before: Poses, after: Poses
) -> Float[np.ndarray, "4 4"]:
    """world_from_plan, back to the recorded axes, of plan_from_cams before and after.

    The height is that of the first frame as recorded: later ones have drifted, and the plan says nothing
    of heights.
    """
    lift = np.array([0.0, 0.0, before[0, 2, 3] - after[0, 2, 3]])
    return se3.inverse(plan_from_world) @ se3.make_transform(np.eye(3), lift)


def make_result(given: Given, solved: Solved, validation: Validation) -> RefineResult:
    """All of it together, with what a user should know of it; but for the time that it took."""
    scan, calibrated, surveyed = given.scan, solved.calibrated, solved.surveyed
    on_plan, adjustment = solved.on_plan, solved.adjustment
    observations, prepared = calibrated.observations, calibrated.prepared
    structure, matches = observations.structure, observations.matches
    plan_from_world = on_plan.recorded_plan_from_level @ prepared.level_from_world
    found = sensor_parameters(calibrated.calibration, scan.cameras[0])
    survey = None
    if surveyed is not None and on_plan.survey is not None:
        marks = surveyed.marks.corrected(calibrated.calibration.sensor)
        survey = survey_residuals(
            surveyed, marks, on_plan.survey, validation.after, validation.evidence.left_out
        )
    neighbours, has_plan = given.options.matching.pairs.neighbours, on_plan.floorplan is not None
    return RefineResult(
        floorplan=on_plan.floorplan,
        plan_from_cams=validation.after,
        initial_plan_from_cams=validation.before,
        world_from_plan=to_recorded_axes(plan_from_world, validation.before, validation.after),
        gravity=observations.gravity,
        structure=structure,
        matches=matches,
        surfaces=observations.surfaces,
        alignment=on_plan.alignment,
        adjustment=adjustment,
        solved_frame_idx=prepared.keyframes.frame_idx,
        cost_by_term=validation.cost_by_term,
        checks=validation.checks,
        findings=(
            *(observations.tracking.findings if observations.tracking else ()),
            *observations.depth_unit.findings,
            *motion_findings(calibrated.calibration),
            *sensor_findings(found),
            *scan_findings(
                scan,
                observations.gravity,
                structure,
                matches,
                neighbours,
                has_plan,
                observations.surfaces,
                prepared.keyframes.frame_idx,
            ),
            *prepared.findings,
            *(on_plan.survey.findings if on_plan.survey else ()),
            *(survey_findings(survey, validation.evidence.predicted_rms_m) if survey else ()),
            *(storey_findings(on_plan.storeys) if on_plan.storeys else ()),
            *(
                alignment_findings(
                    on_plan.alignment,
                    on_plan.claimed_plan_from_level is not None,
                    adjustment,
                    structure,
                    validation.checks,
                    validation.evidence.is_place_sure,
                    validation.verdict.has_rival,
                )
                if has_plan
                else adjustment_findings(adjustment)
            ),
        ),
        seconds_by_stage={},
        verdict=validation.verdict,
        evidence=validation.evidence,
        tracking=observations.tracking,
        depth_unit=observations.depth_unit,
        calibration=calibrated.calibration,
        storeys=on_plan.storeys,
        sensor_parameters=found,
        survey=survey,
    )
