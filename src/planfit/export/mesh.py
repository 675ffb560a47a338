"""A mesh of what the scan saw: truncated signed distances fused over all frames, by Open3D (planfit[map])."""

from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import trimesh
from jaxtyping import Float

from planfit.errors import OutputError
from planfit.geometry import se3
from planfit.runtime import Runtime
from planfit.scan import Scan

SUFFIXES = (".ply", ".obj", ".glb")
TRUNCATION_VOXELS = 4.0
"""Distances are kept this many voxels to both sides of a surface: at 2 cm that is 8 cm, more than twice the
noise of a depth camera at 4 m, and less than a thin wall, whose two sides must not cancel each other."""
LEAST_FRAMES = 3
"""A surface that fewer frames saw is mostly noise at the edges of things."""
BLOCKS = 2000
"""Room for this many blocks of 16 voxels a side to begin with, 160 MB; it grows where they do not suffice."""


def load_open3d() -> ModuleType:
    """The library that fuses.

    Raises:
        OutputError: it is not installed, or cannot be loaded.
    """
    try:
        return import_module("open3d")
    except ModuleNotFoundError as error:
        raise OutputError(
            f"meshes: expected the library Open3D, found none ({error}); install planfit[map]"
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

    Frames are read one after another: memory grows with the surface, not with the frames.

    Args:
        scan: whose images are fused.
        target_from_cams: poses.
        voxel_m: edge of a voxel; details below about two of them are lost.
        max_depth_m: depth beyond is left out.
        runtime: whose progress is told.

    Raises:
        OutputError: Open3D is missing, or no frame has depth that is near enough.
    """
    open3d = load_open3d()
    core, geometry = open3d.core, open3d.t.geometry
    # The older ScalableTSDFVolume stays empty in Open3D 0.20; this one works there and in 0.19.
    volume = geometry.VoxelBlockGrid(
        attr_names=("tsdf", "weight", "color"),
        attr_dtypes=(core.float32, core.float32, core.float32),
        attr_channels=((1,), (1,), (3,)),
        voxel_size=voxel_m,
        block_resolution=16,
        block_count=BLOCKS,
        device=core.Device("CPU:0"),
    )
    n_seen = 0
    for i, pose in enumerate(target_from_cams):
        metres = np.nan_to_num(scan.files.depth(i), nan=0.0).astype(np.float32)
        if ((metres > 0) & (metres < max_depth_m)).any():
            n_seen += 1
            # Open3D rounds to the nearest pixel: an integer is a pixel centre there too.
            lens = core.Tensor(scan.cameras[i].matrix)
            cam_from_target = core.Tensor(np.ascontiguousarray(se3.inverse(pose)))
            depth = geometry.Image(core.Tensor(metres[..., None]))
            color = geometry.Image(core.Tensor(scan.files.color(i).astype(np.float32) / 255))
            view = (1.0, max_depth_m, TRUNCATION_VOXELS)
            blocks = volume.compute_unique_block_coordinates(depth, lens, cam_from_target, *view)
            volume.integrate(blocks, depth, color, lens, lens, cam_from_target, *view)
        runtime.report("mesh", i + 1, len(scan))
    if n_seen == 0:
        raise OutputError(
            f"{scan.name}: expected surfaces to fuse, found no depth below {max_depth_m:g} m in any frame"
        )
    least = min(LEAST_FRAMES, n_seen) - 0.5
    found = volume.extract_triangle_mesh(weight_threshold=least).to_legacy()
    faces = np.asarray(found.triangles)
    if len(faces) == 0:
        raise OutputError(
            f"{scan.name}: expected surfaces that {least + 0.5:g} frames agree on, found none; take larger "
            "voxels (--voxel-m)"
        )
    colors = np.rint(np.asarray(found.vertex_colors).clip(0, 1) * 255).astype(np.uint8)
    return trimesh.Trimesh(
        np.asarray(found.vertices).astype(np.float32), faces, vertex_colors=colors, process=False
    )


def check_suffix(path: Path) -> None:
    """Raise `OutputError` unless meshes can be written under this name."""
    if path.suffix.lower() not in SUFFIXES:
        raise OutputError(
            f"{path}: expected a file of {', '.join(SUFFIXES)} for a mesh, found "
            f"{path.suffix or 'no suffix'}; choose another name with -o"
        )


def write_mesh(path: Path, mesh: trimesh.Trimesh, suffix: str) -> None:
    """Write a mesh in the form of a suffix (`.ply`, binary; `.obj`; `.glb`), whatever the file is called."""
    data = mesh.export(file_type=suffix.lower().removeprefix("."))
    path.write_bytes(data if isinstance(data, bytes) else str(data).encode())
