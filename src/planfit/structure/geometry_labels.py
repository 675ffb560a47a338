"""Floor and wall pixels from geometry alone, for scans without masks: normals and height."""

from dataclasses import dataclass

import numpy as np

from planfit.errors import require_positive
from planfit.geometry import se3
from planfit.geometry.camera import Camera
from planfit.scan import Label
from planfit.structure.normals import depth_normals


@dataclass(frozen=True)
class GeometryLabelOptions:
    """What counts as floor and as wall by its geometry."""

    normal_radius_px: int = 5
    """Half the baseline of a normal; larger is steadier and blurs corners."""
    step_px: int = 3
    """One pixel in this many, each way, is looked at; its label holds for the block."""
    max_tilt_deg: float = 12.0
    """A floor's normal is within this of up, a wall's within this of level."""
    floor_band_m: float = 0.30
    """Level surfaces within this of the floor's height are floor; leaves room for drift in height."""
    min_wall_top_m: float = 1.5
    """Upright surfaces count as wall where they reach this high above the floor; furniture rarely does."""

    def __post_init__(self) -> None:
        require_positive(self, "normal_radius_px", "step_px", "max_tilt_deg", "floor_band_m")


def label_by_geometry(
    depth: np.ndarray,
    camera: Camera,
    level_from_cam: np.ndarray,
    floor_height_m: float,
    options: GeometryLabelOptions,
) -> np.ndarray:
    """Labels (h, w) uint8 of a depth image (h, w) m: floor, wall, or none.

    `level_from_cam` is turned so that z is up; `floor_height_m` is the floor's z in that frame.
    """
    step = options.step_px
    points = camera.lift_image(depth)
    normals = depth_normals(points, options.normal_radius_px, step) @ level_from_cam[:3, :3].T
    points = points[::step, ::step]
    points_level = se3.transform(level_from_cam, points.reshape(-1, 3)).reshape(points.shape)
    height = points_level[..., 2] - floor_height_m
    with np.errstate(invalid="ignore"):
        is_level = normals[..., 2] > np.cos(np.deg2rad(options.max_tilt_deg))
        is_upright = np.abs(normals[..., 2]) < np.sin(np.deg2rad(options.max_tilt_deg))
    labels = np.full(height.shape, Label.NONE, dtype=np.uint8)
    labels[is_level & (np.abs(height) < options.floor_band_m)] = Label.FLOOR
    labels[is_upright & _reaches(points_level, height, is_upright, options)] = Label.WALL
    full = np.repeat(np.repeat(labels, step, axis=0), step, axis=1)
    return full[: depth.shape[0], : depth.shape[1]]


def find_floor_height(heights: np.ndarray) -> float:
    """Height (m) of the floor among heights of level, upward-facing points (n,): the paper's histogram.

    The lowest peak that holds at least a third as many points as the highest peak: a long table or a
    ceiling seen from above may outnumber the floor, and nothing of size lies below it.
    """
    if len(heights) == 0:
        return float("nan")
    bin_m = 0.05
    low = np.floor(np.quantile(heights, 0.001) / bin_m) * bin_m
    edges = np.arange(low - bin_m, heights.max() + 2 * bin_m, bin_m)
    counts, _ = np.histogram(heights, edges)
    smooth = np.convolve(counts, np.ones(5), mode="same")
    peak = int(np.flatnonzero(smooth >= smooth.max() / 3)[0])
    while peak + 1 < len(smooth) and smooth[peak + 1] > smooth[peak]:
        peak += 1
    centre = 0.5 * (edges[peak] + edges[peak + 1])
    return float(np.median(heights[np.abs(heights - centre) < 0.15]))


def _reaches(
    points_level: np.ndarray,
    height: np.ndarray,
    is_upright: np.ndarray,
    options: GeometryLabelOptions,
) -> np.ndarray:
    """Pixels (h, w) bool whose place on the map (0.2 m cells) has upright points high above the floor."""
    cell = np.round(np.nan_to_num(points_level[..., :2]) / 0.2).astype(np.int64)
    code = cell[..., 0] * 1_000_003 + cell[..., 1]
    with np.errstate(invalid="ignore"):
        is_high = is_upright & (height > options.min_wall_top_m)
    cells, counts = np.unique(code[is_high], return_counts=True)
    return np.isin(code, cells[counts >= 3])
