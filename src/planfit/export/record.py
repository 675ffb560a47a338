"""The record of a run: what went in, what was chosen, what came out, and how sure it is."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from planfit.alignment import AdjustedAlignment, Alignment
from planfit.corrections import to_toml
from planfit.evaluation import surface_metrics, wall_distances
from planfit.export.poses import axes_record
from planfit.export.tables import finite, finite_plain, plain, registration_record, survey_record
from planfit.findings import SCHEMA_VERSION, finding_record, sentences_of
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.geometry.calibration import SensorCalibration
from planfit.geometry.camera import Camera
from planfit.pipeline.contradicted import ByHand
from planfit.pipeline.on_plan import Storey, Storeys, frame_runs
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.result import RefineResult
from planfit.pipeline.sensor import SensorParameter
from planfit.scan import Scan, corrupt_frames
from planfit.segmentation import NO_STOREY
from planfit.tracking import ClockOffset, Tracking
from planfit.units import told_in


@told_in("m")
def make_record(
    version: str,
    inputs: dict[str, str],
    scan: Scan,
    floorplan: Floorplan | None,
    options: RefineOptions,
    result: RefineResult,
) -> dict[str, Any]:
    """Everything about a run as plain values, for `run.json`. Lengths in metres, times in seconds; metrics
    have their unit beside them."""
    return {
        "planfit": version,
        "schema_version": SCHEMA_VERSION,
        "inputs": inputs,
        "options": plain(options),
        "scan_format": scan.format,
        "frames": len(scan),
        "frames_left_out": list(scan.skipped),
        "frames_not_decoded": corrupt_frames(scan),
        "plan_faces": None if floorplan is None else len(floorplan),
        "keyframes": len(result.solved_frame_idx),
        "labels_from": result.structure.back_end,
        "up_world": result.gravity.up_world.tolist(),
        "up_from": result.gravity.source,
        "tracking": None if result.tracking is None else _tracking_record(result.tracking),
        **_pairs_record(result, options.matching.pairs.neighbours),
        "alignment": None if result.alignment is None else _alignment_record(result.alignment),
        "corrections": None if result.by_hand is None else _corrections_record(result.by_hand),
        "storeys": None if result.storeys is None else _storeys_record(result, result.storeys),
        **_transforms(scan, result),
        "depth_factor": result.depth_unit.factor,
        "sensor": sensor_record(result.sensor, result.sensor_parameters, scan.cameras[0]),
        "walls": {
            "patches": len(result.structure.walls),
            "associated": result.adjustment.association.n_associated,
            "rounds": result.adjustment.rounds,
            "converged": result.adjustment.converged,
            "offsets": wall_offsets(result),
        },
        "registration": registration_record(result.registration),
        "survey": None if result.survey is None else survey_record(result.survey),
        "stop": result.adjustment.solution.stop.value,
        "cost_by_term": {
            name: {"before": before, "after": after}
            for name, (before, after) in result.cost_by_term.items()
        },
        "metrics": metrics_record(floorplan, result),
        "checks": [plain(check) for check in result.checks],
        "verdict": _verdict_record(result),
        "warnings": list(result.warnings),
        "findings": [finding_record(each) for each in result.findings],
        "seconds_by_stage": result.seconds_by_stage,
    }


def _corrections_record(by_hand: ByHand) -> dict[str, Any]:
    """Corrections by hand: the text of those that were used, what each came to, and those left out."""
    reasons = {
        (each.correction.kind, each.correction.number): each.reason.sentence
        for each in by_hand.contradictions
    }
    return {
        "file": by_hand.used.name,
        "used": [
            {
                "kind": each.correction.kind,
                "number": each.correction.number,
                "words": each.correction.words,
                "note": each.correction.note,
                "residual_m": each.residual_m,
                "contradicted": reasons.get((each.correction.kind, each.correction.number)),
            }
            for each in by_hand.outcomes
        ],
        "left_out": [
            {"words": each.correction.words, "contradicted": each.reason.sentence}
            for each in by_hand.left_out
        ],
        "toml": to_toml(by_hand.used),
    }


def sensor_record(
    sensor: SensorCalibration, parameters: Sequence[SensorParameter], camera: Camera
) -> dict[str, Any]:
    """How the scan was corrected, what was found of each parameter, and the first camera, corrected."""
    return {
        "correction": plain(sensor),
        "parameters": {
            row.key: {
                "meaning": row.name,
                "unit": row.unit,
                "found": row.found,
                "departure": row.departure,
                "sigma": row.sigma,
                "kept": row.is_kept,
                "implausible": row.is_implausible,
                "p_sensor": row.p_sensor,
            }
            for row in parameters
        },
        "camera": plain(sensor.camera(camera)),
    }


def metrics_record(floorplan: Floorplan | None, result: RefineResult) -> dict[str, dict[str, Any]]:
    """Metrics of walls and floor, by name, as `planfit evaluate` gives them."""
    metrics = surface_metrics(
        result.structure, floorplan, result.initial_plan_from_cams, result.plan_from_cams
    )
    return {
        m.name: {"before": finite(m.before), "after": finite(m.after), "unit": m.unit}
        for m in metrics
    }


def _verdict_record(result: RefineResult) -> dict[str, Any]:
    """The verdict, and the evidence that it rests on."""
    verdict, evidence = result.verdict, result.evidence
    return {
        "outcome": verdict.outcome.value,
        "reasons": list(verdict.reasons),
        "findings": [finding_record(each) for each in verdict.because],
        "reservations": [
            {**finding_record(each), "walls": list(sentences_of(each.parts))}
            for each in verdict.reservations
        ],
        "advice": verdict.advice,
        "tolerance_m": verdict.tolerance_m,
        "share_within_tolerance": verdict.share_within,
        "predicted_error_rms_m": finite(evidence.predicted_rms_m),
        "predicted_error_m": [finite(each) for each in verdict.predicted_error_m.tolist()],
        "frames_without_place": [list(run) for run in evidence.unplaced],
        "worst_predicted_frame": evidence.worst_frame,
        "stretches": [finite_plain(stretch) for stretch in evidence.stretches],
        "visits": [plain(visit) for visit in evidence.visits],
        "disagreements": [
            {**plain(each), "words": each.sentence} for each in evidence.disagreements
        ],
        "torn_steps": [plain(step) for step in evidence.torn],
        "adjusted_alignment": _adjusted_record(evidence.alignment),
        "misfit_without_and_with_walls": {
            name: list(both) for name, both in evidence.scan_costs.items()
        },
    }


def _adjusted_record(adjusted: AdjustedAlignment | None) -> dict[str, Any] | None:
    if adjusted is None:
        return None
    doubt = "" if adjusted.doubt is None else adjusted.doubt.sentence
    return {**plain(adjusted), "doubt": doubt}


def _tracking_record(tracking: Tracking) -> dict[str, Any]:
    return {
        "convention": tracking.convention,
        "motions_measured": tracking.n_motions,
        "clock": None if tracking.clock is None else _clock_record(tracking.clock),
        "sigma_factors": {
            "rotation": tracking.sigma_factors[0],
            "translation": tracking.sigma_factors[1],
        },
        "breaks": [{**plain(found), "reason": found.finding.sentence} for found in tracking.breaks],
    }


def _clock_record(clock: ClockOffset) -> dict[str, Any]:
    """How much later than their poses images were taken half way, and by which share of the time more further
    on; seconds are None where frames have numbers."""
    return {
        "rate": clock.rate,
        "offset_s": clock.offset_s,
        "sigma_s": clock.sigma_s,
        "offset_frames": clock.intervals,
        "sigma_frames": clock.sigma_intervals,
        "poses_read_at_image_times": clock.is_read,
    }


def _pairs_record(result: RefineResult, neighbours: int) -> dict[str, dict[str, int]]:
    """Pairs of frames matched by keypoints and by geometry; those of keyframes further apart than
    `neighbours` are loop closures."""
    matches, surfaces, keyframe_idx = result.matches, result.surfaces, result.solved_frame_idx
    return {
        "matches": {
            "keypoints": matches.n_keypoints,
            "pairs_tried": matches.n_tried,
            "pairs_verified": len(matches.pairs),
            "loop_closures": matches.n_loops(neighbours, keyframe_idx),
            "matches": matches.n_matches,
        },
        "surfaces": {
            "pairs_verified": len(surfaces),
            "loop_closures": surfaces.n_loops(neighbours, keyframe_idx),
            "with_free_directions": int((surfaces.n_free > 0).sum()),
        },
    }


def _alignment_record(alignment: Alignment) -> dict[str, Any]:
    return {
        "plan_from_level": alignment.plan_from_level.tolist(),
        "score": alignment.score,
        "runner_up_score": alignment.runner_up.score if alignment.runner_up else None,
        "is_as_recorded": alignment.is_as_recorded,
        "is_sure": alignment.is_sure,
        "metres_per_unit_xy": list(alignment.scale_xy),
        "metres_per_unit_sigma_share": alignment.scale_sigma,
        "evidence": plain(alignment.evidence),
        "other_scale": plain(alignment.other_scale),
        "half_thickness_of_lines": plain(alignment.half_thickness),
    }


def _storeys_record(result: RefineResult, storeys: Storeys) -> dict[str, Any]:
    """Storeys from the lowest, and what became of the plans."""
    on_stairs = frame_runs(storeys.of_frames == NO_STOREY)
    return {
        "walked": [_storey_record(result, k, storey) for k, storey in enumerate(storeys.walked)],
        "frames_on_stairs": plain(on_stairs),
        "plans_not_used": list(storeys.not_walked),
    }


def _storey_record(result: RefineResult, index: int, storey: Storey) -> dict[str, Any]:
    """A storey; with a plan, where that lies, and how much of the wall is near it."""
    record: dict[str, Any] = {
        "number": None,
        "floor_m": storey.floor_m,
        "frames": plain(storey.frames),
    }
    if storey.own is None or result.floorplan is None:
        return record
    own = result.structure.with_walls_of(result.structure.storeys == index)
    near = [
        wall_distances(own, result.floorplan, poses)
        for poses in (result.initial_plan_from_cams, result.plan_from_cams)
    ]
    return record | {
        "number": storey.own.number,
        "plan": storey.own.floorplan.name,
        "plan_faces": len(storey.own.floorplan),
        "plan_from_own": storey.own.plan_from_own.tolist(),
        "shares_axes": storey.own.shares_axes,
        "alignment": _alignment_record(storey.own.alignment),
        "wall_near_share": {
            name: None if found is None else found.near_share
            for name, found in zip(("before", "after"), near, strict=True)
        },
    }


def _transforms(scan: Scan, result: RefineResult) -> dict[str, Any]:
    """Between the scan's own axes and the plan: refined, recorded, and as the scan's format has it."""
    tracking = result.tracking
    recorded = tracking.recorded_world_from_cams if tracking else scan.world_from_cams
    before = result.initial_plan_from_cams[0] @ se3.inverse(recorded[0])
    axes = scan.plan_from_world_axes
    return {
        "world_from_plan": result.world_from_plan.tolist(),
        "plan_from_world_before": before.tolist(),
        "plan_from_world_axes": None if axes is None else axes.tolist(),
        **axes_record(None if result.floorplan is None else result.floorplan.source),
    }


def wall_offsets(result: RefineResult) -> list[dict[str, float]]:
    """Faces that were given an offset of their own: how far they stand off, with its sigma."""
    offsets_m, sigmas_m = result.adjustment.offsets_m, result.adjustment.offset_sigmas_m
    return [
        {"face": int(i), "offset_m": float(offsets_m[i]), "sigma_m": float(sigmas_m[i])}
        for i in np.flatnonzero(np.isfinite(sigmas_m))
    ]
