"""How far recorded poses can be believed: the answer, and what was found broken."""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.findings import Finding, PoseKind, sentences_of
from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.runtime import short_repr
from planfit.scan.odometry import USUAL_SHARE, Odometry, usual_step
from planfit.tracking.clock import ClockOffset
from planfit.tracking.conventions import ConventionFit
from planfit.tracking.motions import MeasuredMotions
from planfit.tracking.numbered import in_metres, mount_numbers, unit_of


@dataclass(frozen=True)
class TrackingBreak:
    """A place where the recorded motion is not believed."""

    kind: Literal["jump", "outlier", "frozen", "lost"]
    """The tracker went astray and stayed there; some frames stand elsewhere; the pose stood still; frames
    have no pose, or the identity."""
    first_frame: int
    """The frame before a jump; the first frame of the others."""
    last_frame: int
    """The frame after a jump; the last one of the others."""
    recorded: tuple[float, float]
    """Motion as recorded, m and degrees: over a jump, else of the frames' displacement."""
    corrected: tuple[float, float]
    """Over a jump the motion that takes its place, m and degrees; else how far the frames were moved."""
    n_motions: int
    """Measured motions that say so; 0 where only continuity or the plan does."""
    finding: Finding
    """The same for the user."""


@dataclass(frozen=True)
class Tracking:
    """What is believed of the recorded poses."""

    recorded_world_from_cams: Poses
    """As recorded, in our convention."""
    world_from_cams: Poses
    """The same read at the images' times, with breaks corrected."""
    odometry: Odometry
    """Steps of these, with sigmas that fit this tracker; wide where a step is not known."""
    convention: str = "recorded"
    """The convention that recorded poses were taken to follow."""
    convention_fit: ConventionFit | None = None
    """What measured motions say of it; None where they were not asked."""
    clock: ClockOffset | None = None
    """How much later than their poses images were taken; None where no such time is significant."""
    sigma_factors: tuple[float, float] = (1.0, 1.0)
    """On the sigmas of rotation and translation of all steps."""
    breaks: tuple[TrackingBreak, ...] = ()
    """In the order of frames."""
    n_motions: int = 0
    """Motions between neighbouring frames that were measured."""
    doubtful_steps: Int[np.ndarray, " d"] = field(default_factory=lambda: np.zeros(0, dtype=int))
    """Steps (frame i to i + 1) that no motion confirms and that are as long as a jump; revisits decide."""
    open_steps: Int[np.ndarray, " o"] = field(default_factory=lambda: np.zeros(0, dtype=int))
    """Steps about lost frames, and undecided ones beyond which walls are nowhere on the plan: nothing tells
    them, and what is beyond may be anywhere. Revisits place it, and what they place is taken off the list."""
    undecided_steps: Int[np.ndarray, " u"] = field(default_factory=lambda: np.zeros(0, dtype=int))
    """Steps that were doubtful and that revisits did not decide: what tears the walk elsewhere may be a jump
    at one of these (`pipeline/jumps.py`)."""
    contradicted_steps: Int[np.ndarray, " c"] = field(
        default_factory=lambda: np.zeros(0, dtype=int)
    )
    """Those among which revisits say that the walk jumps, and not at which. As recorded, but not to be
    trusted where revisits are sought."""

    n_repeated: int = 0
    """Frames that repeat the pose before while the images move, where these are most frames; fewer are lost
    frames among `breaks`."""
    n_held: int = 0
    """Frames that repeated the pose before because poses came at a lower rate than images; they were read
    between these."""
    linked: tuple[tuple[int, int], ...] = ()
    """Frames before and after lost ones between which the tracker knew its motion."""

    __repr__ = short_repr

    @property
    def metres_per_unit(self) -> float:
        """Of the recorded poses, where they have a unit of their own; else 1."""
        return unit_of(self.convention)

    @property
    def is_mount_doubtful(self) -> bool:
        """Whether poses that may be those of the camera are taken for those of a body."""
        return self.convention_fit is not None and self.convention_fit.is_doubtful_mount

    @property
    def is_confirmed(self) -> bool:
        """Whether measured motions explain the recorded ones, and these are in metres."""
        fit = self.convention_fit
        is_told = fit is not None and fit.is_told and not fit.is_unexplained
        return is_told and self.metres_per_unit == 1.0

    @property
    def unplaced(self) -> tuple[tuple[int, int], ...]:
        """First and last frame of each run of frames whose place against most of the walk nothing tells."""
        submap = submaps_of(len(self.world_from_cams), self.open_steps, self.linked)
        is_elsewhere = submap != np.argmax(np.bincount(submap))
        edges = np.flatnonzero(np.diff(np.concatenate([[0], is_elsewhere.astype(int), [0]])))
        return tuple((int(a), int(b) - 1) for a, b in edges.reshape(-1, 2))

    @property
    def leaps(self) -> tuple[tuple[int, int], ...]:
        """Frames before and after the jumps by whose correction the walk leaps, as none can."""
        jumps = np.array([b.first_frame for b in self.breaks if b.kind == "jump"], dtype=int)
        if len(jumps) == 0:  # a single frame has no steps that are usual
            return ()
        recorded, now = (
            se3.inverse(poses[jumps]) @ poses[jumps + 1]
            for poses in (self.recorded_world_from_cams, self.world_from_cams)
        )
        is_leap = leaps(now, recorded, usual_step(self.odometry.cam_from_next)[0])
        return tuple((int(k), int(k) + 1) for k in jumps[is_leap])

    @property
    def doubt(self) -> Finding | None:
        """Why the recorded poses as a whole say nothing of these images; None where they do."""
        fit, n = self.convention_fit, len(self.world_from_cams)
        if self.n_repeated:
            facts = {"repeated_count": self.n_repeated, "frame_count": n}
            return Finding(PoseKind.POSES_REPEAT, facts)
        if fit is not None and fit.is_unexplained:
            facts = {"explained_share": fit.share, "motion_count": fit.n_motions}
            return Finding(PoseKind.MOTIONS_UNEXPLAINED, facts)
        return None

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What a user should know of the recorded poses."""
        found = []
        fit, factor = self.convention_fit, max(self.sigma_factors)
        if fit is not None and fit.is_own_unit and fit.is_clear:
            facts = {"metres_per_unit": self.metres_per_unit}
            found.append(Finding(PoseKind.POSES_IN_OWN_UNIT, facts))
        elif fit is not None and fit.is_mount and fit.is_clear:
            turn_deg, arm_m = mount_numbers(fit.name)
            facts = {"turn_deg": turn_deg, "arm_m": arm_m, "explained_share": fit.share}
            facts |= {"recorded_share": fit.asked_share, "motion_count": fit.n_motions}
            found.append(Finding(PoseKind.MOUNT_FOUND, facts))
        elif self.convention != "recorded":
            found.append(Finding(PoseKind.CONVENTION_TAKEN, {"convention": self.convention}))
        if self.n_held:
            n = len(self.world_from_cams)
            facts = {"held_count": self.n_held, "frame_count": n}
            found.append(Finding(PoseKind.POSES_HELD, facts))
        if self.clock is not None:
            found.append(self.clock.finding)
        if self.doubt is not None:
            found.append(self.doubt)
        if factor > NOTED_FACTOR:
            found.append(Finding(PoseKind.TRACKER_NOISY, {"sigma_factor": factor}))
        return (*found, *(b.finding for b in self.breaks))

    @property
    def warnings(self) -> tuple[str, ...]:
        """The same in words."""
        return sentences_of(self.findings)


LEAP, LEAP_M = 4.0, 2.0
"""A step of so many usual ones, and so many metres, is none of a walk, nor of a phone that finds its place
again."""
LEAP_CHANGED = 0.5
"""Where a recording paused it may be right, and is recorded: what departs from the recorded step by more than
this share of it is none of a pause."""
MIN_WITNESSES = 3
"""Observations that must agree where any may be false: of two, one false one leaves a tie. Patches of a wall
that was moved, revisits that place a part of the walk, frames that stand on a floor."""
NOTED_FACTOR = 2.0
"""A tracker that errs by more than this factor is worth a note, and its poses are fused with those."""


def leaps(
    told: Float[np.ndarray, "s 4 4"], recorded: Float[np.ndarray, "s 4 4"], usual_m: float
) -> Bool[np.ndarray, " s"]:
    """Which steps are longer than any of a walk, and not so because a recording paused.

    Args:
        told: motions over steps, by what is not the tracker.
        usual_m: what usual steps do not exceed.
    """
    length_m, recorded_m = (np.linalg.norm(s[:, :3, 3], axis=1) for s in (told, recorded))
    change_m = np.linalg.norm(told[:, :3, 3] - recorded[:, :3, 3], axis=1)
    return (length_m > _longest_m(usual_m)) & (change_m > LEAP_CHANGED * recorded_m)


def reach_m(recorded: Float[np.ndarray, "s 4 4"], usual_m: float) -> Float[np.ndarray, " s"]:
    """How far each step may lead and be no leap."""
    recorded_m = np.linalg.norm(recorded[:, :3, 3], axis=1)
    return np.maximum(_longest_m(usual_m), (1.0 + LEAP_CHANGED) * recorded_m)


def _longest_m(usual_m: float) -> float:
    """Of the steps of a walk, where usual ones do not exceed this."""
    return max(LEAP * usual_m, LEAP_M)


def without_leaps(motions: MeasuredMotions, recorded: Poses) -> MeasuredMotions:
    """Motions that a walk can make: none is longer than any over as many frames, but as the recorded one is.

    A camera that turns before a mirror sees rooms behind it that fit each other, 5.8 m from one frame to the
    next. Where a recording paused the recorded motion is as long; its unit may be another.
    """
    i, j = motions.pairs.T
    span = np.maximum(j - i, 1)
    told, known = (
        np.linalg.norm(m[:, :3, 3], axis=1)
        for m in (motions.a_from_b, se3.inverse(recorded[i]) @ recorded[j])
    )
    if len(told) == 0:
        return motions
    usual_m, usual = (max(float(np.quantile(m / span, USUAL_SHARE)), 1e-9) for m in (told, known))
    is_leap = (told > np.maximum(LEAP * usual_m * span, LEAP_M)) & (known <= LEAP * usual * span)
    return motions[~is_leap]


def submaps_of(
    n: int, cuts: Int[np.ndarray, " d"], linked: tuple[tuple[int, int], ...]
) -> Int[np.ndarray, " n"]:
    """Submap of each of n frames: the walk is cut at steps, and joined where frames are linked anyway."""
    submap = np.searchsorted(np.unique(cuts), np.arange(n))
    for before, after in linked:
        submap[submap == submap[after]] = submap[before]
    return submap


def describe_jump(
    recorded: Poses, corrected: Poses, frame: int, n_motions: int, witness: str
) -> TrackingBreak:
    """A jump after a frame, which the `witness` (images, revisits) contradicts."""
    was, now = (size_of(se3.inverse(p[frame]) @ p[frame + 1]) for p in (recorded, corrected))
    facts = {"recorded_m": was[0], "recorded_deg": was[1], "witness": witness}
    facts |= {"corrected_m": now[0], "corrected_deg": now[1]}
    finding = Finding(PoseKind.JUMP_CORRECTED, facts, ((frame, frame + 1),))
    return TrackingBreak("jump", frame, frame + 1, was, now, n_motions, finding)


def with_longer_steps(tracking: Tracking, factor: float) -> Tracking:
    """The same, its motion longer by a factor; poses as recorded stay as they are."""
    steps = tracking.odometry.cam_from_next
    return replace(
        tracking,
        world_from_cams=in_metres(tracking.world_from_cams, factor),
        odometry=replace(tracking.odometry, cam_from_next=in_metres(steps, factor)),
    )


def size_of(motion: Float[np.ndarray, "4 4"]) -> tuple[float, float]:
    """Length (m) and angle (degrees) of a motion."""
    angle = float(np.rad2deg(se3.rotation_angle(motion[:3, :3])))
    return float(np.linalg.norm(motion[:3, 3])), angle
