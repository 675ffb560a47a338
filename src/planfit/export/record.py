"""The record of a run: what went in, what was chosen, what came out, and how sure it is."""

import dataclasses
from enum import Enum
from typing import Any

import numpy as np

from planfit import checks
from planfit.floorplan import Floorplan
from planfit.pipeline import RefineOptions, RefineResult
from planfit.scan import Scan


def make_record(
    version: str,
    inputs: dict[str, str],
    scan: Scan,
    floorplan: Floorplan,
    options: RefineOptions,
    result: RefineResult,
) -> dict[str, Any]:
    """Everything about a run as plain values, for `run.json`. Lengths in metres, times in seconds."""
    solution, alignment = result.walls.solution, result.alignment
    return {
        "planfit": version,
        "inputs": inputs,
        "options": plain(options),
        "frames": len(scan),
        "plan_faces": len(floorplan),
        "labels_from": result.structure.back_end,
        "up_world": result.gravity.up_world.tolist(),
        "up_from": result.gravity.source,
        "matches": {
            "keypoints": result.matches.n_keypoints,
            "pairs_tried": result.matches.n_tried,
            "pairs_verified": len(result.matches.pairs),
            "pairs_of_revisits": result.matches.n_loops(options.matching.pairs.neighbours),
            "matches": result.matches.n_matches,
        },
        "alignment": None
        if alignment is None
        else {
            "plan_from_level": alignment.plan_from_level.tolist(),
            "score": alignment.score,
            "runner_up_score": alignment.runner_up.score if alignment.runner_up else None,
            "is_as_recorded": alignment.is_as_recorded,
        },
        "world_from_plan": result.world_from_plan.tolist(),
        "plan_from_world_axes": None
        if scan.plan_from_world_axes is None
        else scan.plan_from_world_axes.tolist(),
        "walls": {
            "pieces": result.structure.n_patches,
            "associated": result.walls.association.n_associated,
            "rounds": result.walls.rounds,
            "settled": result.walls.settled,
        },
        "stop": solution.stop.value,
        "cost_by_term": {
            name: {"before": before, "after": after}
            for name, (before, after) in result.cost_by_term.items()
        },
        "metrics": surface_metrics(floorplan, result),
        "checks": [plain(check) for check in result.checks],
        "is_better": result.is_better,
        "doubts": list(result.doubts),
        "seconds_by_stage": result.seconds_by_stage,
    }


def surface_metrics(floorplan: Floorplan, result: RefineResult) -> dict[str, dict[str, float]]:
    """How well walls and floor agree with the plan, before and after; None where none was seen.

    NSD: mean distance of wall points to the nearest plan segment (paper, Sec. IV-B). Floor RMS: of
    the heights of floor points about their median.
    """
    both = {"before": result.initial_plan_from_cams, "after": result.plan_from_cams}
    structure, metrics = result.structure, {}
    if len(structure.wall_points_cam) + len(structure.loose_points_cam):
        far = {k: checks.wall_distances(structure, floorplan, poses) for k, poses in both.items()}
        metrics["nsd_m"] = {k: float(d.mean()) for k, d in far.items()}
        metrics["near_plan_share"] = {
            k: float(np.mean(d < checks.NEAR_FACE_M)) for k, d in far.items()
        }
    if len(structure.floor_points_cam):
        metrics["floor_rms_m"] = {
            k: float(np.std(checks.floor_heights(structure, poses))) for k, poses in both.items()
        }
    return metrics


def plain(value: Any) -> Any:
    """Dataclasses, enumerations and tuples as dictionaries, names and lists."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = dataclasses.fields(value)
        return {field.name: plain(getattr(value, field.name)) for field in fields}
    if isinstance(value, Enum):
        return value.name.lower()
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    return value
