"""A result beside the truth: errors on the plan and in height, corrections that were announced, decisions."""

from dataclasses import dataclass, replace

import numpy as np
from faults.inputs import Inputs
from faults.measure import brought_to
from faults.words import outcome_of, predicted_errors_m
from jaxtyping import Float, Int

from buildings.changes import true_jumps
from buildings.rows import Row
from planfit.findings import ResultKind
from planfit.pipeline.result import RefineResult

RIGHT, FALSE, MISSED = "right", "false", "missed"
WITHIN_FRAMES = 2
"""A jump is named rightly this near to where it is."""
STEADY = {"scale": 0.005, "depth": 0.005, "focal length": 0.005, "thickness": 0.03}
"""Decisions that differ by less (shares, m) are one: less than a plan's or a sensor's usual error."""
SAME_PLACE_M, SAME_YAW_DEG = 1.0, 5.0
"""Alignments nearer than this are one place."""


@dataclass(frozen=True)
class Announced:
    """What a run said that it corrected; n frames."""

    metres_per_unit: float
    """1 where a plan in metres kept its scale."""
    other_scale: float | None
    """Told of as fitting better, and not taken."""
    depth: tuple[float, float, float]
    """Scale, offset (m), quadratic (1/m); 1, 0, 0 where nothing was corrected."""
    focal_scale: float
    thickness_m: float | None
    """Given to walls drawn as lines; None where none was."""
    walls_m: tuple[float, ...]
    """Offsets of walls that are said to stand elsewhere than drawn, the largest first."""
    jumps: tuple[int, ...]
    """Frames before jumps that were corrected."""


def announced(result: RefineResult) -> Announced:
    """What a result says that it corrected."""
    alignment, sensor = result.alignment, result.sensor
    half = None if alignment is None else alignment.half_thickness
    other = None if alignment is None else alignment.other_scale
    moved = [each for each in result.findings if each.kind is ResultKind.WALLS_MOVED]
    facts = [wall.facts["offset_m"] for each in moved for wall in each.parts]
    offsets = np.abs(np.array(facts, dtype=float))
    breaks = () if result.tracking is None else result.tracking.breaks
    return Announced(
        1.0 if alignment is None else alignment.metres_per_unit,
        None if other is None else other.metres_per_unit,
        (sensor.depth_scale, sensor.depth_offset_m, sensor.depth_quadratic_per_m),
        sensor.focal_scale,
        None if half is None else 2 * half.half_m,
        tuple(round(float(each), 3) for each in -np.sort(-offsets)),
        tuple(each.first_frame for each in breaks if each.kind == "jump"),
    )


def judge(inputs: Inputs, result: RefineResult, judged: frozenset[str], nothing: Row) -> Row:
    """The row of a result.

    Args:
        inputs: as planfit was given them, and the truth.
        result: of planfit.
        judged: kinds of corrections of which it is known that none is right, but for jumps that were made.
        nothing: what else the row holds.
    """
    truth, before = inputs.true_positions(), inputs.recorded_in_true_plan()
    plan, found = result.floorplan, result.plan_from_cams[:, :3, 3]
    assert plan is not None
    is_metric = inputs.floorplan.is_metric
    on_plan = inputs.in_true_plan(found, plan)
    # Poses on a plan in metres are used as they are: where it was rescaled, that is part of their error.
    used = found if is_metric else on_plan
    errors = np.linalg.norm(used - truth, axis=1)
    predicted = predicted_errors_m(result)
    exit_code, said = outcome_of(result)
    jumps = true_jumps(inputs.true_world_from_cams, inputs.scan.world_from_cams)
    claims = announced(result)
    predicted_m = None if predicted is None else _rms(predicted)
    return replace(
        nothing,
        exit_code=exit_code,
        said=said,
        is_metric=is_metric,
        before_m=_rms(np.linalg.norm(before - truth, axis=1)),
        error_m=_rms(errors),
        aligned_m=_rms(np.linalg.norm(brought_to(used, truth) - truth, axis=1)),
        largest_m=float(errors.max()),
        height_before_m=float(np.std(before[:, 2] - truth[:, 2])),
        height_m=float(np.std(used[:, 2] - truth[:, 2])),
        scale_error=inputs.scale_error(plan),
        scale_sigma=0.0 if result.alignment is None else result.alignment.scale_sigma,
        warnings=result.warnings,
        predicted_m=predicted_m,
        sigmas=_rms(errors) / predicted_m if predicted_m else None,
        corrections=corrections(claims, jumps, judged, is_metric),
        decisions=decisions(claims, result, exit_code),
    )


