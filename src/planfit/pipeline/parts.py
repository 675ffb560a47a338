"""Parts of a walk placed on the plan one by one, where the walk as a whole does not fit it.

A jump that no revisit spans leaves nothing but the plan to say where the walk went on. Every keyframe stands
at one of a few places on the plan, the same as the one before it unless the tracker jumped between the two:
the likeliest sequence is Viterbi's (1967), by how well each place explains the walls that each keyframe saw.
Places are found as the walk shows them: what none explains is aligned by itself, where a step could lead to.
Of six real floors and sites with a jump of 1 m and 20 degrees in walks of 125 to 249 frames, the part after
the jump was so aligned within 0.2 m and 0.5 degrees of the truth on each.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.adjust.association import wall_patches_in_plan
from planfit.adjust.voting import PATCHES_PER_STRETCH
from planfit.alignment import AlignmentHypothesis, AlignOptions, ControlPoint, WallSamples, align
from planfit.alignment.refine import OBSERVATION_M, closeness
from planfit.alignment.selection import NULL_SCORE
from planfit.floorplan import Floorplan
from planfit.geometry import se3, segments
from planfit.geometry.se3 import Poses
from planfit.matching.cycles import spanned_steps
from planfit.matching.surfaces.types import SurfacePairs
from planfit.matching.surfaces.witnesses import AGREE_SIGMAS
from planfit.pipeline.on_plan import ScanOnPlan
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.prepare import PreparedScan
from planfit.priors import CLEAR_ODDS
from planfit.scan.odometry import step_sizes, unusualness, usual_step
from planfit.tracking import Tracking, with_open_steps
from planfit.tracking.breaks import MIN_JUMP_M, are_far, is_far
from planfit.tracking.types import describe_jump, leaps, reach_m, size_of

MIN_PATCHES = PATCHES_PER_STRETCH
"""Wall patches of a part that is placed by itself; smaller ones stay with the part beside them."""
NOT_DRAWN = 0.1
"""Share of wall that is on no plan, as cupboards are: no sample is less likely."""
JUMPS_A_STEP = 0.01
"""How often trackers jump beforehand, at most."""
PRICE = float(np.log(CLEAR_ODDS.value / JUMPS_A_STEP))
"""Of a jump, and of a place that is not known, in log likelihood."""
MAX_PLACES = 8
"""Of the parts of one walk, at most."""
SAMPLES_APART_M = 0.1
"""Along walls."""
SIGMA_M, SIGMA_DEG = 0.5, 3.0
"""Of where walls put a part that drift has bent."""


@dataclass(frozen=True)
class _Place:
    """Where keyframes may stand on the plan."""

    plan_from_level: Float[np.ndarray, "4 4"]
    log_likelihood: Float[np.ndarray, " n"]
    """Of the walls of each keyframe there."""


@dataclass(frozen=True)
class _Part:
    """Keyframes `first` to `last`, which stand at one place."""

    first: int
    last: int
    place: _Place


@dataclass(frozen=True)
class _Walk:
    """Keyframes, the walls that they saw, and the plan that these are sought on."""

    plan: Floorplan
    level_from_keys: Poses
    recorded: Float[np.ndarray, "s 4 4"]
    """Steps between keyframes as recorded."""
    is_whole: Bool[np.ndarray, " s"]
    """Steps without a jump, whatever walls say: keypoints were matched over them. Or steps about lost frames:
    what is beyond was placed, or is said to be lost."""
    samples: WallSamples
    """Of the walls, level frame."""
    of_key: Int[np.ndarray, " m"]
    """Keyframe that saw each sample."""
    observations: Float[np.ndarray, " m"]
    """What each sample is worth."""
    n_patches: Int[np.ndarray, " n"]

    @staticmethod
    def of(prepared: PreparedScan, tracking: Tracking, plan: Floorplan, poses: Poses) -> "_Walk":
        measured = prepared.measurements
        walls, steps = measured.structure.walls, measured.odometry.cam_from_next
        normals, ends = wall_patches_in_plan(walls, poses)
        xy, patch = segments.sample(ends, SAMPLES_APART_M)
        eyes = poses[walls.frame_idx][:, :2, 3]
        apart_m = segments.lengths(ends) / np.maximum(np.bincount(patch, minlength=len(ends)), 1)
        is_open = np.isin(prepared.keyframes.frame_idx[:-1], tracking.open_steps)
        return _Walk(
            plan,
            poses,
            steps,
            spanned_steps(measured.matches.pairs, len(steps)) | is_open,
            WallSamples(xy, normals[patch], eyes[patch]),
            walls.frame_idx[patch],
            apart_m[patch] / OBSERVATION_M,
            np.bincount(walls.frame_idx, minlength=len(poses)),
        )

    def summed(self, values: Float[np.ndarray, " m"]) -> Float[np.ndarray, " n"]:
        """Logarithms of likelihoods of what samples are explained, over each keyframe."""
        log = np.log(NOT_DRAWN + (1.0 - NOT_DRAWN) * values)
        return np.bincount(self.of_key, self.observations * log, minlength=len(self.n_patches))

    def at(self, plan_from_level: Float[np.ndarray, "4 4"]) -> _Place:
        """A place, with how well it explains the walls."""
        here = AlignmentHypothesis.from_transform(plan_from_level)
        explained = closeness(self.samples, self.plan, here)[0]
        return _Place(plan_from_level, self.summed(explained))

    def unexplained(self, as_a_whole: _Place) -> Float[np.ndarray, " n"]:
        """Log likelihood of the walls of each keyframe where nothing is known of its place; no more than
        walls have on average where the whole walk was placed, as of a plan that lacks most of them."""
        unknown = self.summed(np.full(len(self.of_key), NULL_SCORE))
        return unknown * max(1.0, as_a_whole.log_likelihood.sum() / min(unknown.sum(), -1e-9))

    def log_odds(self, before: _Place, after: _Place) -> Float[np.ndarray, " s"]:
        """Of a change from one place to another at each step: 0 where no jump is, -inf where none can be."""
        poses, usual = self.level_from_keys, usual_step(self.recorded)
        told = se3.inverse(before.plan_from_level @ poses[:-1]) @ (
            after.plan_from_level @ poses[1:]
        )
        gain = unusualness(self.recorded, usual) - unusualness(told, usual)
        is_none = self.is_whole | leaps(told, self.recorded, usual[0])
        # Of places that explain a part alike, as those along a corridor do, one without a jump.
        lengths, angles = step_sizes(se3.inverse(self.recorded) @ told)
        odds = np.where(is_none, -np.inf, gain / 2.0 - PRICE)
        return np.where(are_far(lengths, np.rad2deg(angles)), odds, 0.0)


def placed_by_parts(
    prepared: PreparedScan,
    tracking: Tracking,
    on_plan: ScanOnPlan,
    options: RefineOptions,
) -> Tracking | None:
    """The walk with its parts where the plan has them; None where none stands elsewhere than recorded."""
    plan = _plan_asked(prepared, on_plan, options)
    if plan is None:
        return None
    walk = _Walk.of(prepared, tracking, plan, prepared.level_from_keys)
    places, tried = [walk.at(on_plan.plan_from_level)], set()
    while True:
        path = _likeliest(walk, places, or_unknown=True)
        new = _more_places(walk, places, path, tried, options.align)
        places = [each for k, each in enumerate(places) if k == 0 or k in path]
        if not new or len(places) >= MAX_PLACES:
            break
        places += new
    # What is at no known place, such as a room behind a mirror, stays with what is beside it.
    path = _likeliest(walk, places, or_unknown=False)
    parts = [_Part(first, last, places[k]) for k, first, last in _runs(path)]
    return _with_jumps(prepared, tracking, parts)


def opened_by_walls(
    prepared: PreparedScan,
    tracking: Tracking,
    on_plan: ScanOnPlan,
    options: RefineOptions,
    plan_from_keys: Poses,
) -> Tracking | None:
    """The walk with those steps open that nothing measured and beyond which walls are nowhere on the plan;
    None where all is explained.

    Where walls beyond such a step ask for a place that is not known, the tracker may have jumped there, and
    what is beyond may be anywhere: of a lounge with a jump of 1.2 m, 29 of 125 frames were 2.9 m off and
    predicted to be within 0.06 m. A jump need not be long: of steps of 1 m, one of 1.3 m was of 1.6 m.

    Args:
        plan_from_keys: of keyframes, there.
    """
    plan = _plan_asked(prepared, on_plan, options)
    if plan is None:
        return None
    walk = _Walk.of(prepared, tracking, plan, plan_from_keys)
    if walk.is_whole.all():
        return None
    path = _likeliest(walk, [walk.at(np.eye(4))], or_unknown=True)
    # Between the last keyframe that saw walls here and the first that did there, any step may be it.
    with_walls = np.flatnonzero(walk.n_patches)
    changes = np.flatnonzero(np.diff(path[with_walls]))
    is_open = np.zeros(len(walk.is_whole), dtype=bool)
    for before, after in zip(with_walls[changes], with_walls[changes + 1], strict=True):
        is_open[before:after] = ~walk.is_whole[before:after]
    if not is_open.any():
        return None
    steps = prepared.keyframes.frame_idx[1:][is_open] - 1
    return replace(
        tracking,
        odometry=with_open_steps(tracking.odometry, steps),
        open_steps=np.union1d(tracking.open_steps, steps),
        undecided_steps=np.setdiff1d(tracking.undecided_steps, steps),
    )


def _plan_asked(
    prepared: PreparedScan, on_plan: ScanOnPlan, options: RefineOptions
) -> Floorplan | None:
    """The plan that the walk was aligned to; None where nothing is asked of its parts."""
    plan, found = on_plan.floorplan, on_plan.alignment
    if not (options.tracking.is_judged and options.tracking.mend):
        return None  # all is to stay as recorded
    if plan is None or found is None or options.align.method == "paper":
        return None
    return plan.used() if len(prepared.level_from_keys) > 1 else None


def _more_places(
    walk: _Walk,
    places: Sequence[_Place],
    path: Int[np.ndarray, " n"],
    tried: set[tuple[int, int]],
    options: AlignOptions,
) -> list[_Place]:
    """Of a part that none of the places explains and that is not among those `tried`, which grow."""
    for state, first, last in _runs(path):
        n_patches = walk.n_patches[first : last + 1].sum()
        if state < len(places) or (first, last) in tried or n_patches < MIN_PATCHES:
            continue
        tried.add((first, last))
        found = [
            place
            for inner, outer in ((first, first - 1), (last, last + 1))
            if 0 <= outer < len(path)
            for place in _places_beside(
                walk, (first, last), inner, outer, places[path[outer]].plan_from_level, options
            )
        ]
        if found:
            return found
    return []


def _places_beside(
    walk: _Walk,
    part: tuple[int, int],
    inner: int,
    outer: int,
    plan_from_level: Float[np.ndarray, "4 4"],
    options: AlignOptions,
) -> list[_Place]:
    """Where a part may lie on the plan: its keyframe `inner` a step from one beside, `outer`, that was placed
    there, or where drift alone has it.
    """
    first, last = part
    samples = walk.samples.picked(np.flatnonzero((walk.of_key >= first) & (walk.of_key <= last)))
    poses = walk.level_from_keys
    reach = reach_m(walk.recorded, usual_step(walk.recorded)[0])
    found = []
    for at, tolerance_m in ((inner, MIN_JUMP_M), (outer, float(reach[min(inner, outer)]))):
        near = replace(
            options,
            control_points=(),
            start="",
            candidate=1,
            control_point_tolerance_m=tolerance_m,
        )
        there = (plan_from_level @ poses[at])[:2, 3]
        known = ControlPoint(poses[inner, :2, 3], there)
        aligned = align(samples, walk.plan, near, control_points=[known])
        found += [each for each in aligned.candidates if each.score > NULL_SCORE]
    return [walk.at(each.plan_from_level) for each in found]


def _likeliest(walk: _Walk, places: Sequence[_Place], or_unknown: bool) -> Int[np.ndarray, " n"]:
    """Numbers of the places of the likeliest walk (Viterbi 1967); the last one is of a place not known."""
    log = [place.log_likelihood for place in places] + [walk.unexplained(places[0])] * or_unknown
    n, n_places, n_states = len(log[0]), len(places), len(log)
    change = np.zeros((len(walk.recorded), n_states, n_states))  # step, from, to
    unknown = np.where(walk.is_whole, -np.inf, -PRICE)
    for a, b in np.ndindex(n_states, n_states):
        if a != b:
            is_known = max(a, b) < n_places
            odds = walk.log_odds(places[a], places[b]) if is_known else unknown
            change[:, a, b] = odds
    best, came_from = np.array([each[0] for each in log]), np.zeros((n, n_states), dtype=int)
    for k in range(1, n):
        total = best[:, None] + change[k - 1]
        came_from[k] = np.argmax(total, axis=0)
        best = total.max(axis=0) + [each[k] for each in log]
    path = np.full(n, np.argmax(best))
    for k in range(n - 1, 0, -1):
        path[k - 1] = came_from[k, path[k]]
    return path


def _runs(path: Int[np.ndarray, " n"]) -> list[tuple[int, int, int]]:
    """State, first and last index of each run."""
    starts = [0, *(np.flatnonzero(np.diff(path)) + 1).tolist()]
    ends = [*(start - 1 for start in starts[1:]), len(path) - 1]
    return [(int(path[a]), a, b) for a, b in zip(starts, ends, strict=True)]


def _with_jumps(
    prepared: PreparedScan,
    tracking: Tracking,
    parts: list[_Part],
) -> Tracking | None:
    """The tracking with its steps from part to part as the plan says, where that is a jump from recorded."""
    keys, poses = prepared.keyframes.frame_idx, tracking.world_from_cams.copy()
    steps = tracking.odometry.cam_from_next.copy()
    sigmas = tracking.odometry.sigma_rotation.copy(), tracking.odometry.sigma_translation.copy()
    jumps = []
    for k in range(1, len(parts)):
        before, after = parts[k].first - 1, parts[k].first
        on_plan = [
            part.place.plan_from_level @ prepared.level_from_keys[key]
            for part, key in ((parts[k - 1], before), (parts[k], after))
        ]
        told = se3.inverse(on_plan[0]) @ on_plan[1]
        recorded = se3.inverse(poses[keys[before]]) @ poses[keys[after]]
        if not is_far(*size_of(se3.inverse(recorded) @ told)):
            continue
        # Frames between the two keyframes stay with the first one.
        step = int(keys[after]) - 1
        displaced = poses[keys[before]] @ told @ se3.inverse(poses[keys[after]])
        poses[step + 1 :] = displaced @ poses[step + 1 :]
        steps[step] = se3.inverse(poses[step]) @ poses[step + 1]
        sigmas[0][step], sigmas[1][step] = np.deg2rad(SIGMA_DEG), SIGMA_M
        jumps.append(step)
    if not jumps:
        return None
    was = tracking.recorded_world_from_cams
    told = [describe_jump(was, poses, step, 0, "walls of the plan") for step in jumps]
    # One jump is told once: this says more than what was said of the same step before.
    kept = [b for b in tracking.breaks if b.kind != "jump" or b.first_frame not in jumps]
    odometry = replace(
        tracking.odometry,
        cam_from_next=steps,
        sigma_rotation=sigmas[0],
        sigma_translation=sigmas[1],
    )
    return replace(
        tracking,
        world_from_cams=poses,
        odometry=odometry,
        breaks=tuple(sorted((*kept, *told), key=lambda b: b.first_frame)),
        undecided_steps=np.setdiff1d(tracking.undecided_steps, jumps),
    )


def matched_elsewhere(
    surfaces: SurfacePairs, before: Tracking, placed: Tracking
) -> Bool[np.ndarray, " p"]:
    """Pairs over a step that walls placed whose surfaces were brought together at another motion.

    They were sought about the recorded motion, which is wrong here, and found what is alike there: the other
    end of a corridor, in a direction that they leave free too. Two pairs of 0.3 of the views put a part 2.6 m
    along an office that the plan had placed within 0.2 m; 21 at the recorded motion, none 3 sigmas off the
    truth in what it observes, together put one 0.86 m along a lounge.

    Args:
        before: the tracking that was placed.
        placed: with its parts where the plan has them.
    """
    is_placed = np.any(before.odometry.cam_from_next != placed.odometry.cam_from_next, axis=(1, 2))
    n_placed = np.concatenate([[0], np.cumsum(is_placed)])
    i, j = surfaces.pairs.T
    told = se3.inverse(placed.world_from_cams[i]) @ placed.world_from_cams[j]
    off = se3.difference(told, surfaces.a_from_b).reshape(-1, 2, 3)
    sigmas = np.stack(placed.odometry.sigma_between(i, j), axis=-1)
    is_off = np.sum((off / sigmas[..., None]) ** 2, axis=(1, 2)) > AGREE_SIGMAS**2
    return is_off & (n_placed[j] > n_placed[i])
