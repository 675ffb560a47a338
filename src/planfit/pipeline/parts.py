"""Parts of a walk placed on the plan one by one, where the walk as a whole does not fit it.

A jump that no revisit spans leaves nothing but the plan to say where the walk went on. The walk is cut at
steps that are unusually long and that no matched keypoints bridge; each part with enough wall is aligned by
itself, as a scan of its own. Parts of 50 frames of a walk through an office lay within 0.12 m of the truth
so, where three jumps of 3 m had put the whole 4 to 15 m off.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.adjust.voting import PATCHES_PER_STRETCH
from planfit.alignment import Alignment, align
from planfit.alignment.evidence import MAX_SAMPLES
from planfit.alignment.plan_scale import CLEAR_GAIN
from planfit.alignment.refine import AlignmentHypothesis, explained
from planfit.alignment.wall_samples import WallSamples, thin
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.matching.cycles import spanned_steps
from planfit.matching.surfaces.types import SurfacePairs
from planfit.matching.surfaces.witnesses import AGREE_SIGMAS, squared_sigmas
from planfit.pipeline.align import wall_samples
from planfit.pipeline.on_plan import ScanOnPlan
from planfit.pipeline.options import RefineOptions
from planfit.pipeline.prepare import PreparedScan
from planfit.scan.odometry import LONG, times_usual, usual_step
from planfit.tracking import Tracking
from planfit.tracking.breaks import is_far
from planfit.tracking.types import describe_jump, leaps, size_of

MIN_PATCHES = PATCHES_PER_STRETCH
"""Wall patches of a part that is placed by itself; smaller ones stay with the part before."""
POOR_SCORE, GOOD_SCORE = 0.4, 0.6
"""A part that the plan explains less of than the first, where the scan as a whole is aligned, is in question;
alone it has to reach the second."""
NEARLY_AS_GOOD = CLEAR_GAIN
"""Of places that explain less than the best by no more, the one with the most usual step to it is taken."""
SIGMA_M, SIGMA_DEG = 0.5, 3.0
"""Of where walls put a part that drift has bent."""


@dataclass(frozen=True)
class _Part:
    """Keyframes `first` to `last`, between two cuts."""

    first: int
    last: int
    alignment: Alignment


def placed_by_parts(
    prepared: PreparedScan,
    tracking: Tracking,
    on_plan: ScanOnPlan,
    options: RefineOptions,
) -> Tracking | None:
    """The walk with its parts where the plan has them; None where none stands elsewhere than recorded.

    Args:
        prepared: loops closed.
        tracking: of all frames.
        on_plan: where the scan as a whole was aligned.
        options: those of the run.
    """
    plan, found = on_plan.floorplan, on_plan.alignment
    if not (options.tracking.is_judged and options.tracking.mend):
        return None  # all is to stay as recorded
    if plan is None or found is None or options.align.method == "paper":
        return None
    plan = plan.used()
    parts = _parts(prepared, _cuts(prepared, tracking))
    if len(parts) < 2 or not _is_any_poor(prepared, parts, plan, found):
        return None
    chosen = replace(options.align, control_points=(), start="", candidate=1)
    aligned = [
        _Part(first, last, align(_walls_of(prepared, first, last), plan, chosen))
        for first, last in parts
    ]
    return _chained(prepared, tracking, aligned)


def _cuts(prepared: PreparedScan, tracking: Tracking) -> Int[np.ndarray, " c"]:
    """Steps between keyframes that are as long as a jump and that no matched keypoints bridge."""
    steps = prepared.measurements.odometry.cam_from_next
    if len(steps) == 0:
        return np.zeros(0, dtype=int)
    is_bridged = spanned_steps(prepared.measurements.matches.pairs, len(steps))
    is_long = times_usual(steps, usual_step(steps)) > LONG
    is_jump = np.array([is_far(*size_of(step)) for step in steps])
    # Steps about lost frames are open already, and what is beyond them was placed, or is said to be lost.
    is_open = np.isin(prepared.keyframes.frame_idx[:-1], tracking.open_steps)
    return np.flatnonzero(is_long & is_jump & ~is_bridged & ~is_open)


def _parts(prepared: PreparedScan, cuts: Int[np.ndarray, " c"]) -> list[tuple[int, int]]:
    """First and last keyframe of each part with enough wall; the others belong to the part before."""
    n = len(prepared.level_from_keys)
    part = np.searchsorted(cuts, np.arange(n))
    frames = prepared.measurements.structure.walls.frame_idx
    n_patches = np.bincount(part[frames], minlength=len(cuts) + 1)
    starts = [0]
    for k in range(1, len(cuts) + 1):
        is_first_enough = n_patches[:k].sum() >= MIN_PATCHES
        if n_patches[k] >= MIN_PATCHES and is_first_enough:
            starts.append(int(cuts[k - 1]) + 1)
    ends = [*(start - 1 for start in starts[1:]), n - 1]
    return list(zip(starts, ends, strict=True))


def _walls_of(prepared: PreparedScan, first: int, last: int) -> WallSamples:
    structure = prepared.measurements.structure
    n = len(prepared.level_from_keys)
    part = structure.with_walls_of(_is_within(n, first, last))
    return wall_samples(part, prepared.level_from_keys)


def _is_within(n: int, first: int, last: int) -> Bool[np.ndarray, " n"]:
    return (np.arange(n) >= first) & (np.arange(n) <= last)


def _is_any_poor(
    prepared: PreparedScan, parts: list[tuple[int, int]], plan: Floorplan, found: Alignment
) -> bool:
    """Whether the plan explains little of a part where the whole was aligned."""
    here = AlignmentHypothesis.from_transform(found.plan_from_level)
    scores = []
    for first, last in parts:
        samples, weights = thin(_walls_of(prepared, first, last), MAX_SAMPLES)
        scores.append(explained(samples, weights, plan, here)[0])
    return min(scores) < POOR_SCORE


def _chained(prepared: PreparedScan, tracking: Tracking, parts: list[_Part]) -> Tracking | None:
    """The walk with each part where it lies on the plan, from the surest one on to both sides."""
    good = [k for k, each in enumerate(parts) if _is_good(each)]
    if not good:
        return None
    surest = max(good, key=lambda k: parts[k].alignment.score * (parts[k].last - parts[k].first))
    plan_from_level: list[Float[np.ndarray, "4 4"]] = [np.eye(4)] * len(parts)
    plan_from_level[surest] = parts[surest].alignment.plan_from_level
    for k in range(surest + 1, len(parts)):
        plan_from_level[k] = _place_of(
            prepared, parts[k], plan_from_level[k - 1], parts[k].first - 1
        )
    for k in range(surest - 1, -1, -1):
        plan_from_level[k] = _place_of(prepared, parts[k], plan_from_level[k + 1], parts[k].last)
    return _with_jumps(prepared, tracking, parts, plan_from_level)


def _is_good(part: _Part) -> bool:
    return part.alignment.is_sure and part.alignment.score >= GOOD_SCORE


def _place_of(
    prepared: PreparedScan,
    part: _Part,
    beside: Float[np.ndarray, "4 4"],
    step: int,
) -> Float[np.ndarray, "4 4"]:
    """plan_from_level of a part, next to one that was placed; as recorded where walls do not tell.

    No place is believed that the walk would leap to, whatever fits there: a room behind a mirror, 13.7 m off.
    """
    found = part.alignment
    if found.score < GOOD_SCORE:
        return beside
    poses, recorded = prepared.level_from_keys, prepared.measurements.odometry.cam_from_next
    usual = usual_step(recorded)
    places = [found.plan_from_level]
    if not found.is_sure:
        near = [each for each in found.candidates if each.score > found.score - NEARLY_AS_GOOD]
        places = [each.plan_from_level for each in near] or places

    def step_to(place: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "1 4 4"]:
        before, after = (beside, place) if step < part.first else (place, beside)
        return (se3.inverse(before @ poses[step]) @ after @ poses[step + 1])[None]

    walked = [
        place for place in places if not leaps(step_to(place), recorded[step][None], usual[0])[0]
    ]
    return min(walked, key=lambda place: times_usual(step_to(place), usual)[0], default=beside)


def _with_jumps(
    prepared: PreparedScan,
    tracking: Tracking,
    parts: list[_Part],
    plan_from_level: list[Float[np.ndarray, "4 4"]],
) -> Tracking | None:
    """The tracking with its steps from part to part as the plan says, where that is a jump from recorded."""
    keys, poses = prepared.keyframes.frame_idx, tracking.world_from_cams.copy()
    steps = tracking.odometry.cam_from_next.copy()
    sigmas = tracking.odometry.sigma_rotation.copy(), tracking.odometry.sigma_translation.copy()
    jumps = []
    for k in range(1, len(parts)):
        before, after = parts[k].first - 1, parts[k].first
        on_plan = [
            place @ prepared.level_from_keys[key]
            for place, key in ((plan_from_level[k - 1], before), (plan_from_level[k], after))
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


def contradict_places(
    surfaces: SurfacePairs, before: Tracking, placed: Tracking
) -> Bool[np.ndarray, " p"]:
    """Pairs by surfaces over a step that walls placed, which show another motion than the walls do.

    Frames beside a jump that see the same corner are led astray by another like it together, so each confirms
    the other: two pairs of 0.3 of the views put a part 2.6 m along an office that the plan had placed within
    0.2 m.

    Args:
        surfaces: of all frames.
        before: the tracking that was placed.
        placed: with its parts where the plan has them.
    """
    is_placed = np.any(before.odometry.cam_from_next != placed.odometry.cam_from_next, axis=(1, 2))
    n_placed = np.concatenate([[0], np.cumsum(is_placed)])
    i, j = surfaces.pairs.T
    over = np.flatnonzero(n_placed[j] > n_placed[i])
    i, j = i[over], j[over]
    told = se3.inverse(placed.world_from_cams[i]) @ placed.world_from_cams[j]
    off = squared_sigmas(surfaces[over], told, placed.odometry.sigma_between(i, j))
    contradicts = np.zeros(len(surfaces), dtype=bool)
    contradicts[over] = off > AGREE_SIGMAS**2
    return contradicts
