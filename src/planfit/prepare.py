"""The first half of the method, which needs no plan: gravity, floor and walls, matches, closed loops."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from planfit import checks
from planfit.adjust import Evidence, Keyframes, choose_keyframes, close_loops, reduce_evidence
from planfit.matching import Matches, find_matches
from planfit.options import RefineOptions
from planfit.scan import Scan
from planfit.scan.odometry import make_odometry
from planfit.structure import (
    Gravity,
    Structure,
    extract_structure,
    find_gravity,
    level_from_world,
)
from planfit.work import Work


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


@dataclass(frozen=True)
class Seen:
    """What the images of a scan show, before anything is solved."""

    gravity: Gravity
    structure: Structure
    matches: Matches


@dataclass(frozen=True)
class Prepared:
    """What a scan says before a plan is looked at: levelled, matched, loops closed."""

    held_out: Matches
    """Matches kept out of the solve."""
    keyframes: Keyframes
    evidence: Evidence
    """Of the keyframes."""
    level_from_world: np.ndarray  # (4, 4)
    level_from_keys: np.ndarray  # (k, 4, 4) keyframes, loops closed


def look_through(scan: Scan, options: RefineOptions, work: Work, clock: Clock) -> Seen:
    """Everything that takes the images: gravity, floor and walls, matches."""
    with clock.stage("level"):
        gravity = find_gravity(scan, options.structure.gravity, work)
    with clock.stage("floor and walls"):
        structure = extract_structure(scan, gravity, options.structure, work)
    with clock.stage("matching"):
        odometry = make_odometry(scan.world_from_cams, options.odometry)
        matches = find_matches(scan, odometry, options.matching, work)
    return Seen(gravity, structure, matches)


def prepare(scan: Scan, seen: Seen, options: RefineOptions, clock: Clock) -> Prepared:
    """The rest of what needs no plan: matches held out, keyframes, closed loops."""
    gravity, structure, matches = seen.gravity, seen.structure, seen.matches
    odometry = make_odometry(scan.world_from_cams, options.odometry)
    rng = np.random.default_rng(options.seed)
    solving, held_out = checks.hold_out(matches, options.held_out_share, rng)
    keyframes = choose_keyframes(scan.world_from_cams, options.adjust.keyframes, matches.sharpness)
    evidence = reduce_evidence(Evidence(solving, structure, odometry, scan.cameras), keyframes)
    level = level_from_world(gravity, structure.floor_height_m)
    recorded = level @ scan.world_from_cams
    level_from_keys = recorded[keyframes.frame_idx]
    if options.adjust.loops_first:
        with clock.stage("close loops"):
            closed = close_loops(evidence, level_from_keys, options.adjust)
            level_from_keys = closed.target_from_cams
    return Prepared(held_out, keyframes, evidence, level, level_from_keys)
