"""Floor points and wall patches of every frame: the paper's P_F and P_W, ready for the adjustment."""

from dataclasses import dataclass, field
from functools import partial
from typing import Literal

import cv2
import numpy as np

from planfit.errors import OptionError, ScanError, require_positive
from planfit.geometry import se3
from planfit.geometry.camera import Camera
from planfit.scan import Label, Scan
from planfit.structure.geometry_labels import (
    GeometryLabelOptions,
    find_floor_height,
    label_by_geometry,
)
from planfit.structure.gravity import Gravity, GravityOptions
from planfit.structure.normals import depth_edges, depth_normals
from planfit.structure.patches import PatchOptions, find_patches
from planfit.work import Arrays, Work, cache_key


@dataclass(frozen=True)
class StructureOptions:
    """Where floor and wall points come from, and how many are kept."""

    back_end: Literal["auto", "masks", "geometry"] = "auto"
    """`masks`: segmentation beside the images; `geometry`: normals and height; `auto`: masks where the
    scan has them, else geometry (the report says which)."""
    max_depth_m: float = 12.0
    """Points further away are dropped."""
    stride_px: int = 3
    """One pixel in this many, each way, is looked at."""
    erode_px: int = 3
    """Pixels within this of a label's border are dropped: masks and depth rarely agree there."""
    edge_step: float = 0.05
    """Pixels near a jump of depth by more than this share are dropped."""
    max_points_per_frame: int = 1500
    """Floor points and wall points kept a frame, each."""
    gravity: GravityOptions = field(default_factory=GravityOptions)
    """How up is found."""
    geometry: GeometryLabelOptions = field(default_factory=GeometryLabelOptions)
    """The geometry back end."""
    patches: PatchOptions = field(default_factory=PatchOptions)
    """How wall points form flat pieces."""
    seed: int = 0
    """Seed of the random choices."""

    def __post_init__(self) -> None:
        if self.back_end not in ("auto", "masks", "geometry"):
            raise OptionError(
                f"structure.back_end: expected auto, masks or geometry, found {self.back_end!r}"
            )
        require_positive(self, "max_depth_m", "stride_px", "edge_step", "max_points_per_frame")


@dataclass(frozen=True)
class Structure:
    """Floor points and wall patches, in camera frames, sorted by frame."""

    floor_points_cam: np.ndarray  # (f, 3) m
    floor_start: np.ndarray  # (n_frames + 1,): points of frame i are start[i]:start[i + 1]
    wall_points_cam: np.ndarray  # (w, 3) m
    loose_points_cam: np.ndarray  # (l, 3) m, wall points that lie on no flat piece
    loose_frame_idx: np.ndarray  # (l,)
    patch_start: np.ndarray  # (k + 1,): wall points of patch j are start[j]:start[j + 1]
    patch_frame_idx: np.ndarray  # (k,)
    patch_normals_cam: np.ndarray  # (k, 3) unit, level, towards the camera
    patch_ends_cam: np.ndarray  # (k, 2, 3) m, both ends of the piece at its mean height
    back_end: str
    """Which back end labelled the pixels: masks or geometry."""
    floor_height_m: float
    """The floor's height in the world turned level, as recorded; NaN where none was seen."""

    @property
    def n_patches(self) -> int:
        """Number of wall patches."""
        return len(self.patch_frame_idx)

    @property
    def floor_frame_idx(self) -> np.ndarray:
        """(f,) frame of each floor point."""
        return np.repeat(np.arange(len(self.floor_start) - 1), np.diff(self.floor_start))

    @property
    def wall_frame_idx(self) -> np.ndarray:
        """(w,) frame of each wall point on a patch."""
        return np.repeat(self.patch_frame_idx, np.diff(self.patch_start))


def level_from_world(gravity: Gravity, floor_height_m: float) -> np.ndarray:
    """Transform (4, 4) that turns up to +z and puts the floor at z = 0."""
    up = np.array([0.0, 0.0, 1.0])
    turned = se3.make_transform(se3.rotation_between(gravity.up_world, up), np.zeros(3))
    if np.isfinite(floor_height_m):
        turned[2, 3] = -floor_height_m
    return turned


def extract_structure(
    scan: Scan, gravity: Gravity, options: StructureOptions, work: Work
) -> Structure:
    """Floor points and wall patches of each frame; paper, Sec. III-B.

    Raises:
        ScanError: masks were asked for and the scan has none, or a file cannot be used.
    """
    if options.back_end == "masks" and not scan.has_labels:
        raise ScanError(
            f"{scan.name}: expected floor and wall masks, found none; add them, or use "
            "--structure.back-end geometry"
        )
    use_masks = scan.has_labels and options.back_end != "geometry"
    upright_from_cams = level_from_world(gravity, 0.0) @ scan.world_from_cams
    floor_height = np.nan
    key_parts = (scan.fingerprint, scan.world_from_cams.tobytes(), gravity.up_world, options)
    if not use_masks:
        levels = partial(_level_heights, scan, upright_from_cams, options)
        items = work.map("floor height", cache_key("level", *key_parts), len(scan), levels)
        floor_height = find_floor_height(np.concatenate([item["height"] for item in items]))
    compute = partial(_frame_structure, scan, upright_from_cams, options, use_masks, floor_height)
    key = cache_key("structure", *key_parts, use_masks)
    items = work.map("floor and walls", key, len(scan), compute)
    return _gather(items, upright_from_cams, "masks" if use_masks else "geometry")


