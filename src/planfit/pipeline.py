"""The method on one screen: from a posed scan and a floorplan to poses that fit the plan."""

import dataclasses
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from planfit import checks
from planfit.adjust import (
    AdjustOptions,
    Evidence,
    Keyframes,
    WallsPulled,
    choose_keyframes,
    close_loops,
    follow_keyframes,
    pull_walls,
    reduce_evidence,
    refit_scale,
)
from planfit.adjust.association import patches_in_plan
from planfit.align import (
    Alignment,
    AlignOptions,
    WallSamples,
    align,
    align_paper,
    find_unit,
    metric_plan,
    place_pins,
    sample_walls,
)
from planfit.doubts import fit_doubts, scan_doubts
from planfit.errors import FloorplanError, OptionError, require_plain_numbers
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.matching import Matches, MatchingOptions, find_matches
from planfit.scan import Scan
from planfit.scan.odometry import OdometryOptions, make_odometry
from planfit.structure import (
    Gravity,
    Structure,
    StructureOptions,
    extract_structure,
    find_gravity,
    level_from_world,
)
from planfit.work import Work


@dataclass(frozen=True)
class RefineOptions:
    """Everything that can be chosen about a run."""

    odometry: OdometryOptions = field(default_factory=OdometryOptions)
    """How far the recorded motion may be off."""
    structure: StructureOptions = field(default_factory=StructureOptions)
    """Gravity, floor and walls in the scan."""
    matching: MatchingOptions = field(default_factory=MatchingOptions)
    """Keypoint matches between frames."""
    align: AlignOptions = field(default_factory=AlignOptions)
    """The scan's place on the plan."""
    adjust: AdjustOptions = field(default_factory=AdjustOptions)
    """The bundle adjustment."""
    held_out_share: float = 0.1
    """Share of matches kept out of the solve, to check that it did not make things worse."""
    seed: int = 0
    """Seed of that choice."""

    def __post_init__(self) -> None:
        if not 0 <= self.held_out_share <= 0.5:
            raise OptionError(
                f"held_out_share: expected 0 to 0.5, found {self.held_out_share}; what is held out "
                "takes no part in the solve"
            )


@dataclass(frozen=True)
class RefineResult:
    """Refined poses, and all that is needed to judge them."""

    floorplan: Floorplan
    """The plan in metres, at the scale that was found where it had no unit."""
    plan_from_cams: np.ndarray  # (n, 4, 4) refined
    initial_plan_from_cams: np.ndarray  # (n, 4, 4) recorded poses, placed on the plan as a whole
    world_from_plan: np.ndarray  # (4, 4) back to the scan's own axes and height
    gravity: Gravity
    structure: Structure
    matches: Matches
    alignment: Alignment | None
    """None where no wall was seen, so that the scan could not be placed by its walls."""
    walls: WallsPulled
    cost_by_term: dict[str, tuple[float, float]]
    """Robust cost of each term, before and after."""
    checks: tuple[checks.Check, ...]
    doubts: tuple[str, ...]
    """What a user should know before trusting the result, in plain words."""
    seconds_by_stage: dict[str, float]

    @property
    def world_from_cams(self) -> np.ndarray:
        """(n, 4, 4) refined poses in the scan's own axes."""
        return self.world_from_plan @ self.plan_from_cams

    @property
    def is_better(self) -> bool:
        """Whether the scan was surely placed on the plan and no check got worse."""
        is_placed = self.alignment is not None and self.alignment.is_sure
        return is_placed and not any(check.is_worse for check in self.checks)


@dataclass(frozen=True)
class Prepared:
    """What a scan says before a plan is looked at: levelled, matched, loops closed."""

    gravity: Gravity
    structure: Structure
    matches: Matches
    held_out: Matches
    """Matches kept out of the solve."""
    keyframes: Keyframes
    evidence: Evidence
    """Of the keyframes."""
    level_from_world: np.ndarray  # (4, 4)
    level_from_keys: np.ndarray  # (k, 4, 4) keyframes, loops closed


