"""The record of a run: what went in, what was chosen, what came out, and how sure it is."""

import dataclasses
from enum import Enum
from typing import Any

import numpy as np

from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.pipeline import validation as checks
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.refine import RefineResult
from planfit.scan import Scan, corrupt_frames


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
        "scan_format": scan.format,
        "frames": len(scan),
        "frames_left_out": list(scan.skipped),
        "frames_not_decoded": corrupt_frames(scan),
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
            "is_sure": alignment.is_sure,
            "metres_per_unit_xy": list(alignment.scale_xy),
            "metres_per_unit_spread_share": alignment.scale_sigma,
        },
        "world_from_plan": result.world_from_plan.tolist(),
        "plan_from_world_before": (
            result.initial_plan_from_cams[0] @ se3.inverse(scan.world_from_cams[0])
        ).tolist(),
        "plan_from_world_axes": None
        if scan.plan_from_world_axes is None
        else scan.plan_from_world_axes.tolist(),
        "walls": {
            "pieces": len(result.structure.walls),
            "associated": result.walls.association.n_associated,
            "rounds": result.walls.rounds,
            "settled": result.walls.settled,
            "offsets": wall_offsets(result),
        },
        "stop": solution.stop.value,
        "cost_by_term": {
            name: {"before": before, "after": after}
            for name, (before, after) in result.cost_by_term.items()
        },
        "metrics": surface_metrics(floorplan, result),
        "checks": [plain(check) for check in result.checks],
        "is_better": result.is_better,
        "warnings": list(result.warnings),
        "seconds_by_stage": result.seconds_by_stage,
    }


def wall_offsets(result: RefineResult) -> list[dict[str, float]]:
    """Faces that were given an offset of their own: how far they stand off, and its standard deviation."""
    offsets_m, sigmas_m = result.walls.offsets_m, result.walls.offset_sigmas_m
    return [
        {"face": int(i), "offset_m": float(offsets_m[i]), "sigma_m": float(sigmas_m[i])}
        for i in np.flatnonzero(np.isfinite(sigmas_m))
    ]


def surface_metrics(floorplan: Floorplan, result: RefineResult) -> dict[str, dict[str, float]]:
    """`planfit.pipeline.validation.surface_metrics` before and after, by figure."""
    before, after = (
        checks.surface_metrics(result.structure, floorplan, poses)
        for poses in (result.initial_plan_from_cams, result.plan_from_cams)
    )
    return {name: {"before": before[name], "after": after[name]} for name in before}


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