def _level_heights(
    scan: Scan, upright_from_cams: np.ndarray, options: StructureOptions, i: int
) -> Arrays:
    """Heights of upward-facing points of one frame."""
    depth = scan.files.depth(i)
    points = scan.cameras[i].lift_image(depth)
    normals = depth_normals(points, options.geometry.normal_radius_px, step_px=8).reshape(-1, 3)
    points = points[::8, ::8].reshape(-1, 3)
    with np.errstate(invalid="ignore"):
        faces_up = (normals @ upright_from_cams[i, 2, :3] > 0.97) & (
            points[:, 2] < options.max_depth_m
        )
    return {"height": se3.transform(upright_from_cams[i], points[faces_up])[:, 2]}


def _frame_structure(
    scan: Scan,
    upright_from_cams: np.ndarray,
    options: StructureOptions,
    use_masks: bool,
    floor_height: float,
    i: int,
) -> Arrays:
    rng = np.random.default_rng([options.seed, i])
    depth = scan.files.depth(i)
    camera, upright_from_cam = scan.cameras[i], upright_from_cams[i]
    if use_masks:
        labels = scan.files.labels(i)
    else:
        labels = label_by_geometry(depth, camera, upright_from_cam, floor_height, options.geometry)
    with np.errstate(invalid="ignore"):
        usable = np.isfinite(depth) & (depth < options.max_depth_m)
    usable &= ~depth_edges(depth, options.edge_step)
    floor = _sample(labels == Label.FLOOR, usable, depth, camera, options, rng)
    wall = _sample(labels == Label.WALL, usable, depth, camera, options, rng)
    turn = upright_from_cam[:3, :3]
    wall_level = wall @ turn.T
    patches = find_patches(wall_level[:, :2], options.patches, rng)
    mean_z = [wall_level[p.point_idx, 2].mean() for p in patches]
    normals = np.array([[*p.normal, 0.0] for p in patches]).reshape(-1, 3)
    ends = np.array(
        [[[*end, z] for end in p.ends] for p, z in zip(patches, mean_z, strict=True)]
    ).reshape(-1, 2, 3)
    kept = np.concatenate([p.point_idx for p in patches]) if patches else np.zeros(0, dtype=int)
    return {
        "floor": floor,
        "wall": wall[kept],
        "loose": np.delete(wall, kept, axis=0),
        "patch_size": np.array([len(p.point_idx) for p in patches], dtype=int),
        "normals": normals @ turn,
        "ends": ends @ turn,
    }


def _sample(
    mask: np.ndarray,
    usable: np.ndarray,
    depth: np.ndarray,
    camera: Camera,
    options: StructureOptions,
    rng: np.random.Generator,
) -> np.ndarray:
    """Points (n, 3) m, camera frame, of an eroded mask; at most `max_points_per_frame`."""
    size = 2 * options.erode_px + 1
    inner = cv2.erode(mask.astype(np.uint8), np.ones((size, size), np.uint8)).astype(bool) & usable
    step = options.stride_px
    rows, columns = np.nonzero(inner[::step, ::step])
    uv = np.stack([columns, rows], axis=1) * step
    if len(uv) > options.max_points_per_frame:
        chosen = rng.choice(len(uv), options.max_points_per_frame, replace=False)
        uv = uv[np.sort(chosen)]
    return camera.lift(uv.astype(float), depth[uv[:, 1], uv[:, 0]])


def _gather(items: list[Arrays], upright_from_cams: np.ndarray, back_end: str) -> Structure:
    floor_start = np.cumsum([0, *(len(item["floor"]) for item in items)])
    patch_sizes = np.concatenate([item["patch_size"] for item in items]).astype(int)
    floor = np.concatenate([item["floor"] for item in items])
    frame_of_point = np.repeat(np.arange(len(items)), np.diff(floor_start))
    height = (
        np.einsum("ni,ni->n", upright_from_cams[frame_of_point, 2, :3], floor)
        + upright_from_cams[frame_of_point, 2, 3]
    )
    return Structure(
        floor_points_cam=floor,
        floor_start=floor_start,
        wall_points_cam=np.concatenate([item["wall"] for item in items]),
        loose_points_cam=np.concatenate([item["loose"] for item in items]),
        loose_frame_idx=np.repeat(np.arange(len(items)), [len(item["loose"]) for item in items]),
        patch_start=np.cumsum([0, *patch_sizes]),
        patch_frame_idx=np.repeat(
            np.arange(len(items)), [len(item["patch_size"]) for item in items]
        ),
        patch_normals_cam=np.concatenate([item["normals"] for item in items]),
        patch_ends_cam=np.concatenate([item["ends"] for item in items]),
        back_end=back_end,
        # Paper: the plane is fitted once. With up known, only its height is free, and the median
        # height is the fit that wrong labels move least.
        floor_height_m=float(np.median(height)) if len(height) else float("nan"),
    )
