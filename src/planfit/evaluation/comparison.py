"""Two sets of poses of one scan, A and B: where they differ, and which of them the evidence prefers.

Four witnesses are heard: matches, the plan, the map, and free space. Each decides by one number; the others
that it has stand beside it. What the two share (matches that both were solved with, say) prefers neither.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from planfit.adjust.association import wall_patches_in_plan
from planfit.alignment import align, sample_walls
from planfit.errors import ScanError
from planfit.evaluation.agreement import (
    looked_through_share,
    match_distances,
    near_pairs,
    read_thumbnails,
)
from planfit.evaluation.evaluate import (
    ComparedPoses,
    EvaluateOptions,
    RefinedPoses,
    evaluate,
    levelled,
)
from planfit.evaluation.map_quality import MapOptions
from planfit.evaluation.metrics import Metric
from planfit.evaluation.surfaces import NEAR_FACE_M, wall_distances, wall_frame_idx
from planfit.evaluation.trajectory import (
    PoseDifferences,
    Stretch,
    largest_stretches,
    pose_differences,
)
from planfit.geometry import se3
from planfit.matching import Matches
from planfit.runtime import Changeable, Runtime, require_kinds, short_repr
from planfit.scan import Scan, calibrated_scan

Side = Literal["a", "b", "neither"]
Poses = Float[np.ndarray, "n 4 4"] | RefinedPoses
MIN_MATCHES = 30
"""The median distance of fewer matches tells too little."""
REVISIT_FRAMES = 10
"""Matches of frames further apart than this are of a revisit, which says more than neighbours do; frames
that match no other are not counted."""
MAX_PAIR_M = 0.5
"""A pair of frames whose matched points are further apart counts no more."""
_SAME_SCALE = 1e-3
"""Plans whose unit was found within this share of each other have one frame."""


@dataclass(frozen=True)
class CompareOptions(Changeable):
    """How two sets of poses are compared."""

    align: bool = False
    """Move B onto A as a whole before distances are taken, by the rigid motion that fits positions best."""
    depth_maps: bool = True
    """Hear the witnesses that read every depth map: the map, and free space."""
    map: MapOptions = field(default_factory=MapOptions)
    """The points that the map is made of."""

    def __post_init__(self) -> None:
        require_kinds(self)


@dataclass(frozen=True)
class Witness:
    """What one kind of evidence says."""

    name: str
    deciding: Metric
    """A as before, B as after; lower is better."""
    least: tuple[float, float]
    """A smaller difference, as a share of the larger value, or in the metric's unit, says nothing."""

    @property
    def prefers(self) -> Side:
        """Which of the two."""
        a, b = self.deciding.before, self.deciding.after
        share, amount = self.least
        if abs(a - b) <= max(share * max(abs(a), abs(b)), amount):
            return "neither"
        return "b" if b < a else "a"


@dataclass(frozen=True)
class LocalEvidence:
    """A stretch where A and B differ, and what its own frames say; NaN where too little."""

    stretch: Stretch
    match_m: tuple[float, float]
    """Median distance of matched points with one of these frames, A and B."""
    near_share: tuple[float, float]
    """Share of wall points near the plan, A and B."""


@dataclass(frozen=True)
class Comparison:
    """Where A and B differ, and what the evidence says of each."""

    axes: Literal["plan", "world"]
    """Of the differences: the plan's, where both are on the same one; else the scan's own."""
    poses: ComparedPoses
    """A as before, B as after."""
    differences: PoseDifferences
    stretches: tuple[LocalEvidence, ...]
    """Where they differ most, the largest first."""
    witnesses: tuple[Witness, ...]
    metrics: dict[str, Metric]
    """All that was taken; A as before, B as after."""
    notes: tuple[str, ...] = ()

    __repr__ = short_repr

    @property
    def preferred(self) -> Side:
        """What most of the witnesses that prefer one say."""
        votes = [witness.prefers for witness in self.witnesses]
        n_a, n_b = votes.count("a"), votes.count("b")
        return "neither" if n_a == n_b else "a" if n_a > n_b else "b"


