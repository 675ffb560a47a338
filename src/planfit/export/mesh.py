"""A mesh of what the scan saw: truncated signed distances fused over all frames, by Open3D (planfit[map])."""

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int
from trimesh.visual import ColorVisuals

from planfit.as_built.lines_of_sight import MIN_FRAMES
from planfit.errors import OutputError
from planfit.export.cloud import color_or_grey, near_origin, write_ply
from planfit.geometry import se3
from planfit.runtime import Runtime
from planfit.scan import Scan

SUFFIXES = (".ply", ".obj", ".glb")
TRUNCATION_VOXELS = 4.0
"""Distances are kept this many voxels to both sides of a surface: at 2 cm that is 8 cm, more than twice the
noise of a depth camera at 4 m, and less than a thin wall, whose two sides must not cancel each other."""
SEAM_DIGITS = 5
"""Of a vertex, m: two sides of a seam agree to single precision."""
BLOCKS = 2000
"""Room for this many blocks of 16 voxels a side to begin with, 160 MB; it grows where they do not suffice."""
BLOCK_VOXELS = 16
"""Voxels a side of a block, as Open3D has them."""
_MAX_BLOCKS = 16_000
"""Of a tile: 20 bytes a voxel while frames are fused and 16 more while the surface is extracted make 2.4 GB.
A whole building site at 2 cm is several times that, at which Open3D ends with a segmentation fault."""
_STRIDE_PX = 6
"""Between the pixels looked at: 9 cm at 6 m for a usual lens, where a block at 2 cm has 32."""
_UNBOUNDED = 1 << 30


@dataclass(frozen=True)
class _Tile:
    """A box of blocks, and the frames that see into it or beside it."""

    low: Int[np.ndarray, "3"]
    high: Int[np.ndarray, "3"]
    """The first block that is beyond, along each axis."""
    frame_idx: Int[np.ndarray, " f"]

    def touches(self, blocks: Int[np.ndarray, "b 3"]) -> Bool[np.ndarray, " b"]:
        """Whether blocks are inside, or beside it: surfaces at its border need what lies beyond."""
        return np.all((blocks >= self.low - 1) & (blocks <= self.high), axis=1)

    def owns(self, points: Float[np.ndarray, "p 3"], block_m: float) -> Bool[np.ndarray, " p"]:
        """Whether points lie inside; each lies in one tile."""
        blocks = np.floor(points / block_m)
        return np.all((blocks >= self.low) & (blocks < self.high), axis=1)


def load_open3d() -> ModuleType:
    """The library that fuses.

    Raises:
        OutputError: it is not installed, or cannot be loaded.
    """
    try:
        return import_module("open3d")
    except ModuleNotFoundError as error:
        raise OutputError(
            f"meshes: expected the library Open3D, found none ({error}); pip install 'planfit[map]'"
        ) from error
    except (ImportError, OSError) as error:
        raise OutputError(
            f"meshes: expected the library Open3D, found one that cannot be loaded ({error}); install the "
            "system's libraries that it names (on Debian and Ubuntu libgl1, libgomp1, libusb-1.0-0)"
        ) from error


def fuse_mesh(
    scan: Scan,
    target_from_cams: Float[np.ndarray, "n 4 4"],
    voxel_m: float,
    max_depth_m: float,
    runtime: Runtime,
) -> trimesh.Trimesh:
    """Coloured triangles in the target frame.

    Frames are read one after another, and large scans are fused tile by tile (`cut_tiles`), so that memory
    grows with neither.

    Raises:
        OutputError: Open3D is missing, or no frame has depth that is near enough.
        ScanError: an image cannot be read.
    """
    open3d = load_open3d()
    # Volumes are of single precision, which knows half a metre at the millions of a national grid.
    origin = near_origin(target_from_cams[:, :3, 3])
    target_from_cams = target_from_cams.copy()
    target_from_cams[:, :3, 3] -= origin
    truncation_m = TRUNCATION_VOXELS * voxel_m
    tiles = cut_tiles(scan, target_from_cams, voxel_m, max_depth_m, truncation_m)
    if not tiles:
        raise OutputError(
            f"{scan.name}: expected surfaces to fuse, found no depth below {max_depth_m:g} m in any frame"
        )
    n_seen = len(np.unique(np.concatenate([tile.frame_idx for tile in tiles])))
    least = min(MIN_FRAMES, n_seen)  # what fewer saw is mostly noise at the edges of things
    n_steps, done, parts = sum(len(tile.frame_idx) for tile in tiles), 0, []
    for tile in tiles:
        volume = _empty_volume(open3d, voxel_m)
        for i in tile.frame_idx:
            _integrate(open3d, volume, scan, int(i), target_from_cams[i], max_depth_m, tile)
            done += 1
            runtime.report("mesh", done, n_steps)
        parts.append(_extract(volume, least))
        parts[-1].update_faces(tile.owns(parts[-1].triangles_center, BLOCK_VOXELS * voxel_m))
        parts[-1].remove_unreferenced_vertices()
        del volume  # before the next one is made
    mesh = parts[0] if len(parts) == 1 else _joined(parts)
    if len(mesh.faces) == 0:
        raise OutputError(
            f"{scan.name}: expected surfaces that {least} frames agree on, found none; take larger "
            "voxels (--voxel-m)"
        )
    mesh.apply_translation(origin)
    return mesh


