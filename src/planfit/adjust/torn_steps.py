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
from planfit.adjust.terms.odometry import OdometryTerm, OdometryTermOptions
from planfit.matching import RelativePoses, group_visits, relative_poses_of
from planfit.matching.loop_closure import CycleConsistencyOptions, is_near
from planfit.matching.pose_graph import PoseGraph
from planfit.scan.odometry import Odometry

MIN_SIGMAS = 12.0
"""A step within so many sigmas of the recorded one (norm of six numbers) is not torn."""
MIN_TIMES_USUAL = 5.0
"""Nor is one within so many times the median of the walk: where all steps are off, the sigmas are wrong."""
LOST_M, LOST_RAD = 1e3, 10.0
"""Sigmas of a step that is left out of a graph."""


@dataclass(frozen=True)
class TornStep:
    """A recorded step that the solved poses do not keep."""

    frame_idx: int
    """Frame before the step."""
    next_idx: int
    """Frame after it."""
    recorded_m: float
    """Length as recorded."""
    solved_m: float
    """Length as solved."""
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
    def sentence(self) -> str:
        """For a user."""
        one, other = (_frames(*stretch) for stretch in (self.first, self.second))
        return (
            f"{one} and {other} look alike but cannot be the same place: using them would change a "
            f"recorded step of {self.step.recorded_m:.2f} m to {self.step.solved_m:.2f} m; "
            "they were left out"
        )


def find_torn_steps(
    measurements: Measurements,
    target_from_cams: Float[np.ndarray, "n 4 4"],
    options: OdometryTermOptions,
) -> tuple[TornStep, ...]:
    """Steps beyond their sigmas and beyond what is usual on this walk, the worst first."""
    odometry = measurements.odometry
    if options.weight <= 0 or len(odometry.cam_from_next) == 0:
        return ()
    between = OdometryTerm(odometry, options).between
    sigmas = np.linalg.norm(
        between.residual(target_from_cams[between.pairs]) / between.sigma, axis=1
    )
    most = max(MIN_SIGMAS, MIN_TIMES_USUAL * float(np.median(sigmas)))
    solved = np.linalg.norm(np.diff(target_from_cams[:, :3, 3], axis=0), axis=1)
    recorded = np.linalg.norm(odometry.cam_from_next[:, :3, 3], axis=1)
    frame_idx = _frame_idx(measurements, len(target_from_cams))
    torn = np.flatnonzero(sigmas > most)
    return tuple(
        TornStep(
            int(frame_idx[s]),
            int(frame_idx[s + 1]),
            float(recorded[s]),
            float(solved[s]),
            float(sigmas[s]),
        )
        for s in torn[np.argsort(-sigmas[torn], kind="stable")]
    )


def visits_that_tear(
    measurements: Measurements,
    recorded_from_cams: Float[np.ndarray, "n 4 4"],
    torn: tuple[TornStep, ...],
    options: CycleConsistencyOptions,
) -> tuple[Bool[np.ndarray, " p"], tuple[DroppedVisit, ...]]:
    """Pairs (p,) of the visits to give up so that no torn step is contradicted any more, and the visits.

    Args:
        measurements: those that were solved with.
        recorded_from_cams: recorded poses of the same frames, any axes.
        torn: see `find_torn_steps`.
        options: when two motions agree, and the sigma of a verified one.
    """
    edges = relative_poses_of(measurements.matches)
    visit = group_visits(edges, recorded_from_cams, measurements.odometry, options)
    frame_idx = _frame_idx(measurements, len(recorded_from_cams))
    is_dropped, dropped = np.zeros(len(edges), dtype=bool), []
    for step in torn:
        s = int(np.searchsorted(frame_idx, step.frame_idx))
        way = _WayRound(s, edges, visit, recorded_from_cams, measurements.odometry, options)
        while (one := way.weakest(is_dropped)) is not None:
            is_own = visit == one
            is_dropped |= is_own
            ends = frame_idx[np.sort(edges.pairs[is_own], axis=1)]
            (first, second), (last_first, last_second) = ends.min(axis=0), ends.max(axis=0)
            dropped.append(
                DroppedVisit(
                    (int(first), int(last_first)),
                    (int(second), int(last_second)),
                    int(is_own.sum()),
                    step,
                )
            )
    return is_dropped, tuple(dropped)


@dataclass(frozen=True)
class _WayRound:
    """The ways from the frame before a step to the one after it that do not take the step."""

    step: int
    edges: RelativePoses
    visit: Int[np.ndarray, " p"]
    world_from_cams: Float[np.ndarray, "n 4 4"]
    odometry: Odometry
    options: CycleConsistencyOptions

    def weakest(self, is_dropped: Bool[np.ndarray, " p"]) -> int | None:
        """Of the visits that contradict the step the one that explains least; None where none does."""
        left = ~is_dropped
        if not self._contradicts(left) or self._contradicts(self.visit < 0):
            return None  # or frames beside the step contradict it: then tracking broke there
        spans = (self.edges.pairs.min(axis=1) <= self.step) & (
            self.edges.pairs.max(axis=1) > self.step
        )
        candidates = np.unique(self.visit[left & spans & (self.visit >= 0)])
        alone = [v for v in candidates if not self._contradicts(left & (self.visit != v))]
        # Where none alone is at fault, several are: the weakest goes first.
        among = alone or list(candidates)
        return int(min(among, key=self._strength)) if among else None

    def _strength(self, visit: int) -> tuple[float, int]:
        own = self.edges[self.visit == visit]
        explained = 0.0 if own.explained is None else float(own.explained.max())
        return explained, int(own.n_inliers.sum())

    def _contradicts(self, is_used: Bool[np.ndarray, " p"]) -> bool:
        """Whether the surest way round over these pairs departs from the recorded step."""
        used, s, options = self.edges[is_used], self.step, self.options
        if len(used) == 0:
            return False
        # The step itself is as good as unknown here.
        sigma_rotation, sigma_translation = (
            self.odometry.sigma_rotation.copy(),
            self.odometry.sigma_translation.copy(),
        )
        sigma_rotation[s], sigma_translation[s] = LOST_RAD, LOST_M
        without = replace(
            self.odometry, sigma_rotation=sigma_rotation, sigma_translation=sigma_translation
        )
        ends = np.array([[s, s + 1]])
        graph = PoseGraph(self.world_from_cams, without, np.concatenate([used.pairs, ends]))
        graph.add(
            used.pairs, used.a_from_b, options.sigma_rotation_deg, options.sigma_translation_m
        )
        motion, *sigmas = graph.most_certain_path(ends)
        recorded = self.odometry.cam_from_next[s][None]
        return not is_near(motion, recorded, (sigmas[0], sigmas[1]), options)[0]


def _frame_idx(measurements: Measurements, n: int) -> Int[np.ndarray, " n"]:
    return np.arange(n) if measurements.frame_idx is None else measurements.frame_idx


def _frames(first: int, last: int) -> str:
    return f"frame {first}" if first == last else f"frames {first}-{last}"
