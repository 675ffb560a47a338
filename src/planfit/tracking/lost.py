"""Lost frames are placed by the motions that the images show, and so is what was tracked after them.

Around each run of lost frames, the frames and all that is known of the motions between them are a small pose
graph: recorded steps before and after, measured motions, and, where the tracker knew its place again, the
recorded motion from the last frame before to the first one after. A step that nothing tells is as long as
steps usually are, in an unknown direction.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.findings import Finding, PoseKind
from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.lsq.pose_terms import BetweenTerm, PosePriorTerm
from planfit.lsq.problem import Problem
from planfit.matching.pose_graph import LoopGraph
from planfit.scan.odometry import Odometry
from planfit.tracking.breaks import is_far, isotropic
from planfit.tracking.lost_runs import LostRun
from planfit.tracking.motions import MAX_SIGMAS, MeasuredMotions
from planfit.tracking.trajectory import measured_term
from planfit.tracking.types import TrackingBreak, size_of

REACH = 8
"""Frames before and after a run that take part."""
FOUND_AGAIN = 3.0
"""A tracker that was lost and found its place again errs more than one that was not, by this factor."""
OPEN_TIMES = 10.0
"""A step that nothing tells may be so many times as long as usual: trackers are lost where images change."""
OPEN_RAD, OPEN_M = np.deg2rad(60.0), 1.0
"""Its sigmas, at least."""
NOWHERE = 1e3
"""Sigma (rad, m) of a step on which no path can rest."""
HELD = 1e-3
"""Sigma (rad, m) of what is not to bend."""
NAMED_M, NAMED_DEG = 0.3, 5.0
"""Where a tracker goes on further off than this after it was lost, it is said."""


@dataclass(frozen=True)
class Filled:
    """Poses with lost frames placed."""

    poses: Poses
    sigmas: dict[int, tuple[float, float]] = field(default_factory=dict)
    """Of the steps that were replaced: rotation (rad) and translation (m), each axis."""
    open_steps: Int[np.ndarray, " d"] = field(default_factory=lambda: np.zeros(0, dtype=int))
    """Steps (frame i to i + 1) that nothing tells, and on which it rests where frames stand."""
    linked: tuple[tuple[int, int], ...] = ()
    """Frames before and after lost ones between which the recorded motion is believed."""
    breaks: tuple[TrackingBreak, ...] = ()


@dataclass(frozen=True)
class _Around:
    """Lost runs near each other and what is known of motions about them; frames counted from `first`."""

    first: int
    """Of the scan."""
    lost: tuple[LostRun, ...]
    """Frames of the scan."""
    is_void: Bool[np.ndarray, " s"]
    """Steps that nothing recorded tells."""
    odometry: Odometry
    """Steps; void ones stand still, and are as unsure as usual steps are long."""
    measured: MeasuredMotions

    @property
    def chain(self) -> Poses:
        """Poses by the steps, from the first frame on."""
        poses = [np.eye(4)]
        for step in self.odometry.cam_from_next:
            poses.append(poses[-1] @ step)
        return np.stack(poses)

    def ends(self, run: LostRun) -> tuple[int, int]:
        """The frame before a run and the one after it."""
        return run.first - 1 - self.first, run.last + 1 - self.first


@dataclass(frozen=True)
class _Link:
    """The recorded motion over a run of lost frames."""

    pair: tuple[int, int]
    a_from_b: Float[np.ndarray, "4 4"]
    sigma: tuple[float, float]
    """rad and m, each axis."""


def void_steps(n: int, lost: Sequence[LostRun]) -> Bool[np.ndarray, " s"]:
    """Which of the n - 1 recorded steps (frame i to i + 1) say nothing."""
    is_void = np.zeros(n - 1, dtype=bool)
    for run in lost:
        is_void[max(run.first - 1, 0) : run.last + 1] = True
    return is_void


def fill_lost(
    recorded: Poses,
    lost: Sequence[LostRun],
    motions: MeasuredMotions,
    odometry: Odometry,
    usual: tuple[float, float],
) -> Filled:
    """Place lost frames, and where the tracker did not know its place afterwards, all that follows.

    The longest part that was tracked without a break stays where it is.

    Args:
        recorded: poses; those of lost frames are not looked at.
        odometry: of the recorded poses, with sigmas that fit this tracker.
        usual: length (m) and angle (rad) of usual steps.
    """
    filled = Filled(recorded)
    for around in _neighbourhoods(recorded, lost, motions, odometry, usual):
        filled = _fill(filled, recorded, around, usual)
    poses, anchor = filled.poses, _longest_part(len(recorded), lost)
    if not np.array_equal(poses[anchor], recorded[anchor]):
        poses = recorded[anchor] @ se3.inverse(poses[anchor]) @ poses
    filled = replace(filled, poses=poses)
    breaks = [found for run in lost for found in _described(recorded, filled, run)]
    return replace(filled, breaks=tuple(breaks))


def _neighbourhoods(
    recorded: Poses,
    lost: Sequence[LostRun],
    motions: MeasuredMotions,
    odometry: Odometry,
    usual: tuple[float, float],
) -> list[_Around]:
    """Runs with what is around them, those that are near each other together."""
    n, groups = len(recorded), []
    for run in lost:
        if groups and run.first - groups[-1][-1].last <= 2 * REACH:
            groups[-1].append(run)
        else:
            groups.append([run])
    is_void = void_steps(n, lost)
    steps = np.where(is_void[:, None, None], np.eye(4), odometry.cam_from_next)
    rotation = np.where(is_void, usual[1], odometry.sigma_rotation)
    translation = np.where(is_void, usual[0], odometry.sigma_translation)
    found = []
    for group in groups:
        first, last = max(group[0].first - REACH, 0), min(group[-1].last + REACH, n - 1)
        is_inside = (motions.pairs[:, 0] >= first) & (motions.pairs[:, 1] <= last)
        inside = motions[np.flatnonzero(is_inside)]
        of = slice(first, last)
        found.append(
            _Around(
                first,
                tuple(group),
                is_void[of],
                Odometry(steps[of], rotation[of], translation[of]),
                replace(inside, pairs=inside.pairs - first),
            )
        )
    return found


def _fill(
    filled: Filled,
    recorded: Poses,
    around: _Around,
    usual: tuple[float, float],
) -> Filled:
    """The lost frames of one neighbourhood placed; what was tracked afterwards follows."""
    links = _believed_links(recorded, around, usual)
    local, _ = _solve(around, links)
    poses, start = filled.poses.copy(), _first_known(around)
    has_link = {link.pair[1] for link in links}
    # World from the local axes, in which the first known frame stands where it stood.
    world_from_local = poses[around.first + start] @ se3.inverse(local[start])
    for run in around.lost:
        before, after = around.ends(run)
        first_after = run.last + 1
        if after < len(local) and after not in has_link and before >= start:
            follows = world_from_local @ local[after] @ se3.inverse(poses[first_after])
            poses[first_after:] = follows @ poses[first_after:]
    for run in around.lost:
        of = slice(run.first - around.first, run.last + 1 - around.first)
        poses[run.first : run.last + 1] = world_from_local @ local[of]
    sigmas, open_steps = _step_sigmas(around, links, usual)
    open_steps = np.concatenate([filled.open_steps, open_steps])
    linked = [(link.pair[0] + around.first, link.pair[1] + around.first) for link in links]
    return Filled(poses, filled.sigmas | sigmas, open_steps, (*filled.linked, *linked))


def _believed_links(recorded: Poses, around: _Around, usual: tuple[float, float]) -> list[_Link]:
    """Recorded motions over lost runs that no measured motions contradict."""
    links: list[_Link] = []
    for run in around.lost:
        before, after = around.ends(run)
        if not run.knows_its_place or before < 0 or after > len(around.is_void):
            continue
        n_steps, link_motion = (
            after - before,
            (se3.inverse(recorded[run.first - 1]) @ recorded[run.last + 1]),
        )
        known = ~around.is_void
        usual_sigmas = [
            float(np.median(s[known])) if known.any() else u
            for s, u in (
                (around.odometry.sigma_rotation, usual[1]),
                (around.odometry.sigma_translation, usual[0]),
            )
        ]
        rotation, translation = (FOUND_AGAIN * np.sqrt(n_steps) * s for s in usual_sigmas)
        swing = rotation * n_steps * usual[0] / np.sqrt(3.0)
        link = _Link((before, after), link_motion, (rotation, float(np.hypot(translation, swing))))
        if not _is_contradicted(around, links, link):
            links.append(link)
    return links


def _is_contradicted(around: _Around, links: Sequence[_Link], link: _Link) -> bool:
    """Whether measured motions lead over the run, and elsewhere than recorded."""
    motion, rotation, translation = _graph(around, links, NOWHERE).most_certain_path(
        np.array([link.pair])
    )
    if rotation[0] >= NOWHERE or translation[0] >= NOWHERE:
        return False
    departure = se3.inverse(link.a_from_b) @ motion[0]
    length, angle = size_of(departure)
    sigmas = np.hypot(link.sigma[0], rotation[0]), np.hypot(link.sigma[1], translation[0])
    squared = (np.deg2rad(angle) / sigmas[0]) ** 2 + (length / sigmas[1]) ** 2
    if squared < MAX_SIGMAS**2 or not is_far(length, angle):
        return False
    # One path may rest on one false motion: all motions together decide.
    with_link, without = (_solve(around, [*links, *own])[1] for own in ([link], []))
    return with_link - without > MAX_SIGMAS**2 / 2


def _graph(around: _Around, links: Sequence[_Link], void_sigma: float | None = None) -> LoopGraph:
    """The graph of all motions; void steps with a sigma of their own."""
    odometry = around.odometry
    if void_sigma is not None:
        rotation, translation = (
            np.where(around.is_void, void_sigma, sigma)
            for sigma in (odometry.sigma_rotation, odometry.sigma_translation)
        )
        odometry = replace(odometry, sigma_rotation=rotation, sigma_translation=translation)
    n = len(around.is_void) + 1
    every = np.column_stack([np.arange(n - 1), np.arange(1, n)])
    graph = LoopGraph(around.chain, odometry, every)
    measured = around.measured
    sigmas = np.array([isotropic(c) for c in measured.covariance]).reshape(-1, 2)
    graph.add(measured.pairs, measured.a_from_b, np.rad2deg(sigmas[:, 0]), sigmas[:, 1])
    for link in links:
        pair, motion = np.array([link.pair]), link.a_from_b[None]
        graph.add(pair, motion, np.rad2deg(link.sigma[:1]), np.array(link.sigma[1:]))
    return graph


def _solve(around: _Around, links: Sequence[_Link]) -> tuple[Poses, float]:
    """Poses in axes of their own by all motions, and the cost at the solution.

    What was recorded is held: it is the lost frames, and whole parts of the walk, that are to be placed.
    """
    n = len(around.is_void) + 1
    start = _first_known(around)
    to_all = np.column_stack([np.full(n, start), np.arange(n)])
    initial, _, _ = _graph(around, links).most_certain_path(to_all)
    steps = np.arange(n - 1)
    void = around.is_void
    sigma = np.column_stack([around.odometry.sigma_rotation, around.odometry.sigma_translation])
    sigma = np.repeat(np.where(void[:, None], sigma, HELD), 3, axis=1)
    pairs = np.column_stack([steps, steps + 1])
    terms = [
        BetweenTerm(pairs, around.odometry.cam_from_next, sigma, name="recorded"),
        PosePriorTerm(np.array([start]), initial[start][None], np.full(6, HELD)),
    ]
    if len(around.measured):
        terms.append(measured_term(around.measured))
    if links:
        linked = np.array([link.pair for link in links])
        motions = np.stack([link.a_from_b for link in links])
        held = np.full(6, HELD)
        terms.append(BetweenTerm(linked, motions, held, name="over lost frames"))
    solution = Problem(terms, initial).solve()
    cost = sum(of_term.after for of_term in solution.cost_by_term.values())
    return solution.target_from_cams, cost


def _step_sigmas(
    around: _Around, links: Sequence[_Link], usual: tuple[float, float]
) -> tuple[dict[int, tuple[float, float]], Int[np.ndarray, " d"]]:
    """Sigmas of the void steps, and those of them that nothing tells; by their numbers in the scan."""
    steps = np.flatnonzero(around.is_void)
    pairs = np.column_stack([steps, steps + 1])
    _, rotation, translation = _graph(around, links, NOWHERE).most_certain_path(pairs)
    is_open = (rotation >= NOWHERE) | (translation >= NOWHERE)
    rotation = np.where(is_open, max(OPEN_TIMES * usual[1], OPEN_RAD), rotation)
    open_m = np.full(len(steps), max(OPEN_TIMES * usual[0], OPEN_M))
    for link in links:
        is_between = (steps >= link.pair[0]) & (steps < link.pair[1])
        # Between two known places one is not further off than these are apart, or than steps go.
        n_steps = link.pair[1] - link.pair[0]
        reach_m = max(size_of(link.a_from_b)[0], usual[0] * np.sqrt(n_steps))
        open_m[is_between] = np.minimum(open_m[is_between], reach_m)
    translation = np.where(is_open, open_m, translation)
    sigmas = zip(rotation.tolist(), translation.tolist(), strict=True)
    return dict(zip((steps + around.first).tolist(), sigmas, strict=True)), (
        steps[is_open] + around.first
    )


def _first_known(around: _Around) -> int:
    """The first frame with a pose."""
    is_lost = np.zeros(len(around.is_void) + 1, dtype=bool)
    for run in around.lost:
        is_lost[run.first - around.first : run.last + 1 - around.first] = True
    return int(np.argmin(is_lost))


def _longest_part(n: int, lost: Sequence[LostRun]) -> int:
    """First frame of the longest part that was tracked without a break."""
    begins = np.array([0, *(run.last + 1 for run in lost)])
    ends = np.array([*(run.first for run in lost), n])
    return int(begins[np.argmax(ends - begins)])


def _described(recorded: Poses, filled: Filled, run: LostRun) -> list[TrackingBreak]:
    """A run of lost frames, and where the tracker took up again elsewhere."""
    before, after = max(run.first - 1, 0), min(run.last + 1, len(recorded) - 1)
    poses = filled.poses
    moved = size_of(se3.inverse(poses[before]) @ poses[after])
    open_steps = filled.open_steps[(filled.open_steps >= before) & (filled.open_steps < after)]
    guessed = {"unmatched_after_frames": tuple(open_steps.tolist())}
    if run.kind == "frozen":
        last = run.last + (not run.knows_its_place)
        shown = size_of(se3.inverse(poses[before]) @ poses[last])
        facts = {"moved_m": shown[0], "moved_deg": shown[1], **guessed}
        finding = Finding(PoseKind.POSE_STANDS_STILL, facts, ((before, last),))
        found = [TrackingBreak("frozen", before, last, (0.0, 0.0), shown, 0, finding)]
    else:
        count = run.last - run.first + 1
        facts = {"lost_count": count, "frame_count": len(recorded), **guessed}
        finding = Finding(PoseKind.POSES_LOST, facts, ((run.first, run.last),))
        found = [TrackingBreak("lost", run.first, run.last, (0.0, 0.0), moved, 0, finding)]
    if run.first == 0 or run.last == len(recorded) - 1:
        return found
    was = size_of(se3.inverse(recorded[before]) @ recorded[after])
    departure = se3.inverse(se3.inverse(recorded[before]) @ recorded[after]) @ (
        se3.inverse(poses[before]) @ poses[after]
    )
    length, angle = size_of(departure)
    if length < NAMED_M and angle < NAMED_DEG:
        return found
    facts = {"departure_m": length, "departure_deg": angle, "next_frame": after, **guessed}
    finding = Finding(PoseKind.ELSEWHERE_AFTER_LOST, facts, ((run.first, run.last),))
    return [*found, TrackingBreak("jump", after - 1, after, was, moved, 0, finding)]
