"""How thick the walls are of a plan that draws each as one line in its middle: found from the scan.

Scanned walls then stand half a thickness before their lines, on either side. Rooms are smaller than drawn,
all by the same length; of a plan that is too large they are smaller by the same share. So thickness and scale
are told apart by rooms of several sizes, and by what is seen of a wall from both sides.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from planfit.alignment.align import FULL_DISTANCES_M, FULL_SAMPLES, Alignment, HalfThickness
from planfit.alignment.plan_scale import HALF_THICKNESS_M, SAME_SCORE
from planfit.alignment.refine import (
    OBSERVATION_M,
    AlignmentHypothesis,
    RefineSteps,
    metric_plan,
    refine_hypothesis,
    rotation_2d,
)
from planfit.alignment.wall_samples import WallSamples, thin
from planfit.floorplan import Floorplan
from planfit.floorplan.centre_lines import with_thickness
from planfit.floorplan.nearest_faces import nearest_beside

MIN_HALF_M, MIN_SIGMAS = 0.03, 4.0
"""Walls less thick, or known by fewer standard deviations, are left as lines: they are on them."""
REACH_M = 0.3
"""Scanned wall further from a face says nothing of its thickness."""
MIN_ON_LINES = 0.5
"""Share of the wall near the plan that must lie on faces made of lines."""
SETTLED_M, MAX_ROUNDS = 0.002, 5


def find_half_thickness(
    walls: WallSamples, floorplan: Floorplan, drawn: Alignment
) -> HalfThickness | None:
    """Half the thickness of walls that explains clearly more of the scan than lines do; None where none does.

    Args:
        walls: samples, level frame.
        floorplan: as drawn, in its own unit.
        drawn: the alignment with it as drawn.
    """
    if floorplan.is_oriented.all():
        return None
    samples, weights = thin(walls, FULL_SAMPLES)
    metric = metric_plan(floorplan, drawn.scale_xy)
    here = replace(drawn.hypothesis, scale_xy=(1.0, 1.0))
    # The scale of a plan in metres is not in question here: `plan_scale` is about that.
    steps = RefineSteps(FULL_DISTANCES_M, n_scales=0 if floorplan.is_metric else 1)
    tried = [_settled(samples, weights, metric, here, half_m, steps) for half_m in HALF_THICKNESS_M]
    found = [each for each in tried if each is not None]
    if not found:
        return None
    best = max(found, key=lambda each: each.score)
    is_clear = best.half_m > max(MIN_HALF_M, MIN_SIGMAS * best.sigma_m)
    as_lines = refine_hypothesis(samples, weights, metric, here, steps).score
    return best if is_clear and best.score > as_lines + SAME_SCORE else None


def thickness_words(half: HalfThickness) -> str:
    """What a user should know of a plan that draws walls by their centre lines."""
    return (
        f"the plan draws walls as single lines: the scan shows them to be {2 * half.half_m:.2f} m thick in "
        "the middle, half on either side of their lines, and each was taken to be as thick as it was seen; a "
        "plan with both faces of each wall gives better positions where only one side was seen"
    )


def _settled(
    samples: WallSamples,
    weights: Float[np.ndarray, " m"],
    metric: Floorplan,
    here: AlignmentHypothesis,
    half_m: float,
    steps: RefineSteps,
) -> HalfThickness | None:
    """Place and thickness in turns, from a thickness to begin with."""
    sigma_m = np.inf
    for _ in range(MAX_ROUNDS):
        thick = with_thickness(metric, half_m)
        here = refine_hypothesis(samples, weights, thick, here, steps)
        scale = here.metres_per_unit
        off = offset_from_faces(samples, thick.scaled(scale), replace(here, scale_xy=(1.0, 1.0)))
        if off is None:
            return None
        half_m, sigma_m = half_m + off[0] / scale, off[1]
        if half_m <= 0:
            return None
        if abs(off[0]) < SETTLED_M:
            break
    return HalfThickness(half_m * here.metres_per_unit, sigma_m, here.score)


def offset_from_faces(
    walls: WallSamples, thick: Floorplan, hypothesis: AlignmentHypothesis
) -> tuple[float, float] | None:
    """How far scanned walls stand before the faces that were made of lines, m, and its standard deviation.

    The median, as some walls are thicker than others and cupboards stand before them. None where most of the
    wall near the plan is on other faces.

    Args:
        walls: samples, level frame.
        thick: in metres, lines with faces on either side.
        hypothesis: where the scan is on it.
    """
    assert thick.before_line is not None
    rotation = rotation_2d(hypothesis.yaw)
    xy, towards = walls.xy @ rotation.T + hypothesis.translation, walls.normals @ rotation.T
    distance, face = nearest_beside(
        xy, towards, thick.ends, thick.normals, thick.is_oriented, REACH_M
    )
    near = face >= 0
    is_of_line = near.copy()
    is_of_line[near] = thick.before_line[face[near]] > 0
    if is_of_line.sum() < max(MIN_ON_LINES * near.sum(), 1):
        return None
    off_m = distance[is_of_line]
    middle_m = float(np.median(off_m))
    n_observations = len(np.unique(np.round(xy[is_of_line] / OBSERVATION_M).astype(int), axis=0))
    mad_sigma_m = 1.4826 * float(np.median(np.abs(off_m - middle_m)))
    return middle_m, mad_sigma_m / np.sqrt(n_observations)
