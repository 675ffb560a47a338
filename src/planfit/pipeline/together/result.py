"""What several scans come to: all of them together, and each as its own run would tell it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from planfit.adjust import PlanAdjustment
from planfit.adjust.association import Association
from planfit.findings import Finding, SurveyKind
from planfit.geometry import se3
from planfit.pipeline.calibrate import corrected
from planfit.pipeline.evidence import Evidence
from planfit.pipeline.links import Link, Visit
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.result import RefineResult, above, to_recorded_axes
from planfit.pipeline.sensor import sensor_findings, sensor_parameters
from planfit.pipeline.together.joined import JoinedScans
from planfit.pipeline.together.observed import ObservedScan
from planfit.pipeline.together.placing import PlacedBy
from planfit.pipeline.validation import visit_check, wall_check
from planfit.pipeline.verdict import judge
from planfit.runtime import short_repr
from planfit.scan import Scan
from planfit.scan.joined import FramesOfScan
from planfit.segmentation import level_from_world

Both = TypeVar("Both", Visit, Link)
"""What concerns two stretches of the walk."""


@dataclass(frozen=True)
class RefinedScan:
    """One of several scans."""

    name: str
    """Short, and no other's."""
    scan: Scan
    """As recorded."""
    placed_by: PlacedBy | None
    """How its place among the others was found; None where it has none."""
    reasons: tuple[Finding, ...]
    """Why it has no place; none where it has one."""
    result: RefineResult | None
    """As a run of this scan alone would tell it: its own frames, world and verdict; poses from the solve of
    all. None where it has no place: its poses stay as recorded."""

    __repr__ = short_repr

    @property
    def finding(self) -> Finding:
        """Why it was left out, where it has no place."""
        return Finding(SurveyKind.SCAN_LEFT_OUT, {"scan": self.name}, parts=self.reasons)


@dataclass(frozen=True)
class TogetherResult:
    """Several scans of one building, refined together."""

    together: RefineResult
    """Of all scans that have a place, their frames one scan after the other, in the world of the first."""
    scans: tuple[RefinedScan, ...]
    """All, in the order given."""
    between_pairs: int
    """Matched pairs of frames of different scans."""

    __repr__ = short_repr

    @property
    def is_refined(self) -> bool:
        """Whether all scans have a place, and the poses can be used as they are."""
        return self.together.verdict.is_refined and not self.unplaced

    @property
    def unplaced(self) -> tuple[RefinedScan, ...]:
        """Scans without a place."""
        return tuple(each for each in self.scans if each.result is None)

    def save(self, folder: str | Path, *, overwrite: bool = False) -> None:
        """Write all that `planfit refine` writes of several scans (docs/several-scans.md).

        Args:
            folder: new, empty, or of an earlier run with the same scans and plan.
            overwrite: whether another run's results may be replaced.

        Raises:
            OutputError: the folder holds other files, is in use, or cannot be written.
        """
        above("planfit.saving").save_result(self, folder, overwrite=overwrite)


def result_of_scan(
    observed: ObservedScan,
    k: int,
    joined: JoinedScans,
    together: RefineResult,
    options: RefineOptions,
) -> RefineResult:
    """What a run of one scan alone would tell, with the poses of the solve of all.

    Matches are those within the scan; evidence, verdict and sigmas those of its frames. What only all scans
    together have (cost of the terms, how the solve ended) is theirs.
    """
    own, joined_from_world = joined.frames[k], joined.joined_from_worlds[k]
    before = together.initial_plan_from_cams[own.frames]
    after = together.plan_from_cams[own.frames]
    seen = corrected(observed.observations, together.sensor)
    evidence = evidence_of_frames(together.evidence, own)
    recorded = observed.tracking.recorded_world_from_cams
    plan_from_world = before[0] @ se3.inverse(recorded[0])
    is_own_sensor = not observed.calibration.sensor.is_nominal
    calibration = observed.calibration if is_own_sensor else together.calibration
    parameters = sensor_parameters(calibration, observed.scan.cameras[0])
    level_from_joined = level_from_world(together.gravity, together.structure.floor_height_m)
    joined_from_level = joined_from_world @ se3.inverse(observed.level_from_world)
    alignment = together.alignment
    if alignment is not None:
        plan_from_level = alignment.plan_from_level @ level_from_joined @ joined_from_level
        alignment = replace(alignment, plan_from_level=plan_from_level)
    checks = (
        visit_check(evidence),
        wall_check(seen.structure, together.floorplan, before, after),
    )
    is_key = (together.solved_frame_idx >= own.first) & (together.solved_frame_idx <= own.last)
    made_of = together.made_of
    return replace(
        together,
        plan_from_cams=after,
        initial_plan_from_cams=before,
        world_from_plan=to_recorded_axes(plan_from_world, before, after),
        gravity=seen.gravity,
        structure=seen.structure,
        matches=seen.matches,
        surfaces=seen.surfaces,
        alignment=alignment,
        adjustment=_adjustment_of(together, own),
        solved_frame_idx=together.solved_frame_idx[is_key] - own.first,
        checks=tuple(check for check in checks if check),
        findings=(
            *observed.tracking.findings,
            *seen.depth_unit.findings,
            *sensor_findings(parameters),
        ),
        verdict=judge(evidence, options.tolerance_m),
        evidence=evidence,
        tracking=observed.tracking,
        depth_unit=seen.depth_unit,
        calibration=calibration,
        sensor_parameters=parameters,
        scans=(),
        made_of=None if made_of is None else replace(made_of, scan=observed.scan),
    )


def evidence_of_frames(evidence: Evidence, own: FramesOfScan) -> Evidence:
    """The evidence that concerns some frames, numbered from the first of them."""

    def clipped(run: tuple[int, int]) -> tuple[int, int]:
        return max(run[0], own.first) - own.first, min(run[1], own.last) - own.first

    def touches(run: tuple[int, int]) -> bool:
        return run[0] <= own.last and run[1] >= own.first

    def is_inside(*runs: tuple[int, int]) -> bool:
        return all(own.first <= first and last <= own.last for first, last in runs)

    def of_both(pairs: Sequence[Both]) -> tuple[Both, ...]:
        return tuple(
            replace(
                each,
                first_frames=clipped(each.first_frames),
                last_frames=clipped(each.last_frames),
            )
            for each in pairs
            if is_inside(each.first_frames, each.last_frames)
        )

    return replace(
        evidence,
        pose_covariances=evidence.pose_covariances[own.frames],
        correction_m=evidence.correction_m[own.frames],
        stretches=tuple(
            replace(each, frames=clipped(each.frames))
            for each in evidence.stretches
            if touches(each.frames)
        ),
        visits=of_both(evidence.visits),
        links=of_both(evidence.links),
        torn=tuple(
            replace(each, frames=clipped(each.frames))
            for each in evidence.torn
            if is_inside(each.frames)
        ),
        leaps=tuple(clipped(run) for run in evidence.leaps if is_inside(run)),
        unplaced=tuple(clipped(run) for run in evidence.unplaced if touches(run)),
    )


def _adjustment_of(together: RefineResult, own: FramesOfScan) -> PlanAdjustment:
    """With the faces of the wall patches of some frames."""
    found = together.adjustment.correspondences
    if found is None:
        return together.adjustment
    frame_idx = together.structure.walls.frame_idx
    of = (frame_idx >= own.first) & (frame_idx <= own.last)
    walls = Association(found.walls.face_idx[of], found.walls.distance_m[of])
    widths = None if found.widths is None else found.widths[of]
    return replace(together.adjustment, correspondences=replace(found, walls=walls, widths=widths))
