"""Scans of buildings whose plan is wrong, and what is true of every wall of the plan.

A building is made up and scanned; its plan is then spoilt. Of its walls, a share is changed in equal parts:
drawn 5 to 50 cm off across, not drawn, and as many partitions drawn that were never built. What of a wall the
cameras saw is told from depth at the true poses, not by planfit.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from faults.inputs import Inputs
from faults.plans import MIN_WALL_M, walls_of
from faults.scans import keep_images
from jaxtyping import Bool, Float, Int

from planfit.floorplan import Floorplan
from planfit.geometry import se3, segments
from planfit.scan import Scan
from planfit.synth import (
    Building,
    BuildingOptions,
    CameraOptions,
    StructuredLightNoise,
    SyntheticScan,
    SynthOptions,
    TimeOfFlightNoise,
    WalkOptions,
    make_scan,
)

CHANGED_SHARE = 0.3
OFF_M = (0.05, 0.5)
STRIDE_PX = 6
"""Every sixth pixel each way tells what was seen."""
BIN_M = 0.1
NEAR_M, BEYOND_M, HEIGHTS_M = 0.06, 0.2, (0.3, 2.0)
"""A pixel shows a face that it lies within this of; it looks through a place when it ends so far behind; at
these heights over the floor, which doors and lintels are not."""
MIN_FRAMES, MIN_SEEN_M, MIN_THROUGH_SHARE = 3, 0.6, 0.5
"""A wall counts as seen when so many frames show, together, so much of its length; the place of one that was
never built, when they look through this share of it."""


@dataclass(frozen=True)
class Case:
    """A scan, a wrong plan, and the truth about both."""

    scan: Scan
    plan: Floorplan
    """As given."""
    built: Floorplan
    """As it stands."""
    is_built: Bool[np.ndarray, " f"]
    """Of the faces of `plan`."""
    as_built_m: Float[np.ndarray, "f 2"]
    """From where each face of `plan` is drawn to where it stands; 0 of those as drawn."""
    undrawn: Int[np.ndarray, " u"]
    """Faces of `built` that `plan` has not."""
    true_plan_from_cams: Float[np.ndarray, "n 4 4"]

    @property
    def true_offsets_m(self) -> Float[np.ndarray, " f"]:
        """Along the normal of each face of `plan`; NaN of those that were never built."""
        off = np.einsum("fi,fi->f", self.as_built_m, self.plan.normals)
        return np.where(self.is_built, off, np.nan)


def make_case(seed: int, folder: Path, drawn_sigma_m: float = 0.0) -> Case:
    """A building of four furnished rooms, walked through once, by one of two sensors; images are kept in
    `folder`. Every wall of the plan is drawn off by `drawn_sigma_m` across, as drawings are, one sigma."""
    made = made_scan(seed)
    # The labels of pixels are not given: what is wall is found as in a scan of anyone's.
    scan = replace(keep_images(made.scan, folder / "images"), has_labels=False)
    rng = np.random.default_rng([seed, 17])
    return spoilt(scan, made.floorplan, made.true_plan_from_cams, rng, drawn_sigma_m)


def made_scan(seed: int, n_rooms: int = 4, n_frames: int = 100) -> SyntheticScan[Building]:
    """The building and its walk, images as if by one of two sensors."""
    return make_scan(
        SynthOptions(
            seed=seed,
            building=BuildingOptions(n_rooms=n_rooms),
            walk=WalkOptions(n_frames=n_frames),
            camera=CameraOptions(320, 240),
            depth_noise=StructuredLightNoise() if seed % 4 < 2 else TimeOfFlightNoise(),
        )
    )


def spoilt(
    scan: Scan,
    built: Floorplan,
    true_plan_from_cams: Float[np.ndarray, "n 4 4"],
    rng: np.random.Generator,
    drawn_sigma_m: float = 0.0,
) -> Case:
    """The case with a plan that is wrong in a share of its walls, and inexact in all of them."""
    wall_of = walls_of(built)
    longest = np.array([built.lengths[wall_of == w].max() for w in range(wall_of.max() + 1)])
    walls = rng.permutation(np.flatnonzero(longest > MIN_WALL_M))
    n_each = max(1, round(CHANGED_SHARE * len(walls) / 3))
    moved, gone = walls[:n_each], walls[n_each : 2 * n_each]
    ends, by = built.ends.copy(), np.zeros((len(built), 2))
    for wall in moved:
        faces = np.flatnonzero(wall_of == wall)
        across = built.normals[faces[np.argmax(built.lengths[faces])]]
        by[faces] = rng.choice([-1.0, 1.0]) * rng.uniform(*OFF_M) * across
    drawn = ~np.isin(wall_of, gone)
    more = _partitions(built, n_each, rng)
    for wall in range(wall_of.max() + 1):
        faces = np.flatnonzero(wall_of == wall)
        across = built.normals[faces[np.argmax(built.lengths[faces])]]
        by[faces] += drawn_sigma_m * rng.normal() * across
    ends -= by[:, None]
    plan = Inputs(scan, built, true_plan_from_cams, np.eye(4)).with_faces(
        np.concatenate([ends[drawn], more]),
        np.concatenate([built.normals[drawn], segments.left_normals(more)]),
        np.concatenate([built.is_oriented[drawn], np.ones(len(more), dtype=bool)]),
    )
    return Case(
        scan,
        plan.floorplan,
        built,
        np.arange(len(plan.floorplan)) < drawn.sum(),
        np.concatenate([by[drawn], np.zeros((len(more), 2))]),
        np.flatnonzero(~drawn),
        true_plan_from_cams,
    )


def _partitions(
    built: Floorplan, count: int, rng: np.random.Generator
) -> Float[np.ndarray, "f 2 2"]:
    """Both faces of partitions that were never built, square to walls, within the building; the free side is
    on their left."""
    along = segments.directions(built.ends)
    share, reach_m = rng.uniform(0.25, 0.75, len(built)), rng.uniform(1.0, 2.5, len(built))
    feet = built.ends[:, 0] + (share * built.lengths)[:, None] * along
    tips = feet + reach_m[:, None] * built.normals
    low, high = built.ends.min(axis=(0, 1)), built.ends.max(axis=(0, 1))
    possible = (built.lengths > 1.5) & np.all((tips > low) & (tips < high), axis=1)
    found = []
    for i in rng.permutation(np.flatnonzero(possible))[:count]:
        normal, foot, tip, across = built.normals[i], feet[i], tips[i], 0.06 * along[i]
        sides = [[tip + across, foot + across], [foot - across, tip - across]]
        is_turned = normal[0] * along[i, 1] - normal[1] * along[i, 0] < 0
        found += [side if is_turned else side[::-1] for side in sides]
    return np.array(found).reshape(-1, 2, 2)


@dataclass(frozen=True)
class Views:
    """What the cameras saw, at the true poses: every line of sight from its camera to where it ended."""

    eyes: Float[np.ndarray, "r 3"]
    points: Float[np.ndarray, "r 3"]
    frame: Int[np.ndarray, " r"]


def true_views(scan: Scan, true_plan_from_cams: Float[np.ndarray, "n 4 4"]) -> Views:
    eyes, points, frames = [], [], []
    for i in range(len(scan)):
        depth, camera = scan.files.depth(i), scan.cameras[i]
        v, u = (
            grid.ravel()
            for grid in np.mgrid[: camera.height : STRIDE_PX, : camera.width : STRIDE_PX]
        )
        usable = np.isfinite(depth[v, u]) & (depth[v, u] < 5.0)
        uv = np.stack([u[usable], v[usable]], axis=1).astype(float)
        seen = camera.lift(uv, depth[v, u][usable].astype(float))
        points.append(se3.transform(true_plan_from_cams[i], seen))
        eyes.append(np.broadcast_to(true_plan_from_cams[i, :3, 3], seen.shape))
        frames.append(np.full(len(seen), i))
    return Views(np.concatenate(eyes), np.concatenate(points), np.concatenate(frames))


def seen_m(views: Views, ends: Float[np.ndarray, "2 2"], normal: Float[np.ndarray, " 2"]) -> float:
    """Length of a face that stands at `ends` that cameras saw from its free side, m."""
    off = (views.points[:, :2] - ends[0]) @ normal
    low, high = HEIGHTS_M
    shows = (np.abs(off) < NEAR_M) & (views.points[:, 2] > low) & (views.points[:, 2] < high)
    shows &= (views.eyes[:, :2] - ends[0]) @ normal > 0
    return _covered_m(ends, views.points[shows, :2], views.frame[shows])


def through_m(
    views: Views, ends: Float[np.ndarray, "2 2"], normal: Float[np.ndarray, " 2"]
) -> float:
    """Length of a face drawn at `ends` that cameras looked through, m."""
    at_eye = (views.eyes[:, :2] - ends[0]) @ normal
    at_end = (views.points[:, :2] - ends[0]) @ normal
    crosses = (np.sign(at_eye) != np.sign(at_end)) & (np.abs(at_end) > BEYOND_M)
    share = (at_eye / np.where(at_eye == at_end, 1.0, at_eye - at_end))[:, None]
    at = views.eyes + share * (views.points - views.eyes)
    low, high = HEIGHTS_M
    crosses &= (at[:, 2] > low) & (at[:, 2] < high)
    return _covered_m(ends, at[crosses, :2], views.frame[crosses])


def _covered_m(
    ends: Float[np.ndarray, "2 2"], xy: Float[np.ndarray, "k 2"], frame: Int[np.ndarray, " k"]
) -> float:
    """Length of a segment in bins that points fall on, those of enough frames."""
    length = float(np.linalg.norm(ends[1] - ends[0]))
    at = (xy - ends[0]) @ (ends[1] - ends[0]) / length
    inside = (at > 0) & (at < length)
    bins = (at[inside] / BIN_M).astype(int)
    pairs = np.unique(np.stack([bins, frame[inside]], axis=1), axis=0)
    per_bin = np.bincount(pairs[:, 0], minlength=1) if len(pairs) else np.zeros(1)
    return BIN_M * float(np.sum(per_bin >= MIN_FRAMES))
