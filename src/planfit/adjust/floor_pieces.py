"""Floors that are not one level plane: pieces that lie higher or slope, found where nothing held them level.

The paper fits one plane to the floor. Ramps, split levels and floors that fall are pieces with planes of
their own. What a piece departs from the main one's height is taken off the points that were measured on it,
in camera axes: all that follows sees a level floor, and heights of cameras follow the floor as it is.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.adjust.terms.observation_models import FLOOR
from planfit.geometry import se3
from planfit.geometry.se3 import Poses
from planfit.priors import (
    FLOOR_SLOPE_MOST_SHARE,
    STAIR_RISER_MOST_M,
    SURE_SIGMAS,
    VIEW_DISTANCE_M,
    WALL_LEAN_SIGMA_DEG,
)
from planfit.segmentation import LevelPoints, WallPatches
from planfit.tracking.types import MIN_WITNESSES

CELL_M = 0.5
"""Floor points are thinned to one height a cell."""
SIGMA_M = FLOOR.sigma
"""Of the heights of cells about their piece, as of the floor term."""
_WITHIN_M = SURE_SIGMAS.value * SIGMA_M
_MIN_CELLS = 12
"""A piece is larger than this: 3 m^2."""
LEAN_SIGMA_RAD = float(np.deg2rad(WALL_LEAN_SIGMA_DEG.value))
"""Of the lean of all walls together, and of the slope of all floors."""
_MAX_PIECES = 8
_TRIALS = 300
_FOOT_M = 1.0
"""The floor that a person stands on is seen within this of where the camera is, by some frame."""
_MAX_PATCHES = 400
"""Wall patches that tell the lean, spread evenly over the scan."""
_MIN_RISE_M = 1.0
"""Patches that are seen over less tell little of it."""


@dataclass(frozen=True)
class FloorPieces:
    """Planes of the pieces of one storey's floor, in a level frame."""

    planes: Float[np.ndarray, "k 3"]
    """z = a x + b y + c (m) of each; the piece that most frames stand on is first, and has c = 0."""
    heights_where_walked_m: tuple[float, ...]
    """Of each, above the main one at the same place, where frames stand on it."""

    @property
    def slopes(self) -> tuple[float, ...]:
        """Of each, as a share; 0 of level ones."""
        return tuple(float(slope) for slope in np.hypot(self.planes[:, 0], self.planes[:, 1]))

    @property
    def n_slopes(self) -> int:
        """Pieces that are not level."""
        return int(np.count_nonzero(self.slopes))

    @property
    def is_level(self) -> bool:
        """Whether it is one level plane."""
        return len(self.planes) == 1 and self.n_slopes == 0

    def heights_m(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, " m"]:
        """Height of the piece that each point (m, the same frame) is nearest to, up or down, at its place."""
        heights = _heights(self.planes, points[:, :2])
        nearest = np.argmin(np.abs(points[:, 2] - heights), axis=0)
        return np.take_along_axis(heights, nearest[None], axis=0)[0]


@dataclass(frozen=True)
class Lean:
    """By how much walls lean: the rotation that would set all upright, as a tilt of up."""

    tilt_rad: Float[np.ndarray, "2"]
    """x and y of the direction that walls take for up; 0 where they are upright."""
    sigma_rad: float
    """Of each, by the spread of the patches alone; infinite where too few were seen."""


