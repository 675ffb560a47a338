"""The scan before and after, placed once for all plots, and storey by storey where each has a plan of its
own; the numbers that matter, and the verdict in words. Its metrics are those of `planfit.evaluation`."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from planfit.evaluation import (
    NEAR_FACE_M,
    FloorHeights,
    WallDistances,
    floor_heights,
    wall_distances,
    wall_points,
)
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.pipeline.result import RefineResult
from planfit.pipeline.validation import Check
from planfit.pipeline.verdict import Verdict
from planfit.report import formatting
from planfit.scan.joined import FramesOfScan
from planfit.segmentation import Structure
from planfit.units import in_units

_MAX_DRAWN = 600_000
"""Points that plots take, evenly thinned, which bounds memory: more dots than a picture has pixels show
nothing new. Metrics are taken of all points."""


@dataclass(frozen=True)
class Measures:
    """The scan at one set of poses, in the plan frame."""

    trajectory: Float[np.ndarray, "n 3"]
    """Camera centres, m; of one storey, NaN for cameras elsewhere."""
    walls: WallDistances | None
    """Of all wall points; None where no wall was seen."""
    floor: FloorHeights | None
    """Of all floor points; None where no floor was seen."""
    wall_xy: Float[np.ndarray, "w 2"]
    """Wall points from above, m; without a plan, all points at camera height. Thinned for plots."""
    wall_distances_m: Float[np.ndarray, " d"]
    """Distance of these to the nearest face of the plan; none without a plan."""
    floor_points: Float[np.ndarray, "f 3"]
    """Floor points, m, heights above the floor of their storey; thinned for plots."""


@dataclass(frozen=True)
class BeforeAfter:
    """Measures before and after; points correspond one to one."""

    before: Measures
    after: Measures
    is_aligned: bool
    """Whether the scan was aligned with the plan by its walls; else distances to it mean nothing."""
    has_plan: bool
    """Whether there was one; else frames and points are in the level frame."""
    correction: Float[np.ndarray, "n 6"]
    """[rad, m] of each frame, from before to after: rotation and translation of the camera."""
    scans: tuple[FramesOfScan, ...] = ()
    """Which frames are whose, where several scans were refined together."""

    @property
    def has_walls(self) -> bool:
        """Whether there are wall points whose distances to the plan mean something."""
        return self.is_aligned and self.before.walls is not None

    @property
    def has_floor(self) -> bool:
        """Whether floor was seen."""
        return self.before.floor is not None


CloudXY = tuple[Float[np.ndarray, "m 2"], Float[np.ndarray, "m 2"]]
"""The same points of a scan, from above (m), at its poses before and after."""


def measure(
    floorplan: Floorplan | None,
    result: RefineResult,
    cloud: CloudXY | None = None,
    frames: Bool[np.ndarray, " n"] | None = None,
) -> BeforeAfter:
    """Place walls, floor and cameras of a result at its poses before and after.

    Args:
        floorplan: plan frame, m.
        result: of `planfit.refine` with that plan.
        cloud: what plots show without a plan, in place of wall points.
        frames: those of the storey that the plan is of, where there are several; all by default.
    """
    poses = (result.initial_plan_from_cams, result.plan_from_cams)
    structure = result.structure
    if frames is not None:
        structure = replace(structure.with_walls_of(frames), storeys=None)
    shown = cloud if floorplan is None and cloud is not None else (None, None)
    before, after = (
        _measure_at(floorplan, structure, p, xy, frames) for p, xy in zip(poses, shown, strict=True)
    )
    return BeforeAfter(
        before,
        after,
        is_aligned=result.alignment is not None,
        has_plan=floorplan is not None,
        correction=se3.difference(poses[1], poses[0]),
        scans=result.scans,
    )


def _measure_at(
    floorplan: Floorplan | None,
    structure: Structure,
    plan_from_cams: Float[np.ndarray, "n 4 4"],
    cloud_xy: Float[np.ndarray, "m 2"] | None,
    frames: Bool[np.ndarray, " n"] | None,
) -> Measures:
    walls = None
    if floorplan is not None:
        walls = wall_distances(structure, floorplan, plan_from_cams)
    floor = floor_heights(structure, plan_from_cams)
    floor_points = np.zeros((0, 3)) if floor is None else floor.points
    shown = wall_points(structure, plan_from_cams)[:, :2] if cloud_xy is None else cloud_xy
    centres = plan_from_cams[:, :3, 3]
    return Measures(
        trajectory=centres if frames is None else np.where(frames[:, None], centres, np.nan),
        walls=walls,
        floor=floor,
        wall_xy=_thinned(shown),
        wall_distances_m=np.zeros(0) if walls is None else _thinned(walls.nearest_m),
        floor_points=_thinned(floor_points),
    )


def _thinned(points: Float[np.ndarray, "m ..."]) -> Float[np.ndarray, "w ..."]:
    return points[:: max(1, len(points) // _MAX_DRAWN)]


@dataclass(frozen=True)
class StoreyMeasures:
    """A storey with its plan, and the part of the scan on it."""

    number: int
    floorplan: Floorplan
    """Its faces in the plan frame."""
    both: BeforeAfter
    """Of the walls that its frames see; cameras elsewhere have no place."""


def measure_storeys(result: RefineResult) -> tuple[StoreyMeasures, ...]:
    """Storeys with a plan, from the lowest; none where the whole scan is on one plan."""
    if result.storeys is None or result.floorplan is None:
        return ()
    found = []
    for k, own in result.storeys.with_plan.items():
        frames = result.storeys.of_frames == k
        plan = result.floorplan.of_storey(k)
        both = measure(plan, result, frames=frames)
        found.append(StoreyMeasures(own.number, plan, both))
    return tuple(found)


@dataclass(frozen=True)
class TruthErrors:
    """Errors of camera positions against true ones, root mean square, where the truth is known."""

    before_rms_m: float
    """Of the recorded poses, in the truth's frame."""
    after_rms_m: float
    """Of the refined poses, in the truth's frame."""
    before_aligned_rms_m: float
    """Of the recorded poses, after the rigid motion that fits best."""
    after_aligned_rms_m: float
    """Of the refined poses, after the rigid motion that fits best."""
    after_by_frame_m: Float[np.ndarray, " n"] | None = None
    """Of each refined pose, in the truth's frame."""


