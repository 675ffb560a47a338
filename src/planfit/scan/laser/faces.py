"""Level pinhole cameras at the scanner, as which all stages see an instant of a laser scan.

A scanner that sees to one side has one camera, which follows its yaw; one that sees all around has four,
which look to the same sides of the building all the time. Both are level: only the scanner's place is taken
from its trajectory, whatever the axes of its rotations are.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32

from planfit.geometry import se3
from planfit.geometry.camera import Camera
from planfit.scan.laser.instants import Instants
from planfit.scan.laser.kernels import count_seen, fill_holes, splat

AXES = {"x": 0, "y": 1, "z": 2}
LEVEL_M = 0.6
"""Standard deviation of the heights of a walk over one floor, at most."""
LEVEL_SHARE = 0.2
"""The same as a share of how far the walk goes across: walks of several storeys go up and down, too."""

N_SAMPLED = 40
"""Instants by which the cameras are chosen."""
MAX_SIDE_DEG = 100.0
"""A scanner that sees no further around than this sees to one side."""
SEEN_SHARE = 0.98
"""Share of the points that its cameras show."""
MAX_TANGENT = 1.5
"""Of elevations that cameras show: 56 degrees up and down."""
MAX_WIDTH_PX, MIN_WIDTH_PX = 320, 64
"""More pixels than labels by geometry work on bring nothing; with fewer there are no normals."""
HOLE_DEG = 2.5
"""Between lines of a scanner of 16 lines are 2 degrees."""
HOLE_SPACINGS = 2.5
"""The same where points are sparse all over: neighbours of points that lie at random."""
CELL_DEG = 2.0
"""Of the grid that tells which directions a scanner sees, and what cameras show beyond these."""


@dataclass(frozen=True)
class Faces:
    """The cameras of every instant."""

    camera: Camera
    azimuths: Float[np.ndarray, " f"]
    """rad, of their optical axes, about up, from the yaw of an instant."""
    level_from_world: Float[np.ndarray, "3 3"]
    """Rotation that turns up to +z."""
    yaws: Float[np.ndarray, " k"]
    """rad, of instants."""
    hole_px: int
    """Holes up to this size are filled."""

    def cam_from_world(self, k: int, face: int) -> Float[np.ndarray, "3 3"]:
        """Rotation of a camera of the k-th instant: x right, y down, z ahead."""
        azimuth = self.azimuths[face] + self.yaws[k]
        sine, cosine = np.sin(azimuth), np.cos(azimuth)
        cam_from_level = np.array([[sine, -cosine, 0.0], [0.0, 0.0, -1.0], [cosine, sine, 0.0]])
        return cam_from_level @ self.level_from_world

    def n_seen(self, points: Float32[np.ndarray, "n 3"], k: int) -> list[int]:
        """How many of an instant's points (m, relative to its centre) each camera shows."""
        camera = self.camera
        return [
            count_seen(points, self.cam_from_world(k, face).astype(np.float32),
                       camera.fx, camera.cx, camera.cy, camera.height, camera.width)
            for face in range(len(self.azimuths))
        ]  # fmt: skip

    def depth(
        self, points: Float32[np.ndarray, "n 3"], k: int, face: int
    ) -> Float32[np.ndarray, "h w"]:
        """Depth image (m, NaN where nothing is seen) of an instant's points (m, relative to its centre)."""
        camera = self.camera
        rotation = self.cam_from_world(k, face).astype(np.float32)
        image = splat(
            points, rotation, camera.fx, camera.cx, camera.cy, camera.height, camera.width
        )
        return fill_holes(image, self.hole_px)