def refine(
    scan: Scan,
    floorplan: Floorplan,
    options: RefineOptions | None = None,
    work: Work | None = None,
) -> RefineResult:
    """Refine the camera poses of a scan so that its reconstruction agrees with the floorplan.

    Args:
        scan: posed RGB-D frames.
        floorplan: wall faces, in metres or in a unit that is found here.
        options: defaults to what works best.
        work: threads, cache and progress; by default nothing is kept and nothing is said.

    Raises:
        ScanError: a file of the scan cannot be used.
        FloorplanError: the plan is not in the unit that it claims, or its unit cannot be found.
        OptionError: an option has a value that cannot work.
    """
    options, work = options or RefineOptions(), work or Work()
    require_plain_numbers(options)
    if not scan.fingerprint:
        work = dataclasses.replace(work, cache_dir=None)  # nothing tells one such scan from another
    clock = Clock(work)

    prepared = prepare(scan, options, work, clock)
    gravity, structure, matches = prepared.gravity, prepared.structure, prepared.matches
    held_out, keyframes, evidence = prepared.held_out, prepared.keyframes, prepared.evidence
    level, level_from_keys = prepared.level_from_world, prepared.level_from_keys
    recorded = level @ scan.world_from_cams
    with clock.stage("place on the plan"):
        claimed = _claimed_place(scan, level) if floorplan.is_metric else None
        alignment = place(prepared, floorplan, options.align, claimed)
        plan_from_level = alignment.plan_from_level if alignment else claimed
        if not floorplan.is_metric and alignment:
            floorplan = metric_plan(floorplan, alignment.scale_xy)
    if alignment is not None and alignment.is_sure and alignment.scale_spread > 0:
        with clock.stage("refit scale"):
            on_plan = alignment.plan_from_level @ level_from_keys
            refit = refit_scale(evidence, floorplan, on_plan, options.adjust)
            floorplan = floorplan.scaled(refit.factor)
            alignment = alignment.rescaled(
                refit.factor, refit.spread, on_plan[:, :2, 3].mean(axis=0)
            )
            plan_from_level = alignment.plan_from_level
    with clock.stage("pull walls"):
        start = np.eye(4) if plan_from_level is None else plan_from_level
        pulled = pull_walls(evidence, floorplan, start @ level_from_keys, options.adjust)

    if claimed is not None and (alignment is None or alignment.is_as_recorded):
        start = claimed
    plan_from_keys = pulled.solution.target_from_cams
    before, after = start @ recorded, follow_keyframes(plan_from_keys, keyframes)
    with clock.stage("check"):
        found = (
            checks.match_check(held_out, before, after),
            checks.wall_check(structure, floorplan, before, after),
            checks.tension_check(
                _total_cost(evidence, level_from_keys, options.adjust),
                _total_cost(evidence, plan_from_keys, options.adjust),
                len(scan),
            ),
        )
        agreed = (floorplan, pulled.association)
        costs = [
            evidence.costs(poses, options.adjust, agreed)
            for poses in (before[keyframes.frame_idx], plan_from_keys)
        ]
    judged = tuple(check for check in found if check)
    return RefineResult(
        floorplan=floorplan,
        plan_from_cams=after,
        initial_plan_from_cams=before,
        world_from_plan=_world_from_plan(start @ level, before, after),
        gravity=gravity,
        structure=structure,
        matches=matches,
        alignment=alignment,
        walls=pulled,
        cost_by_term={name: (costs[0][name], costs[1][name]) for name in costs[0]},
        checks=judged,
        doubts=(
            *scan_doubts(scan, gravity, structure, matches, options.matching.pairs.neighbours),
            *fit_doubts(alignment, claimed is not None, pulled, structure, judged),
        ),
        seconds_by_stage=clock.seconds,
    )


def align_scan(
    scan: Scan,
    floorplan: Floorplan,
    options: RefineOptions | None = None,
    work: Work | None = None,
) -> tuple[Alignment, WallSamples] | None:
    """The scan's place on the plan and the walls that it was found by; None where no wall was seen.

    The first half of `refine`: arguments and errors are the same.
    """
    options, work = options or RefineOptions(), work or Work()
    require_plain_numbers(options)
    if not scan.fingerprint:
        work = dataclasses.replace(work, cache_dir=None)
    prepared = prepare(scan, options, work, Clock(work))
    claimed = None
    if floorplan.is_metric:
        claimed = _claimed_place(scan, prepared.level_from_world)
    alignment = place(prepared, floorplan, options.align, claimed)
    if alignment is None:
        return None
    return alignment, wall_samples(prepared.evidence.structure, prepared.level_from_keys)


