"""Torn steps: recorded steps that an adjustment gave up, and the revisits that tear them.

A robust loss lets go of a step that contradicts all else. That is right where tracking failed, and wrong
where a revisit is false: then the walk is torn at the step that least holds it, and nothing says so. A
tracker fails seldom, and the frames beside its failure see it; so a step that no frames beside it contradict
is believed, and of the visits on the way round it the one that explains least of its views is given up.
(Compare switchable constraints, Suenderhauf and Protzel 2012, which switch loops one by one.)
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.adjust.measurements import Measurements
from planfit.adjust.options import TermOptions
from planfit.findings import Finding, ScanKind
from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.matching import RelativePoses, group_visits, relative_poses_of
from planfit.matching.cycles import (
    SIGMA_ROTATION_DEG,
    SIGMA_TRANSLATION_M,
    is_near,
    spanned_steps,
)
from planfit.matching.pose_graph import LoopGraph
from planfit.scan.odometry import Odometry
from planfit.tracking.types import MIN_WITNESSES

MIN_SIGMAS = 12.0
"""A step within so many sigmas of the recorded one (norm of six numbers) is not torn."""
MIN_TIMES_USUAL = 5.0
"""Nor is one within so many times the median of the walk: where all steps are off, the sigmas are wrong."""
BROKEN_SIGMAS, BROKEN_M, BROKEN_DEG = 15.0, 0.3, 5.0
"""The path is broken at a step that departs from the tracker's by so many sigmas, and by so much."""
LOST_M, LOST_RAD = 1e3, 10.0
"""Sigmas of a step that is left out of a graph."""


@dataclass(frozen=True)
class TornStep:
    """A recorded step that the solved poses do not keep."""

    frames: tuple[int, int]
    """Before and after it, as numbered in the scan."""
    recorded_m: float
    """Length as recorded."""
    solved_m: float
    """Length as solved."""
    departure_m: float
    """How far its end lies from where the recorded step ends."""
    departure_deg: float
    """How much it is turned against the recorded one."""
    sigmas: float
    """Departure from the recorded step, norm of six numbers in sigmas."""


@dataclass(frozen=True)
class DroppedVisit:
    """A visit that was given up, for the step that it tears."""

    first: tuple[int, int]
    """First and last frame of the earlier stretch."""
    second: tuple[int, int]
    """Of the later one."""
    n_pairs: int
    step: TornStep

    @property
    def finding(self) -> Finding:
        """For a user."""
        facts = {"recorded_m": self.step.recorded_m, "solved_m": self.step.solved_m}
        return Finding(ScanKind.REVISIT_TEARS_STEP, facts, (self.first, self.second))


def find_torn_steps(
    measurements: Measurements, target_from_cams: Poses, options: TermOptions
) -> tuple[TornStep, ...]:
    """Steps beyond their sigmas and beyond what is usual on this walk, the worst first."""
    odometry = measurements.odometry
    if options.weight <= 0 or len(odometry.cam_from_next) == 0:
        return ()
    by_rotation, by_translation = _in_sigmas(odometry, target_from_cams)
    sigmas = np.hypot(by_rotation, by_translation)
    most = max(MIN_SIGMAS, MIN_TIMES_USUAL * float(np.median(sigmas)))
    torn = np.flatnonzero(sigmas > most)
    return _described(
        measurements, target_from_cams, torn[np.argsort(-sigmas[torn], kind="stable")]
    )


def find_broken_steps(measurements: Measurements, target_from_cams: Poses) -> tuple[TornStep, ...]:
    """Steps where no tracker walked, by decimetres or many degrees, in their order.

    Whatever is usual on this walk, and whether or not the odometry took part: a result's path that is broken
    there is doubtful, unless frames about the step were matched over it and saw what was solved.
    """
    odometry = measurements.odometry
    rotation, translation = step_departures(odometry.cam_from_next, target_from_cams)
    by_rotation, by_translation = _in_sigmas(odometry, target_from_cams)
    by_angle = (by_rotation > BROKEN_SIGMAS) & (np.rad2deg(rotation) > BROKEN_DEG)
    by_way = (by_translation > BROKEN_SIGMAS) & (translation > BROKEN_M)
    is_broken = by_angle | by_way
    if is_broken.any():
        is_broken &= ~_are_witnessed(measurements, target_from_cams)
    return _described(measurements, target_from_cams, np.flatnonzero(is_broken))


