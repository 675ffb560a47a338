"""Floor points and wall patches of every frame: the paper's P_F and P_W, ready for the adjustment."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Float

from planfit.errors import OptionError, ScanError, require_positive
from planfit.geometry import se3
from planfit.geometry.camera import Camera
from planfit.priors import CAMERA_HEIGHT_M
from planfit.runtime import SEED, Arrays, Runtime, StoredItem, cache_key, let_go, map_rows
from planfit.scan import Label, Scan
from planfit.segmentation.back_ends import BackEnd, MaskBackEnd, geometry_back_end
from planfit.segmentation.gravity import Gravity
from planfit.segmentation.learned import LearnedBackEnd, LearnedOptions
from planfit.segmentation.patches import COLUMN_PATCH, WALL_PATCH, PatchSize, find_patches
from planfit.segmentation.storeys import find_storeys
from planfit.segmentation.surfaces import depth_edges
from planfit.segmentation.types import LevelPoints, Structure, WallPatches

_STORED = ("floor", "ceiling", "unassigned", "walls_points", "columns_points")
"""Of what is found in a frame, the points: they are read when those of all frames are brought together."""
_ERODE_PX = 3
"""Pixels within this of a label's border are dropped: masks and depth rarely agree there."""
_EDGE_STEP = 0.05
"""Pixels near a jump of depth by more than this share are dropped."""


@dataclass(frozen=True)
class SegmentationOptions:
    """Where floor and wall points come from, and how many are kept."""

    back_end: Literal["auto", "masks", "geometry", "learned"] = "auto"
    """`masks`: segmentation beside the images; `geometry`: normals, heights and what is seen over what;
    `learned`: a segmentation model over the colour images (see `learned`); `auto`: masks where the scan
    has them, else geometry (the report says which)."""
    max_depth_m: float = 12.0
    """Points further away are dropped."""
    stride_px: int = 3
    """One pixel in this many, each way, is looked at."""
    max_points_per_frame: int = 1500
    """Floor points and wall points kept a frame, each."""
    learned: LearnedOptions = field(default_factory=LearnedOptions)
    """The learned back end."""

    def __post_init__(self) -> None:
        if self.back_end not in ("auto", "masks", "geometry", "learned"):
            raise OptionError(
                "segmentation.back_end: expected auto, masks, geometry or learned, "
                f"found {self.back_end!r}"
            )
        require_positive(self, "max_depth_m", "stride_px", "max_points_per_frame")

    @property
    def reads_masks(self) -> bool:
        """Whether masks beside the images are looked at."""
        return self.back_end in ("auto", "masks")


def level_from_world(gravity: Gravity, floor_height_m: float) -> Float[np.ndarray, "4 4"]:
    """Transform that turns up to +z and puts the floor at z = 0."""
    up = np.array([0.0, 0.0, 1.0])
    turned = se3.make_transform(se3.rotation_between(gravity.up_world, up), np.zeros(3))
    if np.isfinite(floor_height_m):
        turned[2, 3] = -floor_height_m
    return turned


def segment_scan(
    scan: Scan,
    gravity: Gravity,
    options: SegmentationOptions,
    runtime: Runtime,
    back_end: BackEnd | None = None,
) -> Structure:
    """Floor points and wall patches of each frame; paper, Sec. III-B.

    Args:
        scan: its depth is read, and what the back end needs.
        options: where labels come from, and how many points are kept.
        back_end: labels the pixels, in the place of that of the options; `ArrayBackEnd` for labels of one's
            own.

    Raises:
        ScanError: masks were asked for and the scan has none, or a file cannot be used.
        OptionError: the learned model cannot be had.
    """
    back_end = back_end or choose_back_end(scan, gravity, options, runtime)
    upright_from_cams = level_from_world(gravity, 0.0) @ scan.world_from_cams
    compute = partial(_segment_frame, scan, upright_from_cams, options, back_end)
    key = cache_key(
        scan.fingerprint, "segmentation, float32", scan.world_from_cams.tobytes(), gravity.up_world, options,
        back_end.identity,
    )  # fmt: skip
    items = runtime.map_stored("floor and walls", key, len(scan), compute, _STORED)
    found = _gather(items, upright_from_cams, back_end.name)
    if np.isfinite(found.floor_height_m) or scan.plan_from_world_axes is not None:
        return found
    supposed_m = float(upright_from_cams[:, 2, 3].mean()) - CAMERA_HEIGHT_M.value
    return replace(found, floor_height_m=supposed_m)


def choose_back_end(
    scan: Scan, gravity: Gravity, options: SegmentationOptions, runtime: Runtime
) -> BackEnd:
    """The back end that `options` ask for; geometry looks through the whole scan here.

    Raises:
        ScanError: masks were asked for and the scan has none.
        OptionError: the learned model cannot be had.
    """
    if options.back_end == "masks" and not scan.has_labels:
        raise ScanError(
            f"{scan.name}: expected floor and wall masks, found none; add them, or use "
            "--segmentation.back-end geometry"
        )
    if options.back_end == "learned":
        return LearnedBackEnd(scan, options.learned)
    if scan.has_labels and options.back_end != "geometry":
        return MaskBackEnd(scan)
    upright_from_cams = level_from_world(gravity, 0.0) @ scan.world_from_cams
    return geometry_back_end(scan, upright_from_cams, runtime)


