"""Starts of the adjustment whose truth is known: flats, a lounge, and two real scans, drifted anew."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from faults.inputs import Inputs
from faults.scans import conslam, drifted, kitchen
from flats import FlatOptions, make_flat
from jaxtyping import Float
from problems import Problem
from robustness import with_missing_walls, with_moved_walls

from planfit import RefineOptions
from planfit.adjust import AdjustOptions, Measurements, close_loops, hold_to_keyframes
from planfit.alignment import Alignment
from planfit.evaluation import position_errors
from planfit.floorplan import Floorplan
from planfit.pipeline.align import ScanOnPlan, align_to_plan
from planfit.pipeline.observations import extract_observations
from planfit.pipeline.prepare import PreparedScan, prepare
from planfit.runtime import Runtime, StageTimer

WAYS = {
    "loops": FlatOptions(),
    "neighbours": FlatOptions(loops=False),
    "no matches": FlatOptions(loops=False, neighbours=0),
}
PERCENT = (1.0, 2.0, 4.0)
PLANS = ("right", "moved", "missing")
LOUNGE = FlatOptions(
    n_rooms=(1, 1), room_m=(8.0, 10.0), step_m=0.126, round_share=0.3, depth_sigma_share=0.01
)
"""About 370 frames of one large room."""
LOUNGE_CLUTTER = 0.3
"""Without masks, furniture is taken for wall."""
LOUNGE_START_M = (0.42, 0.73)
"""Error of the recorded poses (RMS, m), from one start to another."""


@dataclass(frozen=True)
class Start:
    """A scan with its loops closed, aligned with a plan."""

    group: str
    name: str
    prepared: PreparedScan
    on_plan: ScanOnPlan
    true_plan_from_cams: Float[np.ndarray, "n 4 4"]
    moved_m: Float[np.ndarray, " f"] | None = None
    """How far the wall of each face stands off where it is drawn, where faces were moved."""

    @property
    def measurements(self) -> Measurements:
        """Of all frames."""
        return self.prepared.measurements

    @property
    def floorplan(self) -> Floorplan:
        """In metres."""
        assert self.on_plan.floorplan is not None
        return self.on_plan.floorplan

    @property
    def plan_from_cams(self) -> Float[np.ndarray, "n 4 4"]:
        """Where the adjustment begins."""
        return self.on_plan.plan_from_level @ self.prepared.level_from_keys


def flat_starts(first_seed: int, n: int) -> Iterator[Start]:
    """All ways, drifts and plans in turn, each with a flat and a walk of its own."""
    for seed in range(first_seed, first_seed + n):
        name = list(WAYS)[seed % len(WAYS)]
        percent = PERCENT[seed // len(WAYS) % len(PERCENT)]
        plan = PLANS[seed // (len(WAYS) * len(PERCENT)) % len(PLANS)]
        problem = make_flat(seed, percent, WAYS[name])
        rng = np.random.default_rng(1000 + seed)
        built, moved_m = problem.floorplan, None
        if plan == "moved":
            problem = with_moved_walls(problem, 0.3, rng)
            apart = (built.ends - problem.floorplan.ends)[:, 0]
            moved_m = np.einsum("fi,fi->f", apart, built.normals)
        if plan == "missing":
            problem = with_missing_walls(problem, 0.5, rng)
        words = f"flat {seed}, {name}, {percent:g} %, plan {plan}"
        yield _start("flats", words, problem, rng, moved_m)


def lounge_starts(first_seed: int, n: int) -> Iterator[Start]:
    """One large room with niches and pilasters, seen by time of flight; every other walk without loops."""
    for seed in range(first_seed, first_seed + n):
        way = replace(LOUNGE, loops=seed % 2 == 0)
        rng = np.random.default_rng(2000 + seed)
        target_m = float(rng.uniform(*LOUNGE_START_M))
        percent = 2.0
        for _ in range(3):  # what is random of the drift stays, so its error grows with its size
            problem = make_flat(seed, percent, way, LOUNGE_CLUTTER)
            percent *= target_m / _start_error_m(problem)
        words = f"lounge {seed}, {'loops' if way.loops else 'neighbours'}, {target_m:.2f} m"
        yield _start("lounge", words, problem, rng)


def conslam_starts(first_seed: int, n: int) -> Iterator[Start]:
    """The real building site, labelled by geometry."""
    return _real_starts("ConSLAM", conslam, range(first_seed, first_seed + n))


def kitchen_starts(first_seed: int, n: int) -> Iterator[Start]:
    """7-Scenes' red kitchen: three walls of a room, drawn by hand."""
    return _real_starts("kitchen", kitchen, range(first_seed, first_seed + n))


