"""Several starts compete by the full cost: a local optimum shows by another one that costs less.

The cost counts all terms with their losses as they stand, and wall without a face at the most that a loss
can cost, so that letting go of walls never pays.

Each start reaches for walls as far as the pose that saw them may be off, and no further. A narrow loss does
not feel a wall that lies decimetres off; a wide one is pulled by every wall that was moved. What odometry and
matches leave open tells which a patch needs: at the end of a walk without a loop it reaches far, in the
middle of a scan that closes on itself it stays narrow.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from planfit.adjust.alternation import (
    Alternation,
    PlanTask,
    alternate,
    narrow,
    without_moved_walls,
)
from planfit.adjust.association import wall_patches_in_plan
from planfit.adjust.moved_walls import PRICE, wall_numbers
from planfit.adjust.problem import build_problem
from planfit.adjust.shifts import Shift, on_other_copy, other_places
from planfit.adjust.terms.walls import observations_of
from planfit.adjust.voting import MAX_SHIFT_M, PATCHES_PER_STRETCH, vote
from planfit.geometry.se3 import Poses
from planfit.lsq.covariance import covariances
from planfit.lsq.pose_terms import PosePriorTerm
from planfit.lsq.robust import loss_value
from planfit.lsq.term import Term, robust_cost
from planfit.segmentation import WallPatches

SAME_COST = 5e-3
"""Costs that differ by less, as a share of what walls cost at most, are those of one optimum."""
SAME_PLACE_M = 0.03
"""Ends whose cameras lie closer (RMS) are one optimum."""
CLEAR_SHARE = 0.5
"""Where every stretch of the walk has this share of its wall explained, no other start is tried."""
STRETCH = PATCHES_PER_STRETCH
"""Wall patches of a stretch."""
REACH_SIGMAS = 2.0
"""A loss is made as wide as so many sigmas of the patch's place."""
VOTED_WIDTH = 3.0
"""Factor on the width of losses after a vote: several of its steps."""
RIVAL_COST = 10.0
"""A rival whose full cost is this much higher counts 1/e as much as the result: errors of one wall, or of the
matches of one place, are not independent, so costs are no log likelihoods to the letter."""
MAX_SHIFTED_RIVALS = 4
"""Places elsewhere that are kept, the likeliest."""
_MAX_FRAMES = 40
"""Covariances of so many frames are solved for; between them they are interpolated."""

WHOLE_SIGMA_M = 0.1
"""Sigma of the alignment of the whole scan, each axis."""
_WHOLE_SIGMA_DEG = 1.0
"""Sigma of its yaw."""
MAX_REACH_M = 0.6
"""No loss is made wider than this, and no face is taken that lies twice as far."""


@dataclass(frozen=True)
class Rival:
    """Another optimum that a start ended in: it costs more, though perhaps little."""

    plan_from_cams: Poses
    excess_cost: float
    """Full cost above that of the result; of the same poses put elsewhere as a whole, by the odds that other
    walls were moved."""

    @property
    def odds(self) -> float:
        """How likely it is for each time that the result is right."""
        return float(np.exp(-self.excess_cost / RIVAL_COST))


def rival_by_odds(plan_from_cams: Poses, odds: float) -> Rival:
    """A rival that is right so often for each time that the result is; none is likelier than the result."""
    return Rival(plan_from_cams, max(-RIVAL_COST * float(np.log(odds)), 0.0))


@dataclass(frozen=True)
class Competition:
    """The cheapest end, and where the other starts ended."""

    best: Alternation
    rivals: tuple[Rival, ...] = ()
    """Ends of other starts, where one was tried and did not end in the same place; and where else the whole
    scan fits, if other walls were moved."""


def best_of_starts(task: PlanTask, plan_from_cams: Poses) -> Competition:
    """Adjust from one start after the other, until the best is confirmed or clearly good; the cheapest end.

    The second start should look far: two narrow ones agree on the same wrong place. Where two end
    differently, each end is judged once walls that stand elsewhere than drawn are let go of: a moved wall is
    cheap where poses are right, and poses that bend to it pay for that elsewhere.

    Args:
        plan_from_cams: aligned, loops closed.
    """
    return _with_other_places(task, _best_of_starts(task, plan_from_cams))


def _best_of_starts(task: PlanTask, plan_from_cams: Poses) -> Competition:
    first, *others = task.options.starts
    best = _adjust(task, first, plan_from_cams)
    if not others or is_clear(task, best):
        return Competition(without_moved_walls(task, best))
    second = _adjust(task, others[0], plan_from_cams)
    if _is_same(task, best, second):
        return Competition(without_moved_walls(task, best))
    ends = [without_moved_walls(task, end) for end in (best, second)]
    for name in others[1:]:
        ends.append(without_moved_walls(task, _adjust(task, name, plan_from_cams)))
        cheapest, next_one, *_ = sorted(ends, key=lambda end: full_cost(task, end))
        if _is_same(task, cheapest, next_one):
            break
    return _decided(task, ends)


