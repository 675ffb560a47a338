"""How thick walls are that a plan draws as lines or thin strokes in their middle: found from the scan.

Scanned walls then stand half a thickness before their lines, on either side. Rooms are smaller than drawn,
all by the same length; of a plan that is too large they are smaller by the same share. So thickness and scale
are told apart by rooms of several sizes, and by what is seen of a wall from both sides.
"""

from dataclasses import dataclass, replace

import numpy as np

from planfit.alignment.align import FULL_DISTANCES_M, Alignment, HalfThickness
from planfit.alignment.evidence import COVERED_M, MIN_ON_LINES, median_with_sigma
from planfit.alignment.options import AlignOptions
from planfit.alignment.plan_scale import HALF_THICKNESS_M, SAME_SCORE, may_be_rescaled
from planfit.alignment.refine import (
    AlignmentHypothesis,
    RefineSteps,
    metric_plan,
    refine_hypothesis,
    rotation_2d,
)
from planfit.alignment.selection import MAX_CANDIDATES
from planfit.alignment.wall_samples import WallSamples, thin
from planfit.findings import Finding, PlanKind
from planfit.floorplan import Floorplan
from planfit.floorplan.centre_lines import are_strokes, with_thickness
from planfit.floorplan.nearest_faces import nearest_beside
from planfit.priors import PARTITION_THICKNESS_M, WALL_THICKNESS_M

MIN_MORE_M, MIN_SIGMAS = 0.04, 4.0
"""Half the thickness must be more than drawn by so much, and so many of its standard deviations: walls that
are nearer stand as they are drawn."""
MIN_GAIN = 0.015
"""Of the share of seen wall that the plan explains. Walls 22 cm thick in the middle: 0.25 more than by lines,
0.03 more than by strokes of 10 cm."""
THICKEST_HALF_M = WALL_THICKNESS_M.high / 2
"""Walls are not thicker than twice this, in the middle of a building's: else the plan is too large."""
THINNEST_M = PARTITION_THICKNESS_M.middle
"""Walls that are drawn thinner may be strokes."""
SETTLED_M, MAX_ROUNDS = 0.002, 5
MAX_PLACES = MAX_CANDIDATES


def find_half_thickness(
    walls: WallSamples, floorplan: Floorplan, drawn: Alignment, options: AlignOptions
) -> HalfThickness | None:
    """Half the thickness of walls that explains clearly more of the scan than what is drawn, if one does.

    Args:
        floorplan: as drawn, in its own unit.
        drawn: the alignment with it as drawn.
        options: of the alignment; `metric_scale_tolerance` bounds the scale of a plan in metres.
    """
    # Thin walls may mislead about place and scale: others that fit are tried too where these are not sure.
    places = [drawn.hypothesis]
    if not drawn.is_sure:
        places += drawn.candidates[:MAX_PLACES]
    found = [_thickest_at(place, walls, floorplan, options) for place in places]
    clear = [each for each in found if each is not None]
    return max(clear, key=lambda each: each.score, default=None)


def _thickest_at(
    place: AlignmentHypothesis, walls: WallSamples, floorplan: Floorplan, options: AlignOptions
) -> HalfThickness | None:
    """The same at one place, clearly better than as drawn there."""
    metric = metric_plan(floorplan, place.scale_xy)
    stroke = are_strokes(metric, THINNEST_M)
    drawn_m = 0.0
    if metric.lengths[stroke].sum() > metric.lengths[~metric.is_oriented].sum():
        assert metric.thickness is not None
        drawn_m = 0.5 * float(np.median(metric.thickness[stroke]))
    elif metric.is_oriented.all():
        return None
    samples = thin(walls)
    tried = _Tried(samples, metric, replace(place, scale_xy=(1.0, 1.0)), n_scales=1)
    best = tried.best()
    if floorplan.is_metric:
        # A plan in metres has its scale, unless another explains clearly more with walls of any thickness.
        held = _Tried(samples, floorplan, _as_drawn(place, samples), n_scales=0)
        of_held = held.best()
        scale = 1.0 if best is None else best.metres_per_unit * place.metres_per_unit
        least = -np.inf if best is None else best.score - SAME_SCORE
        if not may_be_rescaled(options, scale) or (of_held is not None and of_held.score > least):
            tried, best, place = held, of_held, replace(place, scale_xy=(1.0, 1.0))
    if best is None:
        return None
    is_clear = best.half_m - drawn_m > max(MIN_MORE_M, MIN_SIGMAS * best.sigma_m)
    if not is_clear or best.score < tried.score_as_drawn() + MIN_GAIN:
        return None
    return replace(
        best, drawn_m=drawn_m, metres_per_unit=best.metres_per_unit * place.metres_per_unit
    )