def compare(
    scan: Scan,
    a: Poses,
    b: Poses,
    matches: Matches | None = None,
    options: CompareOptions | None = None,
    runtime: Runtime | None = None,
) -> Comparison:
    """Compare two sets of poses of a scan: where they differ, and which the evidence prefers.

    Args:
        scan: that both are poses of, as it was refined; its sensor is corrected here as A has it, or B where
            A is poses alone.
        a: a result of `planfit.refine`, or poses of all frames in the scan's own axes. Beside a result on a
            plan, such poses are put onto it by the walls they make.
        b: likewise.
        matches: by which both are judged; those of `planfit.refine`'s result or `extract_observations`.
        options: defaults to all evidence, nothing aligned.
        runtime: threads, cache and progress.

    Raises:
        ScanError: a file of the scan cannot be used, or there are not as many poses as frames.
        OptionError: an option has a value that cannot work.
    """
    chosen, running = options or CompareOptions(), runtime or Runtime()
    _require_all_frames(scan, a, b)
    poses, axes, notes = _side_by_side(scan, a, b, running)
    scan = _as_corrected(scan, a, b)
    compared = poses.plan_from_cams if axes == "plan" else poses.world_from_cams
    differences = pose_differences(*compared, chosen.align)
    taken = EvaluateOptions(depth_maps=chosen.depth_maps, map=chosen.map)
    metrics = dict(evaluate(scan, poses, None, None, taken, running).metrics)
    for metric in (
        *_match_metrics(matches, compared),
        *_free_space_metric(scan, compared, chosen, running),
    ):
        metrics[metric.name] = metric
    stretches = tuple(
        _local_evidence(stretch, poses, matches, running)
        for stretch in largest_stretches(differences)
    )
    return Comparison(
        axes, poses, differences, stretches, _witnesses(metrics), metrics, tuple(notes)
    )


def _as_corrected(scan: Scan, a: Poses, b: Poses) -> Scan:
    """The scan as the first of the two that is a result has corrected its sensor."""
    for poses in (a, b):
        if not isinstance(poses, np.ndarray):
            return calibrated_scan(scan, poses.sensor)
    return scan


def _require_all_frames(scan: Scan, a: Poses, b: Poses) -> None:
    for name, poses in (("A", a), ("B", b)):
        n = len(poses if isinstance(poses, np.ndarray) else poses.plan_from_cams)
        if n != len(scan):
            raise ScanError(
                f"{scan.name}: expected poses of all {len(scan)} frames, found {n} in {name}; compare poses "
                "of the same frames of the same scan"
            )


def _side_by_side(
    scan: Scan, a: Poses, b: Poses, runtime: Runtime
) -> tuple[ComparedPoses, Literal["plan", "world"], list[str]]:
    """Both in the scan's own axes and, where one plan serves both, on it; else upright."""
    world_a, world_b = (p if isinstance(p, np.ndarray) else p.world_from_cams for p in (a, b))
    worlds = (world_a, world_b)
    results = [p for p in (a, b) if not isinstance(p, np.ndarray)]
    on_plan: list[RefinedPoses] = [p for p in results if p.floorplan is not None]
    if len(on_plan) == 2 and _is_one_frame(*on_plan):
        first, second = on_plan
        both = (first.plan_from_cams, second.plan_from_cams)
        return ComparedPoses(first.structure, worlds, both, first.floorplan), "plan", []
    if len(on_plan) == 1:
        (result,) = on_plan
        onto_a, onto_b = (
            result.plan_from_cams if p is result else _by_its_walls(scan, result, world)
            for p, world in zip((a, b), worlds, strict=True)
        )
        both = (onto_a, onto_b)
        return ComparedPoses(result.structure, worlds, both, result.floorplan), "world", []
    if results:
        upright = results[0].initial_plan_from_cams[0] @ se3.inverse(scan.world_from_cams[0])
        structure = results[0].structure
    else:
        upright, structure = levelled(scan, runtime)
    compared = ComparedPoses(structure, worlds, (upright @ world_a, upright @ world_b))
    return compared, "world", _told_of_two_plans(on_plan)


def _told_of_two_plans(on_plan: list[RefinedPoses]) -> list[str]:
    """What is said of two results on different plans, whose fit cannot be compared."""
    if not on_plan:
        return []
    shares = []
    for name, result in zip("AB", on_plan, strict=True):
        assert result.floorplan is not None
        found = wall_distances(result.structure, result.floorplan, result.plan_from_cams)
        shares.append(f"{name} {found.near_share:.0%}" if found else f"{name} no wall")
    return [
        f"A and B are on different plans: {' and '.join(shares)} of the wall within {NEAR_FACE_M:g} m of "
        "its own plan, which does not say which is right; distances are those in the scan's own axes"
    ]


def _is_one_frame(a: RefinedPoses, b: RefinedPoses) -> bool:
    """Whether both are on the same plan, in metres of one length."""
    one, other = a.floorplan, b.floorplan
    if one is None or other is None or len(one) != len(other):
        return False
    size = float(np.abs(one.ends).max())
    return bool(np.abs(one.ends - other.ends).max() <= _SAME_SCALE * size)


def _by_its_walls(
    scan: Scan, result: RefinedPoses, world_from_cams: Float[np.ndarray, "n 4 4"]
) -> Float[np.ndarray, "n 4 4"]:
    """Other poses on the plan of a result, where their own walls fit it best, as `refine` would begin.

    Their nearness to the result is no measure: drift of theirs would then count twice. Without walls, they go
    where the recorded ones went.
    """
    recorded = result.initial_plan_from_cams[0] @ se3.inverse(scan.world_from_cams[0])
    upright = recorded @ world_from_cams
    patches = result.structure.walls
    if result.floorplan is None or not result.structure.has_walls:
        return upright
    eyes = upright[patches.frame_idx, :2, 3]
    walls = sample_walls(*wall_patches_in_plan(patches, upright), seen_from=eyes)
    return align(walls, result.floorplan, recorded=np.eye(4)).plan_from_level @ upright