def _is_same(task: PlanTask, first: Alternation, second: Alternation) -> bool:
    """Whether two ends are one optimum: of one cost, in one place."""
    same_cost = SAME_COST * float(limits(task).sum())
    if abs(full_cost(task, first) - full_cost(task, second)) > same_cost:
        return False
    apart_m = first.plan_from_cams[:, :3, 3] - second.plan_from_cams[:, :3, 3]
    return bool(np.mean(np.sum(apart_m**2, axis=1)) < SAME_PLACE_M**2)


def _decided(task: PlanTask, ends: list[Alternation]) -> Competition:
    costs = [full_cost(task, end) for end in ends]
    first = int(np.argmin(costs))
    rivals = tuple(
        Rival(end.plan_from_cams, cost - costs[first])
        for k, (end, cost) in enumerate(zip(ends, costs, strict=True))
        if k != first
    )
    return Competition(ends[first], rivals)


def _with_other_places(task: PlanTask, found: Competition) -> Competition:
    """Also where the whole scan fits if other walls were moved; there, if more walls stand as drawn. And on
    the other copy of a plan that is drawn twice, whichever costs less."""
    copy_m = on_other_copy(task.walls_at(found.best.plan_from_cams))
    if copy_m is not None:
        again = _elsewhere(task, found.best, copy_m)
        if not _is_same(task, found.best, again):
            decided = _decided(task, [found.best, again])
            found = replace(decided, rivals=(*found.rivals, *decided.rivals))
    shifts = _other_places(task, found.best)
    if shifts and shifts[0].n_for > shifts[0].n_against:
        again = _elsewhere(task, found.best, shifts[0].by_m)
        if full_cost(task, again) < full_cost(task, found.best):
            found = _decided(task, [again, found.best])
            shifts = _other_places(task, found.best)
    placed = found.best.plan_from_cams
    held = robust_cost(task.extra_terms, placed)
    rivals = []
    for shift in shifts[:MAX_SHIFTED_RIVALS]:
        there = _shifted(placed, shift.by_m)
        more = RIVAL_COST * shift.unlikeliness + robust_cost(task.extra_terms, there) - held
        rivals.append(Rival(there, max(more, 0.0)))
    return replace(found, rivals=(*found.rivals, *rivals))


def _other_places(task: PlanTask, end: Alternation) -> tuple[Shift, ...]:
    moved_m = end.correspondences.moved_m
    return () if moved_m is None else other_places(task.walls_at(end.plan_from_cams), moved_m)


def _elsewhere(task: PlanTask, end: Alternation, by_m: Float[np.ndarray, " 2"]) -> Alternation:
    """Where an adjustment ends that starts so far beside where another one ended."""
    start = _shifted(end.plan_from_cams, by_m)
    return without_moved_walls(task, alternate(task, start, task.options.wall_distances_m[-1:]))


def _shifted(plan_from_cams: Poses, by_m: Float[np.ndarray, " 2"]) -> Poses:
    there = plan_from_cams.copy()
    there[:, :2, 3] += by_m
    return there


def full_cost(task: PlanTask, end: Alternation) -> float:
    """Robust cost of all terms where a solve ended, with the price of each wall that was moved.

    A wall patch without face costs what one at the last distance does.
    """
    held = end.problem.correspondences
    assert held is not None
    lost = held.walls.face_idx < 0
    # Pieces of a wall between its doors, and its two sides, are moved by one cause.
    n_walls = len(np.unique(wall_numbers(held.moved_faces, task.floorplan)))
    solved = sum(cost.after for cost in end.solution.cost_by_term.values())
    return solved + float(limits(task)[lost].sum()) + PRICE * n_walls


def _adjust(task: PlanTask, name: str, plan_from_cams: Poses) -> Alternation:
    start = _STARTS[name](task, plan_from_cams)
    return alternate(task, start, task.options.wall_distances_m[-1:])


def limits(task: PlanTask) -> Float[np.ndarray, " k"]:
    """Cost of each wall patch that lies as far from its face as a patch may."""
    walls = task.options.model("walls")
    worst, _ = loss_value(_far(task), walls.loss)
    return 0.5 * worst[0] * observations_of(task.measurements.structure.walls, walls)


def patch_costs(task: PlanTask, end: Alternation) -> Float[np.ndarray, " k"]:
    """Cost of each patch's middle as a share of the most it can cost: 0 on its face, 1 far from any."""
    walls = task.options.model("walls")
    off = np.nan_to_num(end.correspondences.walls.distance_m, nan=1e3) / walls.sigma
    cost, _ = loss_value(off**2, walls.loss)
    worst, _ = loss_value(_far(task), walls.loss)
    return np.minimum(cost / worst[0], 1.0)


