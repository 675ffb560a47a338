"""How a volume of voxels is cut so that each part fits into memory: by the blocks that frames see."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.geometry import se3
from planfit.scan import Scan

BLOCK_VOXELS = 16
"""Voxels a side of a block, as Open3D has them."""
MAX_BLOCKS = 16_000
"""Of a tile: 20 bytes a voxel while frames are fused and 16 more while the surface is extracted make 2.4 GB.
A whole building site at 2 cm is several times that, at which Open3D ends with a segmentation fault."""
STRIDE_PX = 6
"""Between the pixels looked at: 9 cm at 6 m for a usual lens, where a block at 2 cm has 32."""
UNBOUNDED = 1 << 30


@dataclass(frozen=True)
class Tile:
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


def cut_tiles(
    scan: Scan,
    target_from_cams: Float[np.ndarray, "n 4 4"],
    voxel_m: float,
    max_depth_m: float,
    truncation_m: float,
    max_blocks: int = MAX_BLOCKS,
) -> list[Tile]:
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
    boxes = _halve(seen, np.full(3, -UNBOUNDED), np.full(3, UNBOUNDED), max_blocks)
    tiles = []
    for low, high in boxes:
        whole = Tile(low, high, np.arange(len(scan)))
        frames = [i for i, blocks in enumerate(of_frame) if whole.touches(blocks).any()]
        tiles.append(Tile(low, high, np.array(frames, dtype=int)))
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
        points = scan.cameras[i].lift_image(near + offset)[::STRIDE_PX, ::STRIDE_PX].reshape(-1, 3)
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