def _empty_volume(open3d: ModuleType, voxel_m: float) -> Any:
    core = open3d.core
    # The older ScalableTSDFVolume stays empty in Open3D 0.20; this one works there and in 0.19.
    return open3d.t.geometry.VoxelBlockGrid(
        attr_names=("tsdf", "weight", "color"),
        attr_dtypes=(core.float32, core.float32, core.float32),
        attr_channels=((1,), (1,), (3,)),
        voxel_size=voxel_m,
        block_resolution=BLOCK_VOXELS,
        block_count=BLOCKS,
        device=core.Device("CPU:0"),
    )


def _integrate(
    open3d: ModuleType,
    volume: Any,
    scan: Scan,
    i: int,
    target_from_cam: Float[np.ndarray, "4 4"],
    max_depth_m: float,
    tile: _Tile,
) -> None:
    """Fuse what frame i sees of a tile into the volume."""
    core, image = open3d.core, open3d.t.geometry.Image
    metres = np.nan_to_num(scan.files.depth(i), nan=0.0).astype(np.float32)
    # Open3D rounds to the nearest pixel: an integer is a pixel centre there too.
    lens = core.Tensor(scan.cameras[i].matrix)
    cam_from_target = core.Tensor(np.ascontiguousarray(se3.inverse(target_from_cam)))
    depth = image(core.Tensor(metres[..., None]))
    color = image(core.Tensor(color_or_grey(scan, i).astype(np.float32) / 255))
    view = (1.0, max_depth_m, TRUNCATION_VOXELS)
    blocks = volume.compute_unique_block_coordinates(depth, lens, cam_from_target, *view).numpy()
    inside = np.ascontiguousarray(blocks[tile.touches(blocks)])
    if len(inside):
        volume.integrate(core.Tensor(inside), depth, color, lens, lens, cam_from_target, *view)


def _extract(volume: Any, least_frames: int) -> trimesh.Trimesh:
    """The surface that at least this many frames saw."""
    # Each frame adds one to the weight of what it sees: half less keeps the comparison off rounding.
    found = volume.extract_triangle_mesh(weight_threshold=least_frames - 0.5).to_legacy()
    colors = np.rint(np.asarray(found.vertex_colors).clip(0, 1) * 255).astype(np.uint8)
    return trimesh.Trimesh(
        np.asarray(found.vertices).astype(np.float32),
        np.asarray(found.triangles),
        vertex_colors=colors,
        process=False,
    )


def _joined(parts: list[trimesh.Trimesh]) -> trimesh.Trimesh:
    """One mesh; vertices on the seams, which both sides computed from the same voxels, become one."""
    mesh = trimesh.util.concatenate(parts)
    assert isinstance(mesh, trimesh.Trimesh)
    mesh.merge_vertices(digits_vertex=SEAM_DIGITS)
    return mesh


def check_suffix(path: Path) -> None:
    """Raise `OutputError` unless meshes can be written under this name."""
    if path.suffix.lower() not in SUFFIXES:
        raise OutputError(
            f"{path}: expected a file of {', '.join(SUFFIXES)} for a mesh, found "
            f"{path.suffix or 'no suffix'}; choose another name with -o"
        )


