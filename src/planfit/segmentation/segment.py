"""Floor points and wall patches of every frame: the paper's P_F and P_W, ready for the adjustment."""

from dataclasses import dataclass, field
from functools import partial
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Float

from planfit.errors import OptionError, ScanError, require_positive
from planfit.geometry import se3
from planfit.geometry.camera import Camera
from planfit.runtime import Arrays, Runtime, cache_key
from planfit.scan import Label, Scan
from planfit.segmentation.back_ends import BackEnd, MaskBackEnd, geometry_back_end
from planfit.segmentation.geometry_labels import GeometryLabelOptions
from planfit.segmentation.gravity import Gravity, GravityOptions
from planfit.segmentation.learned import LearnedBackEnd, LearnedOptions
from planfit.segmentation.patches import PatchOptions, find_patches
from planfit.segmentation.storeys import StoreyOptions, find_storeys
from planfit.segmentation.surfaces import depth_edges
from planfit.segmentation.types import LevelPoints, Structure, WallPatches


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
    learned: LearnedOptions = field(default_factory=LearnedOptions)
    """The learned back end."""
    patches: PatchOptions = field(default_factory=PatchOptions)
    """How wall points form flat patches."""
    columns: PatchOptions = field(
        default_factory=lambda: PatchOptions(min_points=30, min_length_m=0.15)
    )
    """How points of columns form flat patches: a column's side is short."""
    storeys: StoreyOptions = field(default_factory=StoreyOptions)
    """How floors of several storeys are told apart."""
    seed: int = 0
    """Seed of the random choices."""

    def __post_init__(self) -> None:
        if self.back_end not in ("auto", "masks", "geometry", "learned"):
            raise OptionError(
                "segmentation.back_end: expected auto, masks, geometry or learned, "
                f"found {self.back_end!r}"
            )
        require_positive(self, "max_depth_m", "stride_px", "edge_step", "max_points_per_frame")

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
        gravity: which way is up.
        options: where labels come from, and how many points are kept.
        runtime: threads, cache and progress.
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
        scan.fingerprint, "segmentation", scan.world_from_cams.tobytes(), gravity.up_world, options,
        back_end.identity,
    )  # fmt: skip
    items = runtime.map("floor and walls", key, len(scan), compute)
    return _gather(items, upright_from_cams, back_end.name, options.storeys)


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
    return geometry_back_end(scan, upright_from_cams, options.geometry, options.storeys, runtime)


def _segment_frame(
    scan: Scan,
    upright_from_cams: np.ndarray,
    options: SegmentationOptions,
    back_end: BackEnd,
    i: int,
) -> Arrays:
    """Points and patches of frame i by name, camera frame, as the cache keeps them."""
    # By seed and frame: the result depends neither on the order of frames nor on the number of threads.
    rng = np.random.default_rng([options.seed, i])
    depth = scan.files.depth(i)
    camera, upright_from_cam = scan.cameras[i], upright_from_cams[i]
    labels = back_end.labels(i, depth)
    with np.errstate(invalid="ignore"):
        usable = np.isfinite(depth) & (depth < options.max_depth_m)
    usable &= ~depth_edges(depth, options.edge_step)
    sampled = {
        label: _sample(labels == label, usable, depth, camera, options, rng)
        for label in (Label.FLOOR, Label.WALL, Label.CEILING, Label.COLUMN)
    }
    upright = upright_from_cam[:3, :3]
    walls, unassigned = _split_patches(sampled[Label.WALL], upright, options.patches, rng)
    columns, _ = _split_patches(sampled[Label.COLUMN], upright, options.columns, rng)
    return {
        "floor": sampled[Label.FLOOR],
        "ceiling": sampled[Label.CEILING],
        "unassigned": unassigned,
        **{f"walls_{name}": values for name, values in walls.items()},
        **{f"columns_{name}": values for name, values in columns.items()},
    }


def _split_patches(
    points: np.ndarray,
    upright_from_cam: np.ndarray,
    options: PatchOptions,
    rng: np.random.Generator,
) -> tuple[Arrays, np.ndarray]:
    """Flat upright patches among points (n, 3) m of a frame, and the points (u, 3) on none.

    The rotation `upright_from_cam` (3, 3) makes the frame level.
    """
    points_level = points @ upright_from_cam.T
    patches = find_patches(points_level[:, :2], options, rng)
    mean_z = [points_level[p.point_idx, 2].mean() for p in patches]
    # reshape gives the arrays their shape where there are no patches, and no row tells it.
    normals = np.array([[*p.normal, 0.0] for p in patches]).reshape(-1, 3)
    ends = np.array(
        [[[*end, z] for end in p.ends] for p, z in zip(patches, mean_z, strict=True)]
    ).reshape(-1, 2, 3)
    kept = np.concatenate([p.point_idx for p in patches]) if patches else np.zeros(0, dtype=int)
    # Rows v @ R are (R^T v)^T: back to the camera frame.
    found = {
        "points": points[kept],
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
    size = 2 * options.erode_px + 1
    inner = cv2.erode(mask.astype(np.uint8), np.ones((size, size), np.uint8)).astype(bool) & usable
    step = options.stride_px
    rows, columns = np.nonzero(inner[::step, ::step])
    uv = np.stack([columns, rows], axis=1) * step
    if len(uv) > options.max_points_per_frame:
        chosen = rng.choice(len(uv), options.max_points_per_frame, replace=False)
        uv = uv[np.sort(chosen)]
    return camera.lift(uv.astype(float), depth[uv[:, 1], uv[:, 0]])


def _gather(
    items: list[Arrays], upright_from_cams: np.ndarray, back_end: str, storeys: StoreyOptions
) -> Structure:
    """What all frames show, with the storey that each stands on; takes the points out of the items."""
    floor = _gather_level(items, "floor")
    frame_idx, points = floor.frame_idx, floor.points_cam
    height = np.zeros(len(points))
    for first in range(0, len(points), se3.POINTS_AT_A_TIME):  # four numbers of a transform a point
        part = slice(first, first + se3.POINTS_AT_A_TIME)
        of_frame = upright_from_cams[frame_idx[part], 2]
        height[part] = np.einsum("ni,ni->n", of_frame[:, :3], points[part]) + of_frame[:, 3]
    main_m, above_main_m = find_storeys(height, floor.start, storeys)
    del frame_idx, height
    sizes = [len(item["unassigned"]) for item in items]
    return Structure(
        floor=floor,
        floor_heights_m=above_main_m,
        walls=_gather_patches(items, "walls"),
        unassigned_points_cam=np.concatenate([item.pop("unassigned") for item in items]),
        unassigned_frame_idx=np.repeat(np.arange(len(items)), sizes),
        ceiling=_gather_level(items, "ceiling"),
        columns=_gather_patches(items, "columns"),
        back_end=back_end,
        floor_height_m=main_m,
    )


def _gather_level(items: list[Arrays], name: str) -> LevelPoints:
    start = np.cumsum([0, *(len(item[name]) for item in items)])
    return LevelPoints(np.concatenate([item.pop(name) for item in items]), start)


def _gather_patches(items: list[Arrays], name: str) -> WallPatches:
    sizes = [item[f"{name}_sizes"] for item in items]
    return WallPatches(
        points_cam=np.concatenate([item.pop(f"{name}_points") for item in items]),
        start=np.cumsum([0, *np.concatenate(sizes).astype(int)]),
        frame_idx=np.repeat(np.arange(len(items)), [len(size) for size in sizes]),
        normals_cam=np.concatenate([item[f"{name}_normals"] for item in items]),
        ends_cam=np.concatenate([item[f"{name}_ends"] for item in items]),
    )