def _are_witnessed(measurements: Measurements, target_from_cams: Poses) -> Bool[np.ndarray, " s"]:
    """Steps over which enough pairs of frames nearby were matched whose motion is the solved one."""
    edges = relative_poses_of(measurements.matches)
    edges = edges[group_visits(edges, target_from_cams, measurements.odometry) < 0]
    a, b = target_from_cams[edges.pairs].swapaxes(0, 1)
    exact = np.zeros(len(edges)), np.zeros(len(edges))
    agreeing = edges.pairs[is_near(edges.a_from_b, se3.inverse(a) @ b, exact)]
    return spanned_steps(np.sort(agreeing), len(target_from_cams) - 1, MIN_WITNESSES)


def step_departures(
    recorded: Float[np.ndarray, "s 4 4"], target_from_cams: Poses
) -> tuple[Float[np.ndarray, " s"], Float[np.ndarray, " s"]]:
    """How far (rad, m) each solved step departs from the recorded one; n = s + 1."""
    solved = se3.inverse(target_from_cams[:-1]) @ target_from_cams[1:]
    departure = se3.inverse(recorded) @ solved
    return (
        np.asarray(se3.rotation_angle(departure[:, :3, :3])),
        np.linalg.norm(departure[:, :3, 3], axis=1),
    )


def visits_that_tear(
    measurements: Measurements, recorded_from_cams: Poses, torn: tuple[TornStep, ...]
) -> tuple[Bool[np.ndarray, " p"], tuple[DroppedVisit, ...]]:
    """Pairs (p,) of the visits that cannot be right where torn steps are, and those visits.

    Args:
        recorded_from_cams: recorded poses of the same frames, any axes.
    """
    edges = relative_poses_of(measurements.matches)
    visit = group_visits(edges, recorded_from_cams, measurements.odometry)
    frame_idx = _frame_idx(measurements, len(recorded_from_cams))
    ways = _LoopPaths(edges, visit, recorded_from_cams, measurements.odometry)
    is_dropped, dropped = np.zeros(len(edges), dtype=bool), []
    for step in torn:
        s = int(np.searchsorted(frame_idx, step.frames[0]))
        for one in ways.contradicting(s, ~is_dropped):
            is_own = visit == one
            is_dropped |= is_own
            ends = frame_idx[np.sort(edges.pairs[is_own], axis=1)]
            (first, second), (last_first, last_second) = ends.min(axis=0), ends.max(axis=0)
            stretches = (int(first), int(last_first)), (int(second), int(last_second))
            dropped.append(DroppedVisit(*stretches, int(is_own.sum()), step))
    return is_dropped, tuple(dropped)


