"""Every metric of a scan at two sets of poses, before and after, side by side."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from planfit.evaluation.agreement import wall_layers
from planfit.evaluation.map_quality import (
    MapOptions,
    MapSample,
    OrthogonalSets,
    find_orthogonal_sets,
    map_quality,
    mom_m2,
    sample_depth_maps,
)
from planfit.evaluation.surfaces import NEAR_FACE_M, floor_heights, wall_distances
from planfit.evaluation.trajectory import position_errors, relative_errors
from planfit.evaluation.truth_cloud import TrueCloud, nearest_neighbours
from planfit.floorplan import Floorplan
from planfit.runtime import Runtime, short_repr
from planfit.scan import Scan
from planfit.scan.statistics import MAX_FRAMES
from planfit.segmentation import Structure, WallPatches


@dataclass(frozen=True)
class Metric:
    """One number before and after; lower is better."""

    name: str
    """As in JSON: without the unit, which stands beside it."""
    meaning: str
    """In a few words; where it begins with spaces, it goes on from the metric before."""
    unit: str
    """cm^2, cm, m, deg, %, or 1 for a number without unit."""
    before: float
    after: float

    @property
    def difference(self) -> float:
        """After minus before: below 0 is better."""
        return self.after - self.before


@dataclass(frozen=True)
class Truth:
    """What is known to be true of a scan: poses of the frames that have any, a true scan, or both."""

    frame_idx: Int[np.ndarray, " k"]
    target_from_cams: Float[np.ndarray, "k 4 4"]
    frame: Literal["world", "plan"] = "world"
    """The target frame, of poses and cloud: the scan's own axes, or those of the plan."""
    cloud: TrueCloud | None = None

    __repr__ = short_repr


def trajectory_metrics(
    before: Float[np.ndarray, "n 4 4"],
    after: Float[np.ndarray, "n 4 4"],
    truth: Truth,
    delta_m: float,
) -> list[Metric]:
    """ATE and RPE of poses before and after, in the truth's frame; RPE over `delta_m` of path, too."""
    idx, true = truth.frame_idx, truth.target_from_cams
    first, last = (position_errors(poses[idx], true) for poses in (before, after))
    aligned_m = first.aligned_rms_m, last.aligned_rms_m
    turned_deg = first.rotation_mean_deg, last.rotation_mean_deg
    metrics = [
        Metric("ate_rms", "position error (ATE), RMS, not aligned", "m", first.rms_m, last.rms_m),
        Metric("ate_max", "   the largest", "m", first.max_m, last.max_m),
        Metric("ate_aligned_rms", "   rigidly aligned, RMS", "m", *aligned_m),
        Metric("rotation_mean", "orientation error, mean, not aligned", "deg", *turned_deg),
    ]
    for name, words, delta in (
        ("rpe_next", "to the next frame", None),
        ("rpe", f"over {delta_m:g} m of path", delta_m),
    ):
        a, b = (relative_errors(poses[idx], true, delta) for poses in (before, after))
        if a is None or b is None:
            continue
        words = f"relative error (RPE) {words}, RMS"
        turned_deg = a.rotation_rms_deg, b.rotation_rms_deg
        metrics += [
            Metric(f"{name}_translation_rms", words, "m", a.translation_rms_m, b.translation_rms_m),
            Metric(f"{name}_rotation_rms", "   its rotation, RMS", "deg", *turned_deg),
        ]
    return metrics


def surface_metrics(
    structure: Structure,
    floorplan: Floorplan | None,
    before: Float[np.ndarray, "n 4 4"],
    after: Float[np.ndarray, "n 4 4"],
    workers: int = 1,
) -> list[Metric]:
    """Distances of the walls to the plan and flatness of the floor, at poses in the plan frame.

    What was not seen, and distances where there is no plan, is left out.
    """
    both = (before, after)
    metrics: list[Metric] = []

    def add(name: str, meaning: str, unit: str, scale: float, of: Callable[[int], float]) -> None:
        metrics.append(Metric(name, meaning, unit, scale * of(0), scale * of(1)))

    if floorplan is not None:
        walls = [w for w in (wall_distances(structure, floorplan, p, workers) for p in both) if w]
        if len(walls) == 2:
            add("nsd", "wall points to the plan (NSD), mean", "cm", 100, lambda i: walls[i].nsd_m)
            words = "   to the face that looks at the camera"
            add("nsd_oriented", words, "cm", 100, lambda i: walls[i].oriented_nsd_m)
            words = f"   further than {NEAR_FACE_M:g} m from the plan"
            add("off_plan", words, "%", 100, lambda i: 1 - walls[i].near_share)
    floors = [f for f in (floor_heights(structure, poses) for poses in both) if f]
    if len(floors) == 2:
        words = "floor points about the fitted plane, RMS"
        add("floor_plane_rms", words, "cm", 100, lambda i: floors[i].plane_rms_m)
        words = "   about their mean height, RMS"
        add("floor_height_rms", words, "cm", 100, lambda i: floors[i].height_rms_m)
        words = "   about their median height, half of them"
        add("floor_height_median", words, "cm", 100, lambda i: floors[i].height_median_m)
    return metrics


