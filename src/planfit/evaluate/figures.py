"""All figures of one scan at two sets of poses, side by side."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from planfit.evaluate.layers import LayerOptions, wall_layers
from planfit.evaluate.map_quality import map_quality
from planfit.evaluate.orthogonal import OrthogonalSets, find_orthogonal_sets, mom_m2
from planfit.evaluate.plan_distance import floor_flatness, wall_distances
from planfit.evaluate.sampling import MapOptions, MapSample, sample_depth_maps
from planfit.evaluate.trajectory import position_errors, step_errors
from planfit.evaluate.truth_cloud import TrueCloud, nearest_neighbours
from planfit.floorplan import Floorplan
from planfit.runtime import Runtime
from planfit.scan import Scan
from planfit.segmentation import Structure


@dataclass(frozen=True)
class Figure:
    """One number before and after; lower is better."""

    name: str
    """As in JSON: without the unit, which stands beside it."""
    meaning: str
    """In a few words; where it begins with spaces, it goes on from the figure before."""
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
    """What is known to be true; poses of the frames that have any, in the frame of the poses compared."""

    frame_idx: np.ndarray  # (k,)
    target_from_cams: np.ndarray  # (k, 4, 4)


@dataclass(frozen=True)
class EvaluateOptions:
    """How figures are taken."""

    map: MapOptions = field(default_factory=MapOptions)
    """The points that MME, MPV, MOM and NND are taken of."""
    layers: LayerOptions = field(default_factory=LayerOptions)
    """When a wall counts as seen twice."""


def trajectory_figures(
    before: np.ndarray, after: np.ndarray, truth: Truth, delta_m: float
) -> list[Figure]:
    """ATE and RPE of poses (n, 4, 4) before and after, in the truth's frame."""
    idx, true = truth.frame_idx, truth.target_from_cams
    first, last = (position_errors(poses[idx], true) for poses in (before, after))
    figures = [
        Figure("ate_rms", "position error (ATE), RMS, not aligned", "m", first.rms_m, last.rms_m),
        Figure("ate_max", "   the largest", "m", first.max_m, last.max_m),
        Figure(
            "ate_aligned_rms",
            "   rigidly aligned, RMS",
            "m",
            first.aligned_rms_m,
            last.aligned_rms_m,
        ),
        Figure(
            "turn_mean",
            "orientation error, mean, not aligned",
            "deg",
            first.turn_mean_deg,
            last.turn_mean_deg,
        ),
    ]
    for name, words, delta in (
        ("rpe_next", "to the next frame", None),
        ("rpe", f"over {delta_m:g} m of path", delta_m),
    ):
        a, b = (step_errors(poses[idx], true, delta) for poses in (before, after))
        if a is None or b is None:
            continue
        words = f"relative error (RPE) {words}, RMS"
        figures += [
            Figure(f"{name}_shift_rms", words, "m", a.shift_rms_m, b.shift_rms_m),
            Figure(f"{name}_turn_rms", "   its turn, RMS", "deg", a.turn_rms_deg, b.turn_rms_deg),
        ]
    return figures


def surface_figures(
    structure: Structure,
    floorplan: Floorplan | None,
    before: np.ndarray,
    after: np.ndarray,
    options: LayerOptions | None = None,
    workers: int = 1,
) -> list[Figure]:
    """NSD, flatness of the floor and doubled walls at poses (n, 4, 4) in the plan frame.

    What was not seen, and NSD where there is no plan, is left out.
    """
    both = (before, after)
    figures: list[Figure] = []

    def add(name: str, meaning: str, unit: str, scale: float, of: Callable[[int], float]) -> None:
        figures.append(Figure(name, meaning, unit, scale * of(0), scale * of(1)))

    if floorplan is not None:
        walls = [wall_distances(structure, floorplan, poses, workers) for poses in both]
        found = [w for w in walls if w]
        if len(found) == 2:
            add("nsd", "wall points to the plan (NSD), mean", "cm", 100, lambda i: found[i].nsd_m)
            words = "   to the face that looks at the camera"
            add("nsd_oriented", words, "cm", 100, lambda i: found[i].oriented_nsd_m)
    floors = [f for f in (floor_flatness(structure, poses) for poses in both) if f]
    if len(floors) == 2:
        words = "floor points about the fitted plane, RMS"
        add("floor_plane_rms", words, "cm", 100, lambda i: floors[i].plane_rms_m)
        words = "   about their mean height, RMS"
        add("floor_height_rms", words, "cm", 100, lambda i: floors[i].height_rms_m)
    layers = [wall_layers(structure.walls, poses, options) for poses in both]
    if all(found.n_windows for found in layers):
        words = "walls seen as two layers"
        add("double_walls", words, "%", 100, lambda i: layers[i].double_share)
    return figures


def map_figures(
    scan: Scan,
    before: np.ndarray,
    after: np.ndarray,
    options: MapOptions,
    runtime: Runtime,
    truth: TrueCloud | None = None,
) -> list[Figure]:
    """MME, MPV, MOM, and NND where there is a true scan, at poses (n, 4, 4) in the truth's frame.

    The same points are judged at both.

    Raises:
        ScanError: a depth image cannot be used.
    """
    judge = make_map_judge(scan, options, runtime, truth)
    values = []
    for k, poses in enumerate((before, after)):
        runtime.report("map", k, 2)
        values.append(judge.values(poses, runtime.workers))
    runtime.report("map", 2, 2)
    figures = [
        Figure(name, meaning, unit, values[0][name], values[1][name])
        for name, (meaning, unit) in MAP_FIGURES.items()
    ]
    return [f for f in figures if np.isfinite(f.before) and np.isfinite(f.after)]


MAP_FIGURES = {
    "mme": ("mean map entropy (MME)", "1"),
    "mpv": ("mean plane variance (MPV)", "cm^2"),
    "mom": ("mutually orthogonal metric (MOM)", "cm^2"),
    "nnd": ("distance to the true scan (NND), mean", "cm"),
}
"""Meaning and unit of the figures of a map."""


@dataclass(frozen=True)
class MapJudge:
    """The points of a scan, by which the maps of any poses are judged alike."""

    sample: MapSample
    sets: tuple[OrthogonalSets, ...]
    radius_m: float
    truth: TrueCloud | None

    def values(self, target_from_cams: np.ndarray, workers: int = 1) -> dict[str, float]:
        """Figures of `MAP_FIGURES` at poses (n, 4, 4), in the truth's frame; NaN where there is none."""
        points = self.sample.placed(target_from_cams)
        quality = map_quality(points, self.radius_m, workers)
        nnd_m = np.nan
        if self.truth is not None:
            nnd_m = nearest_neighbours(points, self.truth, workers=workers).nnd_m
        return {
            "mme": quality.mme,
            "mpv": 1e4 * quality.mpv_m2,
            "mom": 1e4 * mom_m2(self.sets, quality),
            "nnd": 100 * nnd_m,
        }


def make_map_judge(
    scan: Scan, options: MapOptions, runtime: Runtime, truth: TrueCloud | None = None
) -> MapJudge:
    """Read the points that maps of a scan are judged by.

    Raises:
        ScanError: a depth image cannot be used.
    """
    sample = sample_depth_maps(scan, options, runtime)
    sets = find_orthogonal_sets(sample, options.radius_m, options.mom_frames)
    return MapJudge(sample, sets, options.radius_m, truth)