def write_mesh(path: Path, mesh: trimesh.Trimesh, suffix: str) -> None:
    """Write a mesh in the form of a suffix (`.ply`, binary; `.obj`; `.glb`), whatever the file is called."""
    kind = suffix.lower().removeprefix(".")
    if kind == "ply":
        assert isinstance(mesh.visual, ColorVisuals)  # as all meshes are made here
        write_ply(path, mesh.vertices, mesh.visual.vertex_colors[:, :3], mesh.faces)
        return
    if kind == "glb":
        # Its vertices are of single precision; the place of the whole is not.
        origin = near_origin(mesh.vertices)
        near, scene = mesh.copy(), trimesh.Scene()
        near.apply_translation(-origin)
        scene.add_geometry(near, transform=trimesh.transformations.translation_matrix(origin))
        data = scene.export(file_type=kind)
    else:
        data = mesh.export(file_type=kind)
    path.write_bytes(data if isinstance(data, bytes) else str(data).encode())


def cut_tiles(
    scan: Scan,
    target_from_cams: Float[np.ndarray, "n 4 4"],
    voxel_m: float,
    max_depth_m: float,
    truncation_m: float,
    max_blocks: int = _MAX_BLOCKS,
) -> list[_Tile]:
    """Boxes of at most about `max_blocks` seen blocks each, which together fill space: halved where they
    are most spread out, until they are small enough. None where no frame has depth that is near enough.

    Args:
        scan: whose depth is read, once.
        target_from_cams: poses.
        voxel_m: edge of a voxel.
        max_depth_m: depth beyond is left out.
        truncation_m: how far before and behind a surface blocks are made.
        max_blocks: see above.

    Raises:
        ScanError: an image cannot be read.
    """
    block_m = BLOCK_VOXELS * voxel_m
    of_frame = [
        _blocks(scan, i, pose, block_m, max_depth_m, truncation_m)
        for i, pose in enumerate(target_from_cams)
    ]
    if not any(len(blocks) for blocks in of_frame):
        return []
    seen = np.unique(np.concatenate(of_frame), axis=0)
    boxes = _halve(seen, np.full(3, -_UNBOUNDED), np.full(3, _UNBOUNDED), max_blocks)
    tiles = []
    for low, high in boxes:
        whole = _Tile(low, high, np.arange(len(scan)))
        frames = [i for i, blocks in enumerate(of_frame) if whole.touches(blocks).any()]
        tiles.append(_Tile(low, high, np.array(frames, dtype=int)))
    return tiles


def _blocks(
    scan: Scan,
    i: int,
    target_from_cam: Float[np.ndarray, "4 4"],
    block_m: float,
    max_depth_m: float,
    truncation_m: float,
) -> Int[np.ndarray, "b 3"]:
    """Blocks about the surfaces that a frame sees."""
    depth = scan.files.depth(i)
    near = np.where((depth > 0) & (depth < max_depth_m), depth, np.nan)
    found = []
    for offset in (-truncation_m, 0.0, truncation_m):
        points = (
            scan.cameras[i].lift_image(near + offset)[::_STRIDE_PX, ::_STRIDE_PX].reshape(-1, 3)
        )
        points = points[np.isfinite(points).all(axis=1)]
        blocks = np.floor(se3.transform(target_from_cam, points) / block_m).astype(int)
        found.append(np.unique(blocks, axis=0))
    return np.unique(np.concatenate(found), axis=0)


def _halve(
    blocks: Int[np.ndarray, "b 3"],
    low: Int[np.ndarray, "3"],
    high: Int[np.ndarray, "3"],
    max_blocks: int,
) -> list[tuple[Int[np.ndarray, "3"], Int[np.ndarray, "3"]]]:
    """Boxes [low, high) of at most so many of these blocks, where blocks can be told apart at all."""
    spread = np.ptp(blocks, axis=0)
    axis = int(np.argmax(spread))
    if len(blocks) <= max_blocks or spread[axis] == 0:
        return [(low, high)]
    at = max(int(np.median(blocks[:, axis])), int(blocks[:, axis].min()) + 1)
    is_below = blocks[:, axis] < at
    below_high, above_low = high.copy(), low.copy()
    below_high[axis] = above_low[axis] = at
    return [
        *_halve(blocks[is_below], low, below_high, max_blocks),
        *_halve(blocks[~is_below], above_low, high, max_blocks),
    ]