def corrections(
    claims: Announced, jumps: Int[np.ndarray, " j"], judged: frozenset[str], is_metric: bool
) -> dict[str, list]:
    """By kind: what was announced, the truth, and whether that is right, false or missed; nothing of kinds
    that were rightly left alone, or of which nothing is known."""
    found: dict[str, list] = {}
    scale = claims.other_scale or claims.metres_per_unit
    if is_metric and scale != 1.0:
        found["scale"] = [scale, 1.0, FALSE]
    if claims.depth != (1.0, 0.0, 0.0):
        found["depth"] = [list(claims.depth), [1.0, 0.0, 0.0], FALSE]
    if claims.focal_scale != 1.0:
        found["focal length"] = [claims.focal_scale, 1.0, FALSE]
    if claims.thickness_m is not None:
        found["thickness"] = [claims.thickness_m, 0.0, FALSE]
    if claims.walls_m:
        found["walls"] = [list(claims.walls_m), [], FALSE]
    named = np.array(claims.jumps, dtype=int)
    is_right = _are_near(named, jumps)
    if len(named) or len(jumps):
        verdict = RIGHT if is_right.all() and _are_near(jumps, named).all() else FALSE
        if is_right.all() and not _are_near(jumps, named).all():
            verdict = MISSED
        found["jumps"] = [named.tolist(), jumps.tolist(), verdict]
    return {kind: values for kind, values in found.items() if kind in judged}


def decisions(claims: Announced, result: RefineResult, exit_code: int) -> dict[str, float | list]:
    """What may not flip when a little of scan or plan is left out."""
    place: list[float] = []
    if result.alignment is not None:
        taken = result.alignment.plan_from_level
        yaw_deg = float(np.rad2deg(np.arctan2(taken[1, 0], taken[0, 0])))
        # Where the scan's middle is put: axes of the level frame change with what the scan begins with.
        middle = result.plan_from_cams[:, :2, 3].mean(axis=0)
        place = [yaw_deg, *middle.tolist()]
    return {
        "outcome": exit_code,
        "scale": claims.other_scale or claims.metres_per_unit,
        "depth": claims.depth[0],
        "focal length": claims.focal_scale,
        "thickness": claims.thickness_m or 0.0,
        "place": place,
    }


def flipped(before: dict, now: dict) -> list[str]:
    """Decisions that differ, in words."""
    found = []
    if before["outcome"] != now["outcome"]:
        found.append(f"outcome: exit {before['outcome']} -> {now['outcome']}")
    for kind, near in STEADY.items():
        unit = before[kind] if kind == "scale" else 1.0  # a plan without unit has any scale
        if abs(now[kind] - before[kind]) > near * unit:
            found.append(f"{kind}: {before[kind]:.4g} -> {now[kind]:.4g}")
    if before["place"] and now["place"]:
        moved_m = np.hypot(*np.subtract(now["place"][1:], before["place"][1:]))
        turned = abs((now["place"][0] - before["place"][0] + 180) % 360 - 180)
        if moved_m > SAME_PLACE_M or turned > SAME_YAW_DEG:
            found.append(f"place: {moved_m:.1f} m, {turned:.0f} deg away")
    return found


def moved_sigmas(
    before: Float[np.ndarray, "n 4"], now: Float[np.ndarray, "n 4"]
) -> Float[np.ndarray, " n"]:
    """How far frames lie apart in two runs, in sigmas of the first: x, y, z and predicted error a row."""
    apart = np.linalg.norm(now[:, :3] - before[:, :3], axis=1)
    return apart / np.maximum(before[:, 3], 1e-6)


def _are_near(frames: Int[np.ndarray, " a"], others: Int[np.ndarray, " b"]) -> np.ndarray:
    if len(others) == 0:
        return np.zeros(len(frames), dtype=bool)
    return np.abs(frames[:, None] - others).min(axis=1) <= WITHIN_FRAMES


def _rms(values: Float[np.ndarray, " n"]) -> float:
    return float(np.sqrt(np.mean(values**2)))
