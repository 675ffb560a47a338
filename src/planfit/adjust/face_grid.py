"""A grid over the plan that knows which faces are near: nearest faces without trying them all."""

from dataclasses import dataclass

import numpy as np

from planfit.adjust.nearest_kernels import find_nearest, list_faces
from planfit.floorplan import Floorplan

MAX_CELLS_PER_SIDE = 400
"""Bounds the table: 160,000 cells of half the reach, or of a four-hundredth of the plan if that is more."""


@dataclass(frozen=True)
class FaceGrid:
    """Faces of a plan by cell; made by `make_face_grid`."""

    floorplan: Floorplan
    is_oriented: np.ndarray  # (n,) bool, faces that are seen from one side only
    reach_m: float
    origin: np.ndarray  # (2,) m, corner of the first cell
    cell_m: float
    shape: tuple[int, int]  # cells in x and in y
    start: np.ndarray  # (cells + 1,): faces of cell c are faces[start[c]:start[c + 1]]
    faces: np.ndarray  # (l,)

    def nearest(
        self,
        points_cam: np.ndarray,
        start: np.ndarray,
        plan_from_cams: np.ndarray,
        patch_normals: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Face (m,) of each point or -1, the face's nearest point (m, 2) m, and the gap (m, 2) m from it.

        Args:
            points_cam: (m, 3) m; patch k is points start[k]:start[k + 1].
            start: (k + 1,).
            plan_from_cams: (k, 4, 4) pose of each patch's camera.
            patch_normals: (k, 2) plan frame, towards the side that each patch was seen from.
        """
        m = len(points_cam)
        face_idx, feet, gaps = np.full(m, -1), np.zeros((m, 2)), np.zeros((m, 2))
        faces = (self._ends, self._normals, self.is_oriented)
        grid = (self.origin, self.cell_m, self.shape, self.start, self.faces, self.reach_m)
        patches = (points_cam, start, plan_from_cams, patch_normals)
        find_nearest(*patches, *faces, *grid, face_idx, feet, gaps)
        return face_idx, feet, gaps

    @property
    def _ends(self) -> np.ndarray:
        return np.ascontiguousarray(self.floorplan.ends, dtype=float)

    @property
    def _normals(self) -> np.ndarray:
        return np.ascontiguousarray(self.floorplan.normals, dtype=float)


def make_face_grid(floorplan: Floorplan, reach_m: float, oriented: bool) -> FaceGrid:
    """Sort a plan's faces into cells for nearest faces up to `reach_m` away.

    Args:
        floorplan: the plan.
        reach_m: nothing further away is found.
        oriented: whether faces whose free side is known are found from that side only.
    """
    ends = np.ascontiguousarray(floorplan.ends, dtype=float)
    low = ends.min(axis=(0, 1)) - reach_m
    extent = ends.max(axis=(0, 1)) + reach_m - low
    cell_m = max(reach_m / 2, float(extent.max()) / MAX_CELLS_PER_SIDE)
    nx, ny = (int(n) + 1 for n in extent // cell_m)
    start, faces = list_faces(ends, low, cell_m, (nx, ny), reach_m)
    is_oriented = floorplan.is_oriented & oriented
    return FaceGrid(floorplan, is_oriented, reach_m, low, cell_m, (nx, ny), start, faces)
