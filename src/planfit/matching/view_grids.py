"""View grids: depth and grey of every frame on a coarse grid, cheap enough to compare whole views.

Keypoints say where two views look alike; the grids say what else the views show.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

from planfit.geometry.camera import Camera
from planfit.runtime import concatenated, map_rows, taken

COLUMNS, ROWS = 64, 48
"""Cells of a grid: about a degree each for a phone, 15 kB a frame."""
_SAMPLES = 3
"""Depth is sampled this many times along each side of a cell; the median stands for the cell."""
_MIN_SAMPLES = 5
"""A cell with fewer measured samples has no depth."""


@dataclass(frozen=True)
class ViewGrids:
    """What the n frames show, a cell a degree or so."""

    depth_m: Float32[np.ndarray, "n r c"]
    """Along the optical axis, m; NaN where too little was measured. Of many frames, in a file."""
    grey: UInt8[np.ndarray, "n r c"]
    """Mean over each cell."""
    cameras: Float[np.ndarray, "n 4"]
    """fx, fy, cx, cy of each frame in cells: integers are the cells' centres."""

    def __len__(self) -> int:
        return len(self.depth_m)

    def __getitem__(self, idx: Int[np.ndarray, " k"]) -> "ViewGrids":
        """Those of some frames."""
        depth_m = taken(self._rows, idx).reshape(-1, ROWS, COLUMNS)
        return ViewGrids(depth_m, self.grey[idx], self.cameras[idx])

    @property
    def _rows(self) -> Float32[np.ndarray, "n rc"]:
        return self.depth_m.reshape(len(self), ROWS * COLUMNS)

    def joined(self, other: "ViewGrids") -> "ViewGrids":
        """These, then those of `other`."""
        depth_m = concatenated([self._rows, other._rows])
        return ViewGrids(
            depth_m.reshape(-1, ROWS, COLUMNS),
            np.concatenate([self.grey, other.grey]),
            np.concatenate([self.cameras, other.cameras]),
        )


def depth_grid(depth: Float[np.ndarray, "h w"]) -> Float32[np.ndarray, "r c"]:
    """Median depth (m) of each cell of a depth image (m, NaN where nothing was measured)."""
    height, width = depth.shape
    # The middle of each of the ROWS x _SAMPLES strips that the image is cut into; columns likewise.
    row, column = (
        ((np.arange(k * _SAMPLES) + 0.5) * size / (k * _SAMPLES)).astype(int)
        for k, size in ((ROWS, height), (COLUMNS, width))
    )
    sampled = depth[row[:, None], column].reshape(ROWS, _SAMPLES, COLUMNS, _SAMPLES)
    values = sampled.transpose(0, 2, 1, 3).reshape(ROWS, COLUMNS, -1)
    n_measured = np.isfinite(values).sum(axis=2)
    ordered = np.sort(values, axis=2)  # NaN last
    middle = np.maximum(n_measured - 1, 0) // 2
    median = np.take_along_axis(ordered, middle[..., None], axis=2)[..., 0]
    return np.where(n_measured >= _MIN_SAMPLES, median, np.nan).astype(np.float32)


def grey_grid(color: UInt8[np.ndarray, "h w 3"] | None) -> UInt8[np.ndarray, "r c"]:
    """Mean grey of each cell of a colour image; without one, one grey, which is like no other nor unlike."""
    if color is None:
        return np.zeros((ROWS, COLUMNS), np.uint8)
    grey = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)
    return np.asarray(cv2.resize(grey, (COLUMNS, ROWS), interpolation=cv2.INTER_AREA), np.uint8)


def gather_grids(
    depths_m: Iterable[Float32[np.ndarray, "r c"]],
    greys: Sequence[UInt8[np.ndarray, "r c"]],
    cameras: Sequence[Camera],
) -> ViewGrids:
    """Grids of all frames from those of each, `depth_grid` and `grey_grid`; depths are taken one by one."""
    scaled = [camera.scaled(COLUMNS, ROWS) for camera in cameras]
    rows = (depth_m.reshape(1, -1) for depth_m in depths_m)
    depth_m = map_rows(rows, (len(cameras), ROWS * COLUMNS), np.dtype(np.float32))
    return ViewGrids(
        depth_m.reshape(-1, ROWS, COLUMNS),
        np.array(greys, dtype=np.uint8).reshape(-1, ROWS, COLUMNS),
        np.array([[c.fx, c.fy, c.cx, c.cy] for c in scaled], dtype=float).reshape(-1, 4),
    )