def _start(
    group: str,
    name: str,
    problem: Problem,
    rng: np.random.Generator,
    moved_m: Float[np.ndarray, " f"] | None = None,
) -> Start:
    recorded, measurements = problem.initial_plan_from_cams, problem.measurements
    closed = close_loops(measurements, recorded, AdjustOptions()).target_from_cams
    # Drift turns and shifts the whole from its first frame on; an alignment takes that out.
    whole = _rigid(closed, problem.true_plan_from_cams, rng)
    keyframes = hold_to_keyframes(recorded, np.arange(len(recorded)))
    prepared = PreparedScan(keyframes, measurements, np.eye(4), recorded, closed)
    # A given place: these rooms look alike turned by half, and a search would doubt every one of them.
    given = Alignment(whole, 1.0, None, is_as_recorded=True)
    on_plan = ScanOnPlan(problem.floorplan, whole, given, None)
    return Start(group, name, prepared, on_plan, problem.true_plan_from_cams, moved_m)


def _start_error_m(problem: Problem) -> float:
    return position_errors(problem.initial_plan_from_cams, problem.true_plan_from_cams).rms_m


def _rigid(poses: np.ndarray, true: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Transform (4, 4) that brings poses to the truth as a whole, from above, but for 0.15 m and 1 degree."""
    xy, target = poses[:, :2, 3], true[:, :2, 3]
    # As complex numbers, the rotation that best takes a to b is the angle of sum of conj(a) b.
    a, b = (xy - xy.mean(0)) @ [1, 1j], (target - target.mean(0)) @ [1, 1j]
    yaw = np.angle(np.sum(np.conj(a) * b)) + np.deg2rad(rng.normal())
    c, s = np.cos(yaw), np.sin(yaw)
    whole = np.eye(4)
    whole[:2, :2] = [[c, -s], [s, c]]
    whole[:2, 3] = target.mean(0) - whole[:2, :2] @ xy.mean(0) + rng.normal(0.0, 0.15, 2)
    return whole


def _real_starts(group: str, make: Callable[[], Inputs], seeds: range) -> Iterator[Start]:
    """A real scan, drifted anew; its images are looked at once, with the first drift."""
    base = make()
    by_geometry = replace(RefineOptions().segmentation, back_end="geometry")
    # The scale of these plans is right; whether it is found so is not asked here.
    as_drawn = replace(RefineOptions().align, metric_scale_tolerance=0.0)
    options = RefineOptions(segmentation=by_geometry, align=as_drawn)
    timer = StageTimer(Runtime())
    seen = extract_observations(drifted(base, seeds[0]).scan, options, timer=timer)
    # Tracking was judged of that drift alone: the others are believed as any tracker is.
    seen = replace(seen, tracking=None)
    for seed in seeds:
        inputs = drifted(base, seed)
        prepared = prepare(inputs.scan, seen, options, timer)
        on_plan = align_to_plan(inputs.scan, prepared, base.floorplan, options, timer)
        true = base.true_plan_from_world @ base.true_world_from_cams
        yield Start(group, f"{group} {seed}", prepared, on_plan, true)


GROUPS: dict[str, Callable[[int, int], Iterator[Start]]] = {
    "flats": flat_starts,
    "lounge": lounge_starts,
    "kitchen": kitchen_starts,
    "conslam": conslam_starts,
}
"""Starts of each group: from a seed on, so many."""