def layer_metrics(
    walls: WallPatches,
    before: Float[np.ndarray, "n 4 4"],
    after: Float[np.ndarray, "n 4 4"],
) -> list[Metric]:
    """Share of doubled walls at poses with z up; none where too little wall was seen more than once."""
    first, last = (wall_layers(walls, poses) for poses in (before, after))
    if not (first.n_windows and last.n_windows):
        return []
    words = "walls seen as two layers"
    return [Metric("double_walls", words, "%", 100 * first.double_share, 100 * last.double_share)]


MOM_FRAMES = MAX_FRAMES
"""Maximum number of depth maps, evenly spread, that are searched for orthogonal planes."""

MAP_METRICS = {
    "mme": ("mean map entropy (MME)", "1"),
    "mpv": ("mean plane variance (MPV)", "cm^2"),
    "mom": ("mutually orthogonal metric (MOM)", "cm^2"),
    "nnd": ("distance to the true scan (NND), mean", "cm"),
}
"""Meaning and unit of the metrics of a map."""


def map_metrics(
    scan: Scan,
    before: Float[np.ndarray, "n 4 4"],
    after: Float[np.ndarray, "n 4 4"],
    options: MapOptions,
    runtime: Runtime,
    true_cloud: TrueCloud | None = None,
) -> list[Metric]:
    """MME, MPV, MOM, and NND where there is a true scan, at poses in the truth's frame.

    The same points are judged at both.

    Raises:
        ScanError: a depth image cannot be used.
    """
    judge = make_map_judge(scan, options, runtime, true_cloud)
    values = []
    for k, poses in enumerate((before, after)):
        runtime.report("map", k, 2)
        values.append(judge.values(poses, runtime.workers))
    runtime.report("map", 2, 2)
    metrics = [
        Metric(name, meaning, unit, values[0][name], values[1][name])
        for name, (meaning, unit) in MAP_METRICS.items()
    ]
    return [m for m in metrics if np.isfinite(m.before) and np.isfinite(m.after)]


@dataclass(frozen=True)
class MapJudge:
    """The points of a scan, by which the maps of any poses are judged alike."""

    sample: MapSample
    sets: tuple[OrthogonalSets, ...]
    radius_m: float
    true_cloud: TrueCloud | None

    def values(
        self, target_from_cams: Float[np.ndarray, "n 4 4"], workers: int = 1
    ) -> dict[str, float]:
        """The metrics of `MAP_METRICS` at poses in the truth's frame; NaN where there is none."""
        points = self.sample.at(target_from_cams)
        quality = map_quality(points, self.radius_m, workers)
        nnd_m = np.nan
        if self.true_cloud is not None:
            nnd_m = nearest_neighbours(points, self.true_cloud, workers=workers).nnd_m
        return {
            "mme": quality.mme,
            "mpv": 1e4 * quality.mpv_m2,
            "mom": 1e4 * mom_m2(self.sets, quality),
            "nnd": 100 * nnd_m,
        }


def make_map_judge(
    scan: Scan, options: MapOptions, runtime: Runtime, true_cloud: TrueCloud | None = None
) -> MapJudge:
    """Read the points that maps of a scan are judged by.

    Raises:
        ScanError: a depth image cannot be used.
    """
    sample = sample_depth_maps(scan, options, runtime)
    sets = find_orthogonal_sets(sample, options.radius_m, MOM_FRAMES)
    return MapJudge(sample, sets, options.radius_m, true_cloud)