@dataclass(frozen=True)
class KeyMetric:
    """One number before and after."""

    name: str
    meaning: str
    """What it says, in plain words."""
    before: float
    after: float
    unit: str
    """m, or share."""
    is_worse: bool = False

    @property
    def is_improved(self) -> bool:
        """Better by more than a hundredth: of the number, or of all points where it is a share."""
        if self.unit == "share":
            return self.after > self.before + 0.01
        return self.after < 0.99 * self.before


_CHECKS = {
    "m": (
        "Places seen twice",
        "median distance between two sightings of one point, visit by visit, each by a solve that did "
        "without that visit",
    ),
    "share": (
        "Wall points on the plan",
        "share of scanned wall points within {near} of a drawn wall",
    ),
}


def key_metrics(
    result: RefineResult, both: BeforeAfter, truth: TruthErrors | None
) -> list[KeyMetric]:
    """All that could be measured, the checks first."""
    metrics = [
        KeyMetric(*_words(check), check.before, check.after, check.unit, check.is_worse)
        for check in result.checks
    ]

    def add(name: str, meaning: str, first: float, last: float) -> None:
        metrics.append(KeyMetric(name, meaning, first, last, "m", last > 1.02 * first + 1e-4))

    before, after = both.before, both.after
    if both.is_aligned and before.walls is not None and after.walls is not None:
        meaning = "mean distance of scanned wall points to the nearest drawn wall"
        add("Distance to the plan (NSD)", meaning, before.walls.nsd_m, after.walls.nsd_m)
    if before.floor is not None and after.floor is not None:
        first, last = before.floor, after.floor
        meaning = "lie within this of their median height"
        add("Floor, half of the points", meaning, first.height_median_m, last.height_median_m)
        meaning = "RMS height about their mean; counts things that lie on the floor too"
        add("Floor, all points", meaning, first.height_rms_m, last.height_rms_m)
    if truth:
        meaning = "RMS distance of camera positions to the true ones"
        add("Position error", meaning, truth.before_rms_m, truth.after_rms_m)
        meaning = "the same after the best rigid fit to the true positions"
        aligned_m = truth.before_aligned_rms_m, truth.after_aligned_rms_m
        add("Position error, shape only", meaning, *aligned_m)
    return metrics


def told_first(verdict: Verdict) -> str:
    """The outcome and its main reason, as a sentence."""
    return f"{verdict.headline[0].upper()}{verdict.headline[1:]}."


def reasons_in_words(verdict: Verdict, truth: TruthErrors | None = None) -> str:
    """What else speaks for the outcome, in plain words; the metrics say what became better or worse."""
    words = " ".join(f"{each[0].upper()}{each[1:]}." for each in verdict.further_reasons)
    if truth:
        before, after = (formatting.length(v) for v in (truth.before_rms_m, truth.after_rms_m))
        words += f" Against the true positions, the error went from {before} to {after} RMS."
    return words.strip()


def _words(check: Check) -> tuple[str, str]:
    name, meaning = _CHECKS.get(check.unit, (check.name, ""))
    return name, meaning.format(near=in_units(NEAR_FACE_M))