def lean_of_walls(walls: WallPatches, level_from_cams: Poses) -> Lean:
    """How far from upright the walls stand, by planes fitted to their patches."""
    every = max(1, len(walls) // _MAX_PATCHES)
    normals = [
        normal
        for j in range(0, len(walls), every)
        if (normal := _normal(walls, j, level_from_cams)) is not None
    ]
    if len(normals) < 10:
        return Lean(np.zeros(2), np.inf)
    found = np.array(normals)
    across, up = found[:, :2], -found[:, 2]
    weight, tilt, spread = np.ones(len(found)), np.zeros(2), 0.0
    for _ in range(10):
        root = np.sqrt(weight)
        tilt = np.linalg.lstsq(across * root[:, None], up * root, rcond=None)[0]
        off = across @ tilt - up
        spread = max(1.48 * float(np.median(np.abs(off))), 1e-4)
        weight = 1.0 / (1.0 + (off / (2.0 * spread)) ** 2)
    information = (across * weight[:, None]).T @ across
    if np.linalg.eigvalsh(information)[0] < 1.0:
        return Lean(tilt, np.inf)  # walls of one direction tell one tilt alone
    return Lean(tilt, spread * float(np.sqrt(np.trace(np.linalg.inv(information)) / 2)))


def set_upright(level_from_cams: Poses, lean: Lean) -> np.ndarray:
    """Poses turned so that walls stand upright; the same where walls do not tell."""
    if not np.isfinite(lean.sigma_rad):
        return level_from_cams
    up = np.array([*lean.tilt_rad, 1.0])
    turn = np.eye(4)
    turn[:3, :3] = se3.rotation_between(up / np.linalg.norm(up), np.array([0.0, 0.0, 1.0]))
    return turn @ level_from_cams


def find_pieces(
    floor: LevelPoints, level_from_cams: Poses, rng: np.random.Generator
) -> FloorPieces | None:
    """Planes on which the floor lies that people stand on; None where nobody was seen to stand anywhere.

    Args:
        floor: points that were labelled so.
        level_from_cams: poses that nothing held to a level floor, walls upright.
    """
    points = se3.transform_each(level_from_cams[floor.frame_idx], floor.points_cam)
    if len(points) == 0:
        return None
    xy, height_m = _cells(points)
    planes, piece_of_cell = _planes(xy, height_m, rng)
    if len(planes) == 0:
        return None
    cams = level_from_cams[:, :3, 3]
    standing = _standing_on(xy, piece_of_cell, len(planes), cams)
    above_m = cams[:, 2] - _heights(planes, cams[:, :2])
    counts = np.bincount(standing[standing >= 0], minlength=len(planes))
    if counts.max(initial=0) < MIN_WITNESSES:
        return None
    main = int(np.argmax(counts))
    carried_m = float(np.median(above_m[main, standing == main]))
    for k, plane in enumerate(planes):
        if np.hypot(plane[0], plane[1]) < SURE_SIGMAS.value * LEAN_SIGMA_RAD:
            plane[:] = 0.0, 0.0, np.median(height_m[piece_of_cell == k])
    here_m, kept, heights_m = _heights(planes, cams[:, :2]), [main], [0.0]
    for k in range(len(planes)):
        own = standing == k
        if counts[k] < MIN_WITNESSES or k == main:
            continue
        off_m = float(np.median(here_m[k, own] - here_m[main, own]))
        # A camera is carried as high over every piece; a worktop that is labelled floor is nearer to it.
        is_walked = abs(np.median(above_m[k, own]) - carried_m) < STAIR_RISER_MOST_M.value
        if is_walked and abs(off_m) >= STAIR_RISER_MOST_M.value:
            kept.append(k)
            heights_m.append(off_m)
    return FloorPieces(planes[kept] - np.array([0.0, 0.0, planes[main, 2]]), tuple(heights_m))


def flattened(floor: LevelPoints, level_from_cams: Poses, pieces: FloorPieces) -> LevelPoints:
    """Points as they would have been measured if the floor were level at the main piece's height."""
    poses = level_from_cams[floor.frame_idx]
    points = se3.transform_each(poses, floor.points_cam)
    # Up in the level frame is the third row of the rotation in camera axes.
    off = pieces.heights_m(points)[:, None] * poses[:, 2, :3]
    return replace(floor, points_cam=floor.points_cam - off)


def _heights(
    planes: Float[np.ndarray, "k 3"], xy: Float[np.ndarray, "m 2"]
) -> Float[np.ndarray, "k m"]:
    """Height (m) of each plane at each place."""
    return planes[:, :2] @ xy.T + planes[:, 2:]


def _cells(
    points: Float[np.ndarray, "m 3"],
) -> tuple[Float[np.ndarray, "c 2"], Float[np.ndarray, " c"]]:
    """Centres (m) of the cells in which floor was seen, and its median height (m) there."""
    cells, of_point = np.unique(
        np.floor(points[:, :2] / CELL_M).astype(int), axis=0, return_inverse=True
    )
    of_point = of_point.reshape(-1)
    order = np.lexsort((points[:, 2], of_point))
    start = np.searchsorted(of_point[order], np.arange(len(cells) + 1))
    middle = order[(start[:-1] + start[1:] - 1) // 2]
    return (cells + 0.5) * CELL_M, points[middle, 2]


def _planes(
    xy: Float[np.ndarray, "c 2"], height_m: Float[np.ndarray, " c"], rng: np.random.Generator
) -> tuple[Float[np.ndarray, "k 3"], Int[np.ndarray, " c"]]:
    """Planes, the largest first (RANSAC, one after the other), and the one that each cell is on; -1: none."""
    place, piece = np.column_stack([xy, np.ones(len(xy))]), np.full(len(xy), -1)
    planes: list[np.ndarray] = []
    while len(planes) < _MAX_PIECES:
        left = np.flatnonzero(piece < 0)
        if len(left) < _MIN_CELLS:
            break
        plane = _largest_plane(place[left], height_m[left], rng)
        within = np.abs(height_m[left] - place[left] @ plane) < _WITHIN_M
        if within.sum() < _MIN_CELLS:
            break
        piece[left[within]] = len(planes)
        planes.append(plane)
    return np.array(planes).reshape(-1, 3), piece


def _largest_plane(
    place: Float[np.ndarray, "c 3"], height_m: Float[np.ndarray, " c"], rng: np.random.Generator
) -> Float[np.ndarray, "3"]:
    """The plane that most cells are on, fitted to them; level ones are tried as often as others."""
    best, most = np.zeros(3), 0
    for trial in range(_TRIALS):
        k = int(rng.integers(len(place)))
        plane = np.array([0.0, 0.0, height_m[k]])
        if trial % 2:
            apart_m = np.linalg.norm(place[:, :2] - place[k, :2], axis=1)
            near = np.flatnonzero(apart_m < VIEW_DISTANCE_M.value)
            three = near[rng.integers(len(near), size=3)]
            if abs(np.linalg.det(place[three])) < CELL_M:
                continue
            plane = np.linalg.solve(place[three], height_m[three])
            if np.hypot(plane[0], plane[1]) > FLOOR_SLOPE_MOST_SHARE.value:
                continue
        n_within = int((np.abs(height_m - place @ plane) < _WITHIN_M).sum())
        if n_within > most:
            best, most = plane, n_within
    for _ in range(10):
        within = np.abs(height_m - place @ best) < _WITHIN_M
        if within.sum() < _MIN_CELLS:
            break
        best = np.linalg.lstsq(place[within], height_m[within], rcond=None)[0]
    return best


def _standing_on(
    xy: Float[np.ndarray, "c 2"],
    piece_of_cell: Int[np.ndarray, " c"],
    n_pieces: int,
    cams: Float[np.ndarray, "n 3"],
) -> Int[np.ndarray, " n"]:
    """The piece that most of the floor about each camera's foot is on; -1 where none was seen there."""
    on_piece: Bool[np.ndarray, " c"] = piece_of_cell >= 0
    standing = np.full(len(cams), -1)
    for i, cam in enumerate(cams):
        is_near = on_piece & (((xy - cam[:2]) ** 2).sum(axis=1) < _FOOT_M**2)
        counts = np.bincount(piece_of_cell[is_near], minlength=n_pieces)
        if counts.max(initial=0) > 0:
            standing[i] = int(np.argmax(counts))
    return standing


def _normal(walls: WallPatches, j: int, level_from_cams: Poses) -> Float[np.ndarray, "3"] | None:
    """Unit normal of the plane through a patch, level frame; None where the patch is low."""
    rotation = level_from_cams[walls.frame_idx[j], :3, :3]
    points = walls.points_cam[walls.start[j] : walls.start[j + 1]] @ rotation.T
    if len(points) < 40 or np.ptp(points[:, 2]) < _MIN_RISE_M:
        return None
    normal = np.zeros(3)
    for _ in range(3):
        points = points - points.mean(axis=0)
        normal = np.linalg.svd(points, full_matrices=False)[2][2]
        off = np.abs(points @ normal)
        points = points[off < max(3.7 * float(np.median(off)), 0.01)]
    return normal if np.hypot(normal[0], normal[1]) > 0.9 else None
