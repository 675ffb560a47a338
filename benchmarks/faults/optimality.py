"""Whether a run found the best it could: its full cost beside that of an adjustment from the true poses."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from faults.inputs import Inputs
from planfit.adjust import AdjustOptions, Measurements, adjust_to_plan, costs
from planfit.adjust.association import Association, associate_with_plan
from planfit.adjust.ceilings import find_ceilings
from planfit.floorplan import Floorplan
from planfit.pipeline.observations import Observations
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.prepare import prepare
from planfit.pipeline.result import RefineResult

FAR_M = 1e5
"""Where the face stands that patches without one are held to: there the loss has levelled off."""


def compare_with_truth(
    inputs: Inputs, result: RefineResult, options: RefineOptions
) -> tuple[float, float, float]:
    """Full cost of a result, full cost solved from the true poses, and RMS error (m) of that solution.

    Both see what the run saw of the scan and its plan in the end.
    """
    seen = Observations(
        result.gravity,
        result.structure,
        result.matches,
        result.tracking,
        result.surfaces,
    )
    prepared = prepare(inputs.scan, seen, options)
    measurements, plan = prepared.measurements, result.floorplan
    assert plan is not None  # without a plan there is nothing to compare on
    frames = prepared.keyframes.frame_idx
    true_plan_from_keys = inputs.true_plan_from_world @ inputs.true_world_from_cams[frames]
    start = true_plan_from_keys.copy()
    undone = inputs.result_from_given(plan) @ inputs.given_from_true
    start[:, :2, 3] = start[:, :2, 3] @ undone.T
    best = adjust_to_plan(measurements, plan, start, options.adjust).solution.target_from_cams
    off = inputs.in_true_plan(best[:, :3, 3], plan) - true_plan_from_keys[:, :3, 3]
    return (
        full_cost(measurements, plan, result.plan_from_cams[frames], options.adjust),
        full_cost(measurements, plan, best, options.adjust),
        float(np.sqrt(np.mean(np.sum(off**2, axis=1)))),
    )


def full_cost(
    measurements: Measurements,
    floorplan: Floorplan,
    plan_from_cams: Float[np.ndarray, "n 4 4"],
    options: AdjustOptions,
) -> float:
    """Robust cost of all terms at poses, faces associated anew there.

    A wall patch without a face costs what a patch far from its face does: solutions that let go of walls
    would seem cheap else.
    """
    structure = measurements.structure
    ceilings_m = find_ceilings(structure, plan_from_cams)
    found = associate_with_plan(
        structure,
        floorplan,
        plan_from_cams,
        options.wall_distances_m[-1],
        options.association,
        ceilings_m,
    )
    far_ends = np.array([[[0.0, FAR_M], [1.0, FAR_M]]])
    far = replace(
        floorplan,
        ends=np.concatenate([floorplan.ends, far_ends]),
        normals=np.concatenate([floorplan.normals, [[0.0, -1.0]]]),
        is_oriented=np.concatenate([floorplan.is_oriented, [True]]),
        thickness=None,
    )
    all_held = replace(
        found,
        floorplan=far,
        walls=_held_to(found.walls, len(floorplan)),
        columns=_held_to(found.columns, len(floorplan)),
    )
    return float(sum(costs(measurements, plan_from_cams, options, all_held).values()))


def _held_to(association: Association, far_face: int) -> Association:
    """Patches without a face are held to the far one."""
    is_free = association.face_idx < 0
    return Association(
        np.where(is_free, far_face, association.face_idx),
        np.where(is_free, FAR_M, association.distance_m),
    )