def is_clear(task: PlanTask, end: Alternation) -> bool:
    """Whether every stretch of the walk has most of its wall explained."""
    explained = 1.0 - patch_costs(task, end)
    worth = limits(task)
    if len(explained) == 0:
        return True
    window = np.ones(min(STRETCH, len(explained)))
    share = np.convolve(explained * worth, window, "valid") / np.maximum(
        np.convolve(worth, window, "valid"), 1e-12
    )
    return bool(share.min() > CLEAR_SHARE)


def _far(task: PlanTask) -> Float[np.ndarray, " 1"]:
    """Squared residual of a patch as far off as a patch may be."""
    return np.array([(task.options.wall_distances_m[-1] / task.options.model("walls").sigma) ** 2])


def _as_aligned(_: PlanTask, plan_from_cams: Poses) -> Poses:
    return plan_from_cams


def _reaching(task: PlanTask, plan_from_cams: Poses) -> Poses:
    """Each patch reaches as far as its pose may be off."""
    problem = build_problem(task.measurements, task.options, plan_from_cams)
    patches = task.measurements.structure.walls
    sigmas = patch_sigmas(patches, problem.scan_terms, plan_from_cams)
    return narrow(task, plan_from_cams, _widths(task, REACH_SIGMAS * sigmas))


def _wide(task: PlanTask, plan_from_cams: Poses) -> Poses:
    """Every patch reaches as far as any may: where the recorded motion is worse than its sigmas."""
    n_patches = len(task.measurements.structure.walls)
    return narrow(task, plan_from_cams, _widths(task, np.full(n_patches, np.inf)))


def _voted(task: PlanTask, plan_from_cams: Poses) -> Poses:
    """Stretches first shifted to where most of their wall finds faces."""
    patches, options = task.measurements.structure.walls, task.options
    walls = options.model("walls")
    if len(patches) == 0:
        return plan_from_cams
    furthest_m = min(MAX_SHIFT_M, max(options.wall_distances_m))
    voted = vote(task.walls_at(plan_from_cams), observations_of(patches, walls), furthest_m)
    scale_m = walls.sigma * walls.loss.scale
    return narrow(task, voted, _widths(task, np.full(len(patches), VOTED_WIDTH * scale_m)))


def _widths(task: PlanTask, reach_m: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """Factors on the scale of the walls' loss for a reach, up to the widest there is."""
    walls = task.options.model("walls")
    scale_m = walls.sigma * walls.loss.scale
    furthest_m = min(MAX_REACH_M, max(task.options.wall_distances_m) / 2)
    return np.maximum(np.minimum(reach_m, furthest_m) / scale_m, 1.0)


_STARTS: dict[str, Callable[[PlanTask, np.ndarray], np.ndarray]] = {
    "reach": _reaching,
    "vote": _voted,
    "wide": _wide,
    "aligned": _as_aligned,
}


def patch_sigmas(
    patches: WallPatches, scan_terms: Sequence[Term], plan_from_cams: Poses
) -> Float[np.ndarray, " k"]:
    """Standard deviation (m) of each wall patch's place along its normal, before walls take part.

    From what the scan says of itself, and a prior that holds the whole as well as an alignment does: weak
    for each pose, so that stretches are as free of each other as odometry and matches leave them.

    Args:
        scan_terms: matches, floor and odometry.
        plan_from_cams: poses with loops closed, aligned.
    """
    n = len(plan_from_cams)
    # n priors of sigma s sqrt(n) hold the whole to s.
    rotation, translation = np.deg2rad(_WHOLE_SIGMA_DEG), WHOLE_SIGMA_M
    each = np.array([rotation] * 3 + [translation] * 3) * np.sqrt(n)
    prior = PosePriorTerm(np.arange(n), plan_from_cams, each, name="alignment")
    frames = np.unique(np.linspace(0, n - 1, min(n, _MAX_FRAMES)).round().astype(int))
    known = covariances([*scan_terms, prior], plan_from_cams, frames)
    # Of yaw, x and y: a patch's place is the camera's, swung by the lever to the patch.
    known = known[:, 2:5, 2:5]
    flat = known.reshape(len(frames), 9)
    at = np.stack([np.interp(patches.frame_idx, frames, flat[:, k]) for k in range(9)], axis=1)
    normals, ends = wall_patches_in_plan(patches, plan_from_cams)
    lever = ends.mean(axis=1) - plan_from_cams[patches.frame_idx, :2, 3]
    by_yaw = -lever[:, 1] * normals[:, 0] + lever[:, 0] * normals[:, 1]
    jacobian = np.column_stack([by_yaw, normals])
    variance = np.einsum("ki,kij,kj->k", jacobian, at.reshape(-1, 3, 3), jacobian)
    return np.sqrt(np.maximum(variance, 0.0))