@dataclass(frozen=True)
class _LoopPaths:
    """Ways through the walk, over recorded steps and verified pairs."""

    edges: RelativePoses
    visit: Int[np.ndarray, " p"]
    world_from_cams: Poses
    odometry: Odometry

    def contradicting(self, step: int, is_left: Bool[np.ndarray, " p"]) -> list[int]:
        """Visits to give up among those that span a step.

        None where the frames beside the step contradict it, or where enough visits would agree without it:
        then tracking broke there.
        """
        pairs, without = self.edges.pairs, self._without(step)
        if not self._agrees(without, is_left & (self.visit < 0), step):
            return []
        own, visits = self.visit[is_left], np.unique(self.visit[is_left])
        every = sorted(map(int, visits[visits >= 0]), key=self._strength, reverse=True)
        spans = (pairs[is_left].min(axis=1) <= step) & (pairs[is_left].max(axis=1) > step)
        near = is_left & (self.visit < 0)
        refused = self._refused(self.odometry, near, every)
        saved = set(refused) - set(self._refused(without, near, every))
        if len(saved) >= MIN_WITNESSES:
            return []
        spanning = set(map(int, own[spans]))
        return [one for one in refused if one in spanning]

    def _strength(self, visit: int) -> tuple[float, int]:
        own = self.edges[self.visit == visit]
        explained = 0.0 if own.explained is None else float(own.explained.max())
        return explained, int(own.n_inliers.sum())

    def _refused(
        self, odometry: Odometry, near: Bool[np.ndarray, " p"], visits: list[int]
    ) -> list[int]:
        """Visits, given strongest first, that contradict stronger ones, steps, or pairs beside them."""
        graph, refused = self._graph(odometry, near), []
        for one in visits:
            own = self.edges[self.visit == one]
            head = own[np.array([np.argmax(own.n_inliers)])]
            motion, *sigmas = graph.most_certain_path(head.pairs)
            if is_near(head.a_from_b, motion, (sigmas[0], sigmas[1]))[0]:
                self._add(graph, own)
            else:
                refused.append(one)
        return refused

    def _agrees(self, odometry: Odometry, is_used: Bool[np.ndarray, " p"], step: int) -> bool:
        """Whether the surest way over these pairs agrees with a recorded step."""
        motion, *sigmas = self._graph(odometry, is_used, step).most_certain_path(
            np.array([[step, step + 1]])
        )
        recorded = self.odometry.cam_from_next[step][None]
        return bool(is_near(motion, recorded, (sigmas[0], sigmas[1]))[0])

    def _graph(
        self, odometry: Odometry, is_used: Bool[np.ndarray, " p"], step: int = 0
    ) -> LoopGraph:
        nodes = np.concatenate([self.edges.pairs, [[step, step + 1]]])
        graph = LoopGraph(self.world_from_cams, odometry, nodes)
        self._add(graph, self.edges[is_used])
        return graph

    def _add(self, graph: LoopGraph, edges: RelativePoses) -> None:
        sigmas = SIGMA_ROTATION_DEG, SIGMA_TRANSLATION_M
        graph.add(edges.pairs, edges.a_from_b, *sigmas)

    def _without(self, step: int) -> Odometry:
        """The odometry with one step as good as unknown."""
        is_lost = np.arange(len(self.odometry.sigma_rotation)) == step
        return replace(
            self.odometry,
            sigma_rotation=np.where(is_lost, LOST_RAD, self.odometry.sigma_rotation),
            sigma_translation=np.where(is_lost, LOST_M, self.odometry.sigma_translation),
        )


def _in_sigmas(
    odometry: Odometry, target_from_cams: Poses
) -> tuple[Float[np.ndarray, " s"], Float[np.ndarray, " s"]]:
    """Departures of rotation and translation, norms of three numbers each."""
    rotation, translation = step_departures(odometry.cam_from_next, target_from_cams)
    return rotation / odometry.sigma_rotation, translation / odometry.sigma_translation


def _described(
    measurements: Measurements, target_from_cams: Poses, steps: Int[np.ndarray, " t"]
) -> tuple[TornStep, ...]:
    odometry = measurements.odometry
    rotation, translation = step_departures(odometry.cam_from_next, target_from_cams)
    sigmas = np.hypot(*_in_sigmas(odometry, target_from_cams))
    solved = np.linalg.norm(np.diff(target_from_cams[:, :3, 3], axis=0), axis=1)
    recorded = np.linalg.norm(odometry.cam_from_next[:, :3, 3], axis=1)
    frame_idx = _frame_idx(measurements, len(target_from_cams))
    return tuple(
        TornStep(
            frames=(int(frame_idx[s]), int(frame_idx[s + 1])),
            recorded_m=float(recorded[s]),
            solved_m=float(solved[s]),
            departure_m=float(translation[s]),
            departure_deg=float(np.rad2deg(rotation[s])),
            sigmas=float(sigmas[s]),
        )
        for s in steps
    )


def _frame_idx(measurements: Measurements, n: int) -> Int[np.ndarray, " n"]:
    return np.arange(n) if measurements.frame_idx is None else measurements.frame_idx