def choose_faces(
    instants: Instants,
    world_from_scanner: Float[np.ndarray, "k 4 4"],
    level_from_world: Float[np.ndarray, "3 3"],
) -> Faces:
    """Cameras for a scanner, by the directions that it sees.

    Args:
        instants: the scan.
        world_from_scanner: poses of its instants; rotations may be the identity throughout.
        level_from_world: rotation that turns up to +z.
    """
    yaws = _yaws(world_from_scanner[:, :3, :3], level_from_world)
    sampled = np.unique(np.linspace(0, len(instants.times) - 1, N_SAMPLED).astype(int))
    seen = [
        _directions(instants.points(k) @ level_from_world.T.astype(np.float32)) for k in sampled
    ]
    spacing = float(np.median([_spacing(*one) for one in seen]))
    azimuth = np.concatenate([one[0] - yaws[k] for one, k in zip(seen, sampled, strict=True)])
    tangent = np.concatenate([one[1] for one in seen])
    middle, span = _narrowest(azimuth)
    if span <= np.deg2rad(MAX_SIDE_DEG):
        half = 0.5 * span + np.deg2rad(CELL_DEG)
        azimuths = np.array([middle])
    else:
        # Yaws of a head that spins would turn cameras that see all sides anyway.
        yaws, half = np.zeros_like(yaws), np.deg2rad(45.0)
        azimuths = np.deg2rad([0.0, 90.0, 180.0, 270.0])
        azimuth = np.concatenate([one[0] for one in seen])
    off = np.abs(_wrap(azimuth[:, None] - azimuths[None, :])).min(axis=1)
    shown = off < half
    # A row of the image is tan(elevation) / cos(azimuth off the axis).
    rows = tangent[shown] / np.cos(off[shown])
    low, high = np.round(np.quantile(rows, [0.01, 0.99]) + np.array([-0.05, 0.05]), 2)
    low, high = max(low, -MAX_TANGENT), min(high, MAX_TANGENT)
    if not high > low:
        low, high = -MAX_TANGENT, MAX_TANGENT
    least, most = (0.5 * px / np.tan(half) for px in (MIN_WIDTH_PX, MAX_WIDTH_PX))
    focal = float(np.rint(np.clip(1.0 / spacing, least, most)))
    width = int(np.ceil(2 * focal * np.tan(half)))
    height = max(int(np.ceil(focal * (high - low))), 48)
    camera = Camera(width, height, focal, focal, 0.5 * (width - 1), focal * float(high) - 0.5)
    hole_px = int(np.ceil(max(np.deg2rad(HOLE_DEG), HOLE_SPACINGS * spacing) * focal))
    return Faces(camera, azimuths, level_from_world, yaws, hole_px)


def _wrap(angle: np.ndarray) -> np.ndarray:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def _yaws(rotations: np.ndarray, level_from_world: np.ndarray) -> np.ndarray:
    """Rotation (rad) about up since the first of rotations (k, 3, 3), whatever the body's axes are."""
    level = level_from_world @ rotations @ rotations[0].T @ level_from_world.T
    return np.arctan2(level[:, 1, 0] - level[:, 0, 1], level[:, 0, 0] + level[:, 1, 1])


def _directions(points_level: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Azimuths (rad) and tangents of elevations of points (n, 3)."""
    across = np.hypot(points_level[:, 0], points_level[:, 1])
    azimuth = np.arctan2(points_level[:, 1], points_level[:, 0]).astype(float)
    return azimuth, (points_level[:, 2] / np.maximum(across, 1e-3)).astype(float)


def _spacing(azimuth: np.ndarray, tangent: np.ndarray) -> float:
    """Angle (rad) between neighbouring points, if they lay evenly over the directions that have any."""
    elevation = np.arctan(tangent)
    cell = np.deg2rad(CELL_DEG)
    row = np.floor(elevation / cell).astype(int)
    column = np.floor(azimuth / cell).astype(int)
    _, first = np.unique(row * 1000 + column, return_index=True)
    area = np.sum(np.cos(elevation[first])) * cell**2
    return float(np.sqrt(area / len(azimuth)))


def _narrowest(azimuth: np.ndarray) -> tuple[float, float]:
    """Middle and width (rad) of the narrowest range of azimuths that most points are in."""
    counts = np.bincount(np.floor(np.rad2deg(azimuth)).astype(int) % 360, minlength=360)
    total = np.concatenate([[0], np.cumsum(np.tile(counts, 2))])
    wanted = SEEN_SHARE * counts.sum()
    # The first end at which enough points lie since each beginning.
    ends = np.searchsorted(total, total[:360] + wanted)
    k = int(np.argmin(ends - np.arange(360)))
    return np.deg2rad(0.5 * (k + ends[k])), np.deg2rad(float(ends[k] - k))


def find_up(
    centres: Float[np.ndarray, "k 3"], wanted: str
) -> tuple[Float[np.ndarray, "3 3"], list[str]]:
    """The rotation that turns up to +z, and what to tell of it: z is up, as LAS and E57 have it, unless the
    scanner's path says that another axis is.

    A path of metres along z, which stays level along x or y, is that of a cloud in the axes of a program that
    has its y up (graphics, ARKit). Of the two directions along an axis the positive one is taken.

    Args:
        centres: where the scanner was, m.
        wanted: `x`, `y` or `z`, with `-` for down; `auto` finds it.
    """
    notes = []
    if wanted == "auto":
        spread = centres.std(axis=0)
        wanted = "z"
        others = [a for a in "yx" if spread[AXES[a]] <= min(LEVEL_M, LEVEL_SHARE * spread[2])]
        if spread[2] > max(LEVEL_M, LEVEL_SHARE * spread.max()) and others:
            wanted = others[0]
            notes = [
                f"the cloud's {wanted} axis is taken as up, as the scanner's path is level along it and goes "
                f"{np.ptp(centres[:, 2]):.1f} m along z; say otherwise with --cloud-up"
            ]
    up = np.zeros(3)
    up[AXES[wanted[-1]]] = -1.0 if wanted.startswith("-") else 1.0
    return se3.rotation_between(up, np.array([0.0, 0.0, 1.0])), notes
