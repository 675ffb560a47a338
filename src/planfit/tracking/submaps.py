"""Steps that nothing measured and that look like a jump: cut there, and placed by revisits.

Where neighbouring images do not match (a wall close up, a quick turn), a jump cannot be told from a long
step. Such a step is doubtful: its sigma is as wide as itself while revisits are sought. What they then agree
on decides, pairs of submaps with the most agreement first. Without an answer the recorded step stands.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from planfit.findings import Finding, PoseKind
from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.matching import Matches
from planfit.matching.cycles import spanned_steps
from planfit.matching.relative_motions import VerifiedPairs
from planfit.matching.types import RelativePoses
from planfit.scan.odometry import (
    LONG,
    USUAL_SHARE,
    Odometry,
    step_sizes,
    times_usual,
    usual_step,
)
from planfit.tracking.breaks import (
    MIN_JUMP_DEG,
    MIN_JUMP_M,
    Votes,
    consensus,
    is_far,
    is_large,
    isotropic,
    votes_on,
)
from planfit.tracking.lost_runs import SAME
from planfit.tracking.motions import (
    MAX_SIGMAS,
    MeasuredMotions,
    departures,
    expected_covariance,
    measured_motions,
    squared_sigmas,
)
from planfit.tracking.types import (
    MIN_WITNESSES,
    Tracking,
    TrackingBreak,
    describe_jump,
    leaps,
    size_of,
    submaps_of,
)


@dataclass(frozen=True)
class _Placed:
    """Submaps on the way to stand together."""

    poses: Poses
    group: Int[np.ndarray, " n"]
    """Frames of one group are placed against each other."""
    n_votes: Int[np.ndarray, " n"]
    """Revisits that placed the group of a frame; 0 where none did."""
    is_moved: bool
    """Whether any group was placed otherwise than recorded."""
    sigma: tuple[float, float]
    """The largest of the displacements, of rotation (rad) and translation (m), each axis."""

    def is_beyond(self, way_m: float, angle_deg: float) -> bool:
        """Whether two groups stand otherwise to each other by more than their places are unsure."""
        rotation, translation = (MAX_SIGMAS * sigma for sigma in self.sigma)
        return way_m > translation or angle_deg > np.rad2deg(rotation)


@dataclass(frozen=True)
class _Merge:
    """Two groups that revisits put together."""

    first: int
    second: int
    n_agree: int
    displaced: Float[np.ndarray, "4 4"]
    """Of the second group."""
    sigma: tuple[float, float]
    stays: bool
    """Whether the second group stands where revisits say already."""


def find_doubtful(
    world_from_cams: Poses, odometry: Odometry, motions: MeasuredMotions
) -> Int[np.ndarray, " d"]:
    """Steps (frame i to i + 1) that no measured motion confirms and that are unusually long."""
    squared = squared_sigmas(
        departures(motions, world_from_cams), expected_covariance(motions, odometry)
    )
    n_steps = len(world_from_cams) - 1
    # Along a corridor surfaces agree with any step.
    widest = np.linalg.eigvalsh(motions.covariance[:, 3:, 3:])[:, -1]
    confirms = (squared < MAX_SIGMAS**2) & (widest < MIN_JUMP_M**2)
    is_confirmed = spanned_steps(motions.pairs[confirms], n_steps)
    length, angle = step_sizes(odometry.cam_from_next)
    is_long = np.zeros(n_steps, dtype=bool)
    if n_steps and is_confirmed.any():
        for size, least in (
            (length, MIN_JUMP_M),
            (angle, np.deg2rad(MIN_JUMP_DEG)),
        ):
            is_long |= size > max(LONG * float(np.quantile(size[is_confirmed], USUAL_SHARE)), least)
    return np.flatnonzero(is_long & ~is_confirmed)


def pairs_across(
    steps: Int[np.ndarray, " d"], n_frames: int, neighbours: int
) -> Int[np.ndarray, "p 2"]:
    """Pairs of frames about these steps, further apart than neighbours, up to twice as far; sorted."""
    found = {
        (first, first + gap)
        for step in steps.tolist()
        for gap in range(neighbours + 1, 2 * neighbours + 1)
        for first in range(max(step - gap + 1, 0), min(step, n_frames - 1 - gap) + 1)
    }
    return np.array(sorted(found), dtype=int).reshape(-1, 2)


def with_open_steps(odometry: Odometry, steps: Int[np.ndarray, " d"]) -> Odometry:
    """The same with sigmas of these steps as wide as the steps themselves: half their length and angle."""
    length, angle = step_sizes(odometry.cam_from_next)
    rotation, translation = odometry.sigma_rotation.copy(), odometry.sigma_translation.copy()
    rotation[steps] = np.maximum(rotation[steps], angle[steps] / 2)
    translation[steps] = np.maximum(translation[steps], length[steps] / 2)
    return replace(odometry, sigma_rotation=rotation, sigma_translation=translation)


def place_submaps(tracking: Tracking, matches: Matches) -> Tracking:
    """Decide the doubtful steps of a trajectory by revisits that were matched with them open.

    Args:
        matches: of the whole scan, found with `with_open_steps`.
    """
    n, doubtful = len(tracking.world_from_cams), tracking.doubtful_steps
    group = submaps_of(n, doubtful, tracking.linked)
    # Revisits say where a submap is however unsure the steps between are: those do not make votes less sure.
    inside = _with_usual_steps(tracking.odometry, tracking.open_steps)
    placed = _Placed(tracking.world_from_cams, group, np.zeros(n, dtype=int), False, (0.0, 0.0))
    revisits = motions_between(matches, group)
    while True:
        merged = _merge_surest(placed, revisits, inside, tracking)
        if merged is None:
            break
        placed = merged
    found = replace(tracking, doubtful_steps=np.zeros(0, dtype=int))
    if placed.is_moved or len(tracking.open_steps):
        found = _with_placed(tracking, _chained(tracking, placed), placed)
    is_undecided = placed.group[doubtful] != placed.group[doubtful + 1]
    return replace(found, undecided_steps=np.setdiff1d(doubtful[is_undecided], found.open_steps))


def _with_usual_steps(odometry: Odometry, steps: Int[np.ndarray, " d"]) -> Odometry:
    """The same with median sigmas of these steps, where theirs are wider."""
    rotation, translation = (
        np.where(is_among, np.minimum(sigma, np.median(sigma)), sigma)
        for is_among in [np.isin(np.arange(len(odometry.sigma_rotation)), steps)]
        for sigma in (odometry.sigma_rotation, odometry.sigma_translation)
    )
    return replace(odometry, sigma_rotation=rotation, sigma_translation=translation)


def motions_between(matches: Matches, group: Int[np.ndarray, " n"]) -> MeasuredMotions:
    """Motions of matched pairs between frames of different groups."""
    between = np.flatnonzero(group[matches.pairs[:, 0]] != group[matches.pairs[:, 1]])
    points = [
        (matches.points_a[of], matches.points_b[of], matches.sigma[of])
        for of in (slice(matches.start[k], matches.start[k + 1]) for k in between)
    ]
    motions = np.array([se3.fit_rigid(b, a, 1.0 / s**2) for a, b, s in points]).reshape(-1, 4, 4)
    sizes = np.array([len(a) for a, _, _ in points], dtype=int)
    relative = RelativePoses(matches.pairs[between], motions, sizes)
    found = VerifiedPairs(relative, [p[0] for p in points], [p[1] for p in points])
    return measured_motions(found)


def _merge_surest(
    placed: _Placed,
    revisits: MeasuredMotions,
    odometry: Odometry,
    tracking: Tracking,
) -> _Placed | None:
    """The two groups that most revisits agree on, put together; None where none are left.

    Not where the walk would leap from one to the other: in offices that look alike, 98 revisits agreed on one
    of them 10 m away, and a recorded step of 8 m became one of 13.
    """
    ends = np.sort(placed.group[revisits.pairs], axis=1)
    covariance = expected_covariance(revisits, odometry)
    merges = []
    for first, second in np.unique(ends[ends[:, 0] != ends[:, 1]], axis=0).tolist():
        of = (ends == (first, second)).all(axis=1)
        if of.sum() < MIN_WITNESSES:
            continue
        votes = votes_on(placed.poses, revisits[of], covariance[of], placed.group == second)
        merges += [
            merge
            for merge in _merge(votes, first, second)
            if merge.stays or not _leaps(placed, merge, tracking)
        ]
    if not merges:
        return None
    best = max(merges, key=lambda m: m.n_agree)  # the first of equals
    moves = placed.group == best.second
    group = np.where(moves, best.first, placed.group)
    n_votes = np.where(moves | (placed.group == best.first), best.n_agree, placed.n_votes)
    if best.stays:
        return replace(placed, group=group, n_votes=n_votes)
    poses = placed.poses.copy()
    poses[moves] = best.displaced @ poses[moves]
    rotation, translation = (max(*s) for s in zip(placed.sigma, best.sigma, strict=True))
    return _Placed(poses, group, n_votes, True, (rotation, translation))


def _leaps(placed: _Placed, merge: _Merge, tracking: Tracking) -> bool:
    """Whether a doubtful step between two groups would be longer than any of a walk, and not as recorded."""
    # Over frames that were lost the walk went on, nobody knows how far.
    doubtful, group = np.setdiff1d(tracking.doubtful_steps, tracking.open_steps), placed.group
    ends = np.sort(np.column_stack([group[doubtful], group[doubtful + 1]]), axis=1)
    between = doubtful[(ends == (merge.first, merge.second)).all(axis=1)]
    moves = (group == merge.second)[:, None, None]
    poses = np.where(moves, merge.displaced @ placed.poses, placed.poses)
    told = se3.inverse(poses[between]) @ poses[between + 1]
    recorded = tracking.odometry.cam_from_next
    return bool(leaps(told, recorded[between], usual_step(recorded)[0]).any())


def _merge(votes: Votes, first: int, second: int) -> list[_Merge]:
    """How revisits between two groups would put the second one; nothing where too few agree."""
    found = consensus(votes, np.arange(len(votes.displaced)), MAX_SIGMAS)
    if found is None:
        return []
    displaced, covariance = found
    agrees = votes.cost(displaced) < MAX_SIGMAS**2
    if agrees.sum() < MIN_WITNESSES:
        return []
    # Drift between the ends is shared by all votes, and no jump where it explains each of them.
    is_drift = bool(np.median(votes.cost(np.eye(4))[agrees]) < MAX_SIGMAS**2)
    stays = is_drift or not is_large(displaced, votes.pivot)
    return [_Merge(first, second, int(agrees.sum()), displaced, isotropic(covariance), stays)]


def _chained(tracking: Tracking, placed: _Placed) -> Poses:
    """Poses of all frames, the groups that nothing placed hung on by recorded steps, the likeliest first."""
    recorded, poses, group = tracking.world_from_cams, placed.poses.copy(), placed.group.copy()
    steps = tracking.odometry.cam_from_next
    unlikely = times_usual(steps, usual_step(steps))
    unlikely[tracking.open_steps] = np.inf
    doubtful = tracking.doubtful_steps
    for step in doubtful[np.argsort(unlikely[doubtful], kind="stable")]:
        if group[step] == group[step + 1]:
            continue
        moves = group == group[step + 1]
        next_in_world = poses[step] @ tracking.odometry.cam_from_next[step]
        poses[moves] = next_in_world @ se3.inverse(poses[step + 1]) @ poses[moves]
        group[moves] = group[step]
    # The first frame stays where it was recorded.
    return recorded[0] @ se3.inverse(poses[0]) @ poses


def _with_placed(tracking: Tracking, poses: np.ndarray, placed: _Placed) -> Tracking:
    """The tracking with the steps that were placed otherwise than recorded."""
    odometry, doubtful = tracking.odometry, tracking.doubtful_steps
    steps = odometry.cam_from_next.copy()
    now = se3.inverse(poses[doubtful]) @ poses[doubtful + 1]
    departure = np.abs(now - steps[doubtful]).max(axis=(1, 2))
    changed = doubtful[departure > SAME]
    is_open = np.isin(doubtful, tracking.open_steps)
    sizes = [size_of(se3.inverse(odometry.cam_from_next[s]) @ _step(poses, s)) for s in changed]
    # Groups that were placed one by one stand a little otherwise to each other than recorded: no jump.
    is_jump = np.array([is_far(*size) for size in sizes], dtype=bool)
    is_jump &= ~np.isin(changed, tracking.open_steps)
    jumps = changed[is_jump]
    # A group that no revisit placed may belong to the one before as well as to the one after; about lost
    # frames nothing is known that could be contradicted.
    is_unsure = (placed.n_votes[changed] == 0) | (placed.n_votes[changed + 1] == 0)
    is_beyond = np.array([placed.is_beyond(*size) for size in sizes], dtype=bool)
    if np.any(is_jump & is_unsure & is_beyond):
        return _unplaced(tracking, changed)
    is_found = placed.group[doubtful] == placed.group[doubtful + 1]
    steps[doubtful] = now
    rotation, translation = odometry.sigma_rotation.copy(), odometry.sigma_translation.copy()
    moved, found = np.setdiff1d(changed, tracking.open_steps), doubtful[is_open & is_found]
    for sigma, of_votes in zip((rotation, translation), placed.sigma, strict=True):
        sigma[moved] = np.hypot(sigma[moved], of_votes)
        sigma[found] = max(float(np.median(sigma)), of_votes)
    # No tracker walked them: what places them are revisits, which the adjustment has itself.
    told = with_open_steps(Odometry(steps, rotation, translation), found)
    recorded, votes = tracking.recorded_world_from_cams, placed.n_votes
    breaks = [
        describe_jump(recorded, poses, int(s), int(max(votes[s], votes[s + 1])), "revisits")
        for s in jumps
    ] + [_described_found(int(s), poses, int(votes[s])) for s in found]
    open_steps = doubtful[is_open & ~is_found]
    return replace(
        tracking,
        world_from_cams=poses,
        odometry=told,
        breaks=tuple(sorted((*tracking.breaks, *breaks), key=lambda b: b.first_frame)),
        doubtful_steps=np.zeros(0, dtype=int),
        open_steps=open_steps,
        linked=(*tracking.linked, *_linked_by_votes(placed, open_steps)),
    )


def _step(poses: np.ndarray, step: int) -> np.ndarray:
    """Motion between poses (n, 4, 4) over a step."""
    return se3.inverse(poses[step]) @ poses[step + 1]


def _linked_by_votes(placed: _Placed, open_steps: Int[np.ndarray, " o"]) -> list[tuple[int, int]]:
    """Frames before and after open steps that revisits brought together; those between may still be lost."""
    submap = submaps_of(len(placed.group), open_steps, ())
    links = []
    for group in np.unique(placed.group[placed.n_votes > 0]):
        frames = np.flatnonzero(placed.group == group)
        leaves = np.flatnonzero(np.diff(submap[frames]))
        links += [(int(frames[k]), int(frames[k + 1])) for k in leaves]
    return links


def _described_found(step: int, poses: np.ndarray, n_votes: int) -> TrackingBreak:
    """A step about lost frames that revisits told."""
    size = size_of(se3.inverse(poses[step]) @ poses[step + 1])
    facts = {"step_m": size[0], "step_deg": size[1], "revisit_count": n_votes}
    finding = Finding(PoseKind.PLACED_BY_REVISITS, facts, ((step, step + 1),))
    return TrackingBreak("lost", step, step + 1, size, size, n_votes, finding)


def _unplaced(tracking: Tracking, changed: np.ndarray) -> Tracking:
    """The tracking as recorded, with a break that says that it jumped somewhere among doubtful steps."""
    first, last = int(changed[0]), int(changed[-1]) + 1
    poses = tracking.world_from_cams
    size = size_of(se3.inverse(poses[first]) @ poses[last])
    finding = Finding(PoseKind.REVISITS_CONTRADICT_MOTION, frames=((first, last),))
    found = TrackingBreak("jump", first, last, size, size, 0, finding)
    breaks = tuple(sorted((*tracking.breaks, found), key=lambda b: b.first_frame))
    return replace(
        tracking,
        breaks=breaks,
        doubtful_steps=np.zeros(0, dtype=int),
        contradicted_steps=np.setdiff1d(changed, tracking.open_steps),
    )