def prepare(scan: Scan, options: RefineOptions, work: Work, clock: "Clock") -> Prepared:
    """Everything that needs no plan: gravity, floor and walls, matches, closed loops."""
    with clock.stage("level"):
        gravity = find_gravity(scan, options.structure.gravity, work)
    with clock.stage("floor and walls"):
        structure = extract_structure(scan, gravity, options.structure, work)
    with clock.stage("matching"):
        odometry = make_odometry(scan.world_from_cams, options.odometry)
        matches = find_matches(scan, odometry, options.matching, work)

    rng = np.random.default_rng(options.seed)
    solving, held_out = checks.hold_out(matches, options.held_out_share, rng)
    keyframes = choose_keyframes(scan.world_from_cams, options.adjust.keyframes)
    evidence = reduce_evidence(Evidence(solving, structure, odometry), keyframes)
    level = level_from_world(gravity, structure.floor_height_m)
    recorded = level @ scan.world_from_cams
    with clock.stage("close loops"):
        level_from_keys = close_loops(
            evidence, recorded[keyframes.frame_idx], options.adjust
        ).target_from_cams
    return Prepared(
        gravity, structure, matches, held_out, keyframes, evidence, level, level_from_keys
    )


def _claimed_place(scan: Scan, level_from_world: np.ndarray) -> np.ndarray | None:
    """plan_from_level (4, 4) where the scan's format records poses in the plan's axes."""
    if scan.plan_from_world_axes is None:
        return None
    claimed = scan.plan_from_world_axes @ se3.inverse(level_from_world)
    claimed[2, 3] = 0.0  # the floor is at z = 0 in both frames
    return claimed


def wall_samples(structure: Structure, level_from_cams: np.ndarray) -> WallSamples:
    """What the alignment is given: pieces of wall, seen from above, and from where."""
    normals, ends = patches_in_plan(structure, level_from_cams)
    eyes = level_from_cams[structure.patch_frame_idx][:, :2, 3]
    return sample_walls(normals, ends, seen_from=eyes)


def scan_points(structure: Structure, level_from_cams: np.ndarray) -> np.ndarray:
    """All points (n, 3) m of floor and walls, level frame, for the paper's alignment."""
    parts = (
        (structure.floor_points_cam, structure.floor_frame_idx),
        (structure.wall_points_cam, structure.wall_frame_idx),
        (structure.loose_points_cam, structure.loose_frame_idx),
    )
    return np.concatenate(
        [
            np.einsum("nab,nb->na", level_from_cams[frame][:, :3, :3], points)
            + level_from_cams[frame][:, :3, 3]
            for points, frame in parts
        ]
    )


def place(
    prepared: Prepared,
    floorplan: Floorplan,
    options: AlignOptions,
    claimed: np.ndarray | None = None,
) -> Alignment | None:
    """The scan's place on the plan, by its walls; None where it shows none and the plan is in metres.

    Raises:
        FloorplanError: the plan fits in another unit than it claims, or its unit cannot be found.
    """
    walls = wall_samples(prepared.evidence.structure, prepared.level_from_keys)
    if len(walls.xy) == 0:
        if not floorplan.is_metric:
            raise FloorplanError(
                f"{floorplan.name}: expected a plan with a unit, as the scan shows no wall to find it "
                "by; give it with --unit or --scale"
            )
        return None
    if options.method == "paper":
        points = scan_points(prepared.evidence.structure, prepared.level_from_keys)
        return align_paper(points, walls, floorplan, options, np.random.default_rng(0))
    pins = place_pins(options.pins, prepared.level_from_world, floorplan)
    alignment = align(walls, floorplan, options, claimed, pins)
    found = find_unit(walls, floorplan, alignment, options)
    if found is not None:
        raise FloorplanError(
            f"{floorplan.name}: expected metres, found a plan of {floorplan.size[0]:.4g} x "
            f"{floorplan.size[1]:.4g} that fits the scan in {found[0]}; "
            f"multiply its coordinates by {found[1]:g}"
        )
    return alignment


def _total_cost(evidence: Evidence, poses: np.ndarray, options: AdjustOptions) -> float:
    """Robust cost of the terms that need no plan."""
    return sum(evidence.costs(poses, options).values())


def _world_from_plan(
    plan_from_world: np.ndarray, before: np.ndarray, after: np.ndarray
) -> np.ndarray:
    """Back to the recorded axes. The height is that of the first frame as recorded: later ones have
    drifted, and the plan says nothing of heights."""
    lift = np.array([0.0, 0.0, before[0, 2, 3] - after[0, 2, 3]])
    return se3.inverse(plan_from_world) @ se3.make_transform(np.eye(3), lift)


class Clock:
    """Times stages and reports that they began."""

    def __init__(self, work: Work) -> None:
        self.seconds: dict[str, float] = {}
        self._work = work

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time what is done inside."""
        self._work.report(name, 0, 0)
        begin = time.perf_counter()
        yield
        self.seconds[name] = time.perf_counter() - begin
        self._work.report(name, 1, 0)