def _segment_frame(
    scan: Scan,
    upright_from_cams: np.ndarray,
    options: SegmentationOptions,
    back_end: BackEnd,
    i: int,
) -> Arrays:
    """Points and patches of frame i by name, camera frame, as the cache keeps them: points as float32, which
    is what depth is measured in."""
    # By seed and frame: the result depends neither on the order of frames nor on the number of threads.
    rng = np.random.default_rng([SEED, i])
    depth = scan.files.depth(i)
    camera, upright_from_cam = scan.cameras[i], upright_from_cams[i]
    labels = back_end.labels(i, depth)
    with np.errstate(invalid="ignore"):
        usable = np.isfinite(depth) & (depth < options.max_depth_m)
    usable &= ~depth_edges(depth, _EDGE_STEP)
    sampled = {
        label: _sample(labels == label, usable, depth, camera, options, rng)
        for label in (Label.FLOOR, Label.WALL, Label.CEILING, Label.COLUMN)
    }
    upright = upright_from_cam[:3, :3]
    walls, unassigned = _split_patches(sampled[Label.WALL], upright, WALL_PATCH, rng)
    columns, _ = _split_patches(sampled[Label.COLUMN], upright, COLUMN_PATCH, rng)
    return {
        "floor": sampled[Label.FLOOR].astype(np.float32),
        "ceiling": sampled[Label.CEILING].astype(np.float32),
        "unassigned": unassigned.astype(np.float32),
        **{f"walls_{name}": values for name, values in walls.items()},
        **{f"columns_{name}": values for name, values in columns.items()},
    }


def _split_patches(
    points: np.ndarray, upright_from_cam: np.ndarray, size: PatchSize, rng: np.random.Generator
) -> tuple[Arrays, np.ndarray]:
    """Flat upright patches among points (n, 3) m of a frame, and the points (u, 3) on none.

    The rotation `upright_from_cam` (3, 3) makes the frame level.
    """
    points_level = points @ upright_from_cam.T
    patches = find_patches(points_level[:, :2], size, rng)
    mean_z = [points_level[p.point_idx, 2].mean() for p in patches]
    # reshape gives the arrays their shape where there are no patches, and no row tells it.
    normals = np.array([[*p.normal, 0.0] for p in patches]).reshape(-1, 3)
    ends = np.array(
        [[[*end, z] for end in p.ends] for p, z in zip(patches, mean_z, strict=True)]
    ).reshape(-1, 2, 3)
    kept = np.concatenate([p.point_idx for p in patches]) if patches else np.zeros(0, dtype=int)
    # Rows v @ R are (R^T v)^T: back to the camera frame.
    found = {
        "points": points[kept].astype(np.float32),
        "sizes": np.array([len(p.point_idx) for p in patches], dtype=int),
        "normals": normals @ upright_from_cam,
        "ends": ends @ upright_from_cam,
    }
    return found, np.delete(points, kept, axis=0)


def _sample(
    mask: np.ndarray,
    usable: np.ndarray,
    depth: np.ndarray,
    camera: Camera,
    options: SegmentationOptions,
    rng: np.random.Generator,
) -> np.ndarray:
    """Points (n, 3) m, camera frame, of an eroded mask; at most `max_points_per_frame`."""
    size = 2 * _ERODE_PX + 1
    inner = cv2.erode(mask.astype(np.uint8), np.ones((size, size), np.uint8)).astype(bool) & usable
    step = options.stride_px
    rows, columns = np.nonzero(inner[::step, ::step])
    uv = np.stack([columns, rows], axis=1) * step
    if len(uv) > options.max_points_per_frame:
        chosen = rng.choice(len(uv), options.max_points_per_frame, replace=False)
        uv = uv[np.sort(chosen)]
    return camera.lift(uv.astype(float), depth[uv[:, 1], uv[:, 0]])


def _gather(items: Sequence[StoredItem], upright_from_cams: np.ndarray, back_end: str) -> Structure:
    """What all frames show, with the storey that each stands on."""
    floor = _gather_level(items, "floor")
    height = np.zeros(len(floor))
    for part, frame in se3.points_in_parts(floor.start):  # four numbers of a transform a point
        of_frame, points = upright_from_cams[frame, 2], floor.points_cam[part]
        height[part] = np.einsum("ni,ni->n", of_frame[:, :3], points) + of_frame[:, 3]
        let_go(points)
    main_m, above_main_m = find_storeys(height, floor.start)
    del height
    sizes = [len(item.stored["unassigned"]) for item in items]
    return Structure(
        floor=floor,
        floor_heights_m=above_main_m,
        walls=_gather_patches(items, "walls"),
        unassigned_points_cam=_gather_points(items, "unassigned"),
        unassigned_frame_idx=np.repeat(np.arange(len(items), dtype=np.int32), sizes),
        ceiling=_gather_level(items, "ceiling"),
        columns=_gather_patches(items, "columns"),
        back_end=back_end,
        floor_height_m=main_m,
    )


def _gather_points(items: Sequence[StoredItem], name: str) -> Float[np.ndarray, "m 3"]:
    """Points of all frames, read one frame after the other."""
    stored = [item.stored[name] for item in items]
    shape = (sum(map(len, stored)), 3)
    return map_rows((each.read() for each in stored), shape, np.dtype(np.float32))


def _gather_level(items: Sequence[StoredItem], name: str) -> LevelPoints:
    start = np.cumsum([0, *(len(item.stored[name]) for item in items)])
    return LevelPoints(_gather_points(items, name), start)


def _gather_patches(items: Sequence[StoredItem], name: str) -> WallPatches:
    sizes = [item.arrays[f"{name}_sizes"] for item in items]
    return WallPatches(
        points_cam=_gather_points(items, f"{name}_points"),
        start=np.cumsum([0, *np.concatenate(sizes).astype(int)]),
        frame_idx=np.repeat(np.arange(len(items)), [len(size) for size in sizes]),
        normals_cam=np.concatenate([item.arrays[f"{name}_normals"] for item in items]),
        ends_cam=np.concatenate([item.arrays[f"{name}_ends"] for item in items]),
    )