def _as_drawn(place: AlignmentHypothesis, walls: WallSamples) -> AlignmentHypothesis:
    """The place with the plan in metres as it is drawn, the scan's middle at its spot of the drawing."""
    middle = rotation_2d(place.yaw) @ walls.middle + place.translation
    moved = (1.0 / np.array(place.scale_xy) - 1.0) * middle
    return replace(place, translation=place.translation + moved, scale_xy=(1.0, 1.0))


def thickness_finding(half: HalfThickness) -> Finding:
    """What a user should know of a plan that draws walls by their centre lines."""
    facts = {"thickness_m": 2 * half.half_m, "sigma_m": 2 * half.sigma_m}
    facts |= {"drawn_thickness_m": 2 * half.drawn_m}
    return Finding(PlanKind.THICKNESS_FITTED, facts)


@dataclass(frozen=True)
class _Tried:
    """One place on one plan, at which walls of several thicknesses are tried."""

    samples: WallSamples
    metric: Floorplan
    here: AlignmentHypothesis
    n_scales: int
    """0 holds the plan's scale."""

    @property
    def steps(self) -> RefineSteps:
        return RefineSteps(FULL_DISTANCES_M, self.n_scales)

    def score_as_drawn(self) -> float:
        """Without any thickness."""
        return refine_hypothesis(self.samples, self.metric, self.here, self.steps).score

    def best(self) -> HalfThickness | None:
        """The thickness that explains most, from several to begin with; `drawn_m` is not set."""
        found = [each for half_m in HALF_THICKNESS_M if (each := self._settled(half_m)) is not None]
        return max(found, key=lambda each: each.score, default=None)

    def _settled(self, half_m: float) -> HalfThickness | None:
        """Place and thickness in turns, from a thickness to begin with."""
        here, sigma_m = self.here, np.inf
        for _ in range(MAX_ROUNDS):
            thick = with_thickness(self.metric, half_m, THINNEST_M)
            here = refine_hypothesis(self.samples, thick, here, self.steps)
            scale = here.metres_per_unit
            at_scale = replace(here, scale_xy=(1.0, 1.0))
            off = offset_from_faces(self.samples, thick.scaled(scale), at_scale)
            if off is None:
                return None
            half_m, sigma_m = half_m + off[0] / scale, off[1]
            if not 0 < half_m * scale < THICKEST_HALF_M:
                return None
            if abs(off[0]) < SETTLED_M:
                break
        scale = here.metres_per_unit
        return HalfThickness(half_m * scale, sigma_m, 0.0, here.score, scale)


def offset_from_faces(
    walls: WallSamples, thick: Floorplan, hypothesis: AlignmentHypothesis
) -> tuple[float, float] | None:
    """How far scanned walls stand before the faces of lines and strokes, m, and its standard deviation.

    The median, as some walls are thicker than others and cupboards stand before them. None where most of the
    wall near the plan is on other faces.

    Args:
        thick: in metres, lines with faces on either side.
    """
    assert thick.before_line is not None
    rotation = rotation_2d(hypothesis.yaw)
    xy, towards = walls.xy @ rotation.T + hypothesis.translation, walls.normals @ rotation.T
    distance, face = nearest_beside(
        xy, towards, thick.ends, thick.normals, thick.is_oriented, COVERED_M
    )
    near = face >= 0
    is_of_line = near.copy()
    is_of_line[near] = thick.before_line[face[near]] > 0
    if is_of_line.sum() < max(MIN_ON_LINES * near.sum(), 1):
        return None
    return median_with_sigma(distance[is_of_line], xy[is_of_line])