def _match_metrics(
    matches: Matches | None,
    poses: tuple[Float[np.ndarray, "n 4 4"], Float[np.ndarray, "n 4 4"]],
) -> list[Metric]:
    """Distances of matched points: mean over pairs of frames, and medians of all and of revisits."""
    if matches is None or matches.n_matches < MIN_MATCHES:
        return []
    distances = [match_distances(matches, at) for at in poses]
    # Counted among frames that match: of a long scan these are keyframes, and neighbours among them are many
    # frames apart.
    first, second = np.searchsorted(np.unique(matches.pairs), matches.pairs).T
    apart = np.repeat(second - first, np.diff(matches.start))
    a, b = (100 * _mean_over_pairs(matches, d) for d in distances)
    words = f"matched points, mean over pairs of frames, each at most {MAX_PAIR_M:g} m"
    metrics = [Metric("match_pairs", words, "cm", a, b)]
    for name, meaning, chosen in (
        ("matches", "   median of all", apart > 0),
        (
            "revisits",
            f"   median of frames more than {REVISIT_FRAMES} apart",
            apart > REVISIT_FRAMES,
        ),
    ):
        if chosen.sum() >= MIN_MATCHES:
            a, b = (100 * float(np.median(d[chosen])) for d in distances)
            metrics.append(Metric(name, meaning, "cm", a, b))
    return metrics


def _mean_over_pairs(matches: Matches, distance_m: Float[np.ndarray, " m"]) -> float:
    """Mean over pairs of frames of the median distance (m) of their matched points, bounded.

    A median of all matches would not see a path that is torn at one step; without the bound, a false revisit
    that one side followed would outweigh all that it broke.
    """
    pairs = zip(matches.start[:-1], matches.start[1:], strict=True)
    medians = [np.median(distance_m[first:last]) for first, last in pairs if last > first]
    return float(np.mean(np.minimum(medians, MAX_PAIR_M)))


def _free_space_metric(
    scan: Scan,
    poses: tuple[Float[np.ndarray, "n 4 4"], Float[np.ndarray, "n 4 4"]],
    options: CompareOptions,
    runtime: Runtime,
) -> list[Metric]:
    """Share of points that other views look through."""
    if not options.depth_maps:
        return []
    thumbnails = read_thumbnails(scan, runtime)
    a, b = (at[thumbnails.frame_idx] for at in poses)
    pairs = near_pairs((a, b))
    shares = [100 * looked_through_share(thumbnails, at, pairs) for at in (a, b)]
    if not np.isfinite(shares).all():
        return []
    return [Metric("looked_through", "points that other views look through", "%", *shares)]


def _local_evidence(
    stretch: Stretch, poses: ComparedPoses, matches: Matches | None, runtime: Runtime
) -> LocalEvidence:
    """What the frames of a stretch say."""
    match_m, near_share = (np.nan, np.nan), (np.nan, np.nan)
    if matches is not None:
        own = stretch.contains(matches.pairs).any(axis=1)
        own = np.repeat(own, np.diff(matches.start))
        if own.sum() >= MIN_MATCHES:
            a, b = (
                float(np.median(match_distances(matches, at)[own])) for at in poses.plan_from_cams
            )
            match_m = (a, b)
    if poses.floorplan is not None:
        own = stretch.contains(wall_frame_idx(poses.structure))
        distances = [
            wall_distances(poses.structure, poses.floorplan, at, runtime.workers)
            for at in poses.plan_from_cams
        ]
        if own.any() and distances[0] is not None and distances[1] is not None:
            near = [float(np.mean(d.nearest_m[own] < NEAR_FACE_M)) for d in distances if d]
            near_share = (near[0], near[1])
    return LocalEvidence(stretch, match_m, near_share)


_DECIDING: Sequence[tuple[str, Sequence[tuple[str, tuple[float, float]]]]] = (
    ("matches", [("match_pairs", (0.05, 0.1))]),
    ("plan", [("off_plan", (0.0, 1.0))]),
    ("map", [("double_walls", (0.0, 1.0)), ("mpv", (0.1, 0.0))]),
    ("free space", [("looked_through", (0.05, 0.1))]),
)
"""Of each witness: by which metric it decides, the first that could be taken, and what says nothing of it.

Sharpness (MPV) is a weak witness: with 13 of 40 true poses of a synthetic flat moved by 0.4 m it fell by 8 %.
Walls seen as two layers are heard in its place, where there are walls.
"""


def _witnesses(metrics: dict[str, Metric]) -> tuple[Witness, ...]:
    found = []
    for name, choices in _DECIDING:
        taken = next(((metrics[k], least) for k, least in choices if k in metrics), None)
        if taken is not None:
            metric, least = taken
            found.append(Witness(name, replace(metric, meaning=metric.meaning.strip()), least))
    return tuple(found)
