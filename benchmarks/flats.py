"""Flats with niches and parallel layers of wall, and walks through them, made without images.

What a camera sees of a plan is found by rays: a run of rays that meet one face is a wall patch. Every room
has pilasters and niches 0.1 to 0.2 m deep, so that a scan a decimetre off finds a face wherever it looks.
"""

from dataclasses import dataclass

import numpy as np
from problems import EYE_M, NOISE_M, Problem

from planfit.adjust import Measurements
from planfit.adjust.association import Association
from planfit.floorplan import Floorplan
from planfit.geometry import se3, segments
from planfit.matching import Matches
from planfit.scan.odometry import OdometryOptions, make_odometry
from planfit.segmentation import (
    LevelPoints,
    Structure,
    WallPatches,
    no_level_points,
    no_wall_patches,
)
from planfit.synth import DriftOptions, drift_poses

WALL_M, DOOR_M = 0.2, 0.9
N_RAYS, FIELD_DEG, REACH_M = 96, 70.0, 5.0
MIN_RAYS, POINTS_PER_PATCH = 4, 120
DEPTH_M = 0.01
"""Error of depth that all points of a wall patch share."""


@dataclass(frozen=True)
class FlatOptions:
    """Size of a flat, and how it is walked."""

    n_rooms: tuple[int, int] = (2, 2)
    room_m: tuple[float, float] = (4.2, 3.6)
    step_m: float = 0.3
    loops: bool = True
    """Whether places that are seen again are matched."""
    neighbours: int = 1
    """Frames ahead that each frame is matched with; 0: no matches at all."""
    round_share: float = 0.22
    """Half the width of the round in each room, as a share of the room."""
    depth_sigma_share: float = 0.0
    """Error of depth that a view of a wall shares, as a share of its distance: reflections between walls,
    which time of flight takes for distance. To it comes 1 cm."""


def make_flat(
    seed: int, percent: float, options: FlatOptions | None = None, clutter_share: float = 0.1
) -> Problem:
    """A walk through a flat and back; drift `percent` of the distance walked, at the end.

    `clutter_share` of the patches stand off their walls by 0.1 to 0.6 m, as cupboards do.
    """
    chosen, rng = options or FlatOptions(), np.random.default_rng(seed)
    floorplan = _flat(chosen, rng)
    true = _walk(chosen, rng)
    n = len(true)
    walked_m = chosen.step_m * n
    drift = DriftOptions(
        yaw_deg=2 * percent / np.sqrt(n), translation_m=percent / 100 * walked_m / np.sqrt(2 * n)
    )
    recorded = drift_poses(true, drift, rng, np.array([0.0, 0.0, 1.0]))
    structure, face_idx = see_walls(true, floorplan, clutter_share, rng, chosen.depth_sigma_share)
    matches = _matches(true, chosen, rng)
    odometry = make_odometry(recorded, OdometryOptions())
    return Problem(
        Measurements(matches, structure, odometry),
        floorplan,
        Association(face_idx, np.zeros(len(face_idx))),
        true,
        recorded,
    )


def _flat(options: FlatOptions, rng: np.random.Generator) -> Floorplan:
    (nx, ny), (width, depth) = options.n_rooms, options.room_m
    faces: list[np.ndarray] = []
    for i in range(nx):
        for j in range(ny):
            low = np.array([i * (width + WALL_M), j * (depth + WALL_M)])
            size = np.array([width, depth])
            corners = low + np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * size
            has_door = (
                j > 0 and i in (0, nx - 1),
                i + 1 < nx,
                j + 1 < ny and i in (0, nx - 1),
                i > 0,
            )
            for side in range(4):
                faces += _side(corners[side], corners[(side + 1) % 4], has_door[side], rng)
    ends = np.array(faces)
    along = segments.directions(ends)
    # Rooms are walked round anticlockwise: free space is on the left of every face.
    normals = np.stack([-along[:, 1], along[:, 0]], axis=1)
    return Floorplan.from_segments(ends, normals, name="flat")


def _side(first: np.ndarray, last: np.ndarray, has_door: bool, rng: np.random.Generator) -> list:
    """Faces of one side of a room, from corner to corner: plain wall, pilasters and niches, a door."""
    length = float(np.linalg.norm(last - first))
    along = (last - first) / length
    across = np.array([-along[1], along[0]])
    cuts: list[tuple[float, float, float]] = []  # begin, end, how far into the room
    spans = [(0.3, length / 2 - DOOR_M / 2 - 0.2), (length / 2 + DOOR_M / 2 + 0.2, length - 0.3)]
    for begin, end in spans:
        wide = rng.uniform(0.5, end - begin)
        at = rng.uniform(begin, end - wide)
        if rng.random() < 0.7:
            cuts.append((at, at + wide, rng.uniform(0.1, 0.2)))
    if has_door:
        middle = length / 2
        cuts.append((middle - DOOR_M / 2, middle + DOOR_M / 2, np.nan))
    faces, at = [], 0.0
    for begin, end, into in sorted(cuts):
        faces.append((first + at * along, first + begin * along))
        a, b = first + begin * along, first + end * along
        if np.isnan(into):  # the jambs, to the middle of the wall
            faces += [(a, a - WALL_M / 2 * across), (b - WALL_M / 2 * across, b)]
        else:
            c, d = a + into * across, b + into * across
            faces += [(a, c), (c, d), (d, b)]
        at = end
    faces.append((first + at * along, last))
    return faces


def _walk(options: FlatOptions, rng: np.random.Generator) -> np.ndarray:
    """True poses (n, 4, 4): through the rooms in a ring, a round in each, and the ring again."""
    (nx, ny), (width, depth) = options.n_rooms, options.room_m
    ring = [(i, 0) for i in range(nx)] + [(i, ny - 1) for i in range(nx - 1, -1, -1)]
    centres = np.array(ring) * (np.array([width, depth]) + WALL_M) + np.array([width, depth]) / 2
    half = options.round_share * np.array([width, depth])
    stops = []
    for lap in range(2):
        for k, centre in enumerate(centres):
            turn = 1 if k % 2 else -1
            round_ = np.array(
                [[0, 0], [-1, -1 * turn], [1, -1 * turn], [1, turn], [-1, turn], [0, 0]]
            )
            stops += list(centre + round_[: 6 if lap == 0 else 1] * half)
    stops.append(centres[0])
    path = np.array(stops, dtype=float)
    lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
    at = np.concatenate([[0.0], np.cumsum(lengths)])
    where = np.arange(0.0, at[-1], options.step_m)
    xy = np.stack([np.interp(where, at, path[:, k]) for k in range(2)], axis=1)
    kernel = np.ones(5) / 5
    smooth = np.stack(
        [np.convolve(np.pad(xy[:, k], 2, "edge"), kernel, "valid") for k in range(2)], 1
    )
    ahead = np.gradient(smooth, axis=0)
    heading = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
    heading = np.convolve(np.pad(heading, 4, "edge"), np.ones(9) / 9, "valid")
    look = heading + 0.6 * np.sin(np.arange(len(smooth)) / 6.0 + rng.uniform(0, 6))
    n = len(smooth)
    right = np.stack([np.sin(look), -np.cos(look), np.zeros(n)], axis=1)
    forward = np.stack([np.cos(look), np.sin(look), np.full(n, -0.2)], axis=1)
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    rotation = np.stack([right, np.cross(forward, right), forward], axis=2)
    return se3.make_transform(rotation, np.column_stack([smooth, np.full(n, EYE_M)]))


def see_walls(
    true: np.ndarray,
    floorplan: Floorplan,
    clutter_share: float,
    rng: np.random.Generator,
    depth_sigma_share: float = 0.0,
) -> tuple[Structure, np.ndarray]:
    """Floor and wall patches that cameras at true poses see, and the face of each patch (-1: clutter)."""
    face_idx, frame_idx, ends = _seen_patches(true, floorplan)
    away_m = np.linalg.norm(ends.mean(axis=1) - true[frame_idx, :2, 3], axis=1)
    sigmas_m = np.hypot(DEPTH_M, depth_sigma_share * away_m)
    return _structure_of(true, floorplan, face_idx, frame_idx, ends, sigmas_m, clutter_share, rng)


def _seen_patches(
    true: np.ndarray, floorplan: Floorplan
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Face (k,), camera (k,) and ends (k, 2, 2) m of each run of rays that meet one face."""
    patches, frames, faces = [], [], []
    for i in range(len(true)):
        eye, ahead = true[i, :2, 3], true[i, :2, 2]
        angle = np.arctan2(ahead[1], ahead[0]) + np.deg2rad(
            np.linspace(-0.5, 0.5, N_RAYS) * FIELD_DEG
        )
        rays = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        face, distance = _first_hits(eye, rays, floorplan)
        runs = np.split(np.arange(N_RAYS), np.flatnonzero(np.diff(face)) + 1)
        for run in runs:
            if face[run[0]] < 0 or len(run) < MIN_RAYS:
                continue
            spots = eye + rays[run] * distance[run, None]
            if np.linalg.norm(spots[-1] - spots[0]) < 0.25:
                continue
            patches.append(spots[[0, -1]])
            frames.append(i)
            faces.append(face[run[0]])
    return np.array(faces), np.array(frames), np.array(patches)


def _structure_of(
    true: np.ndarray,
    floorplan: Floorplan,
    face_idx: np.ndarray,
    frame_idx: np.ndarray,
    ends: np.ndarray,
    sigmas_m: np.ndarray,
    clutter_share: float,
    rng: np.random.Generator,
) -> tuple[Structure, np.ndarray]:
    """Points on floor and patches as a depth camera errs; some patches are clutter before their wall."""
    n = len(true)
    normals = floorplan.normals[face_idx]
    is_clutter = rng.random(len(face_idx)) < clutter_share
    off = np.where(is_clutter, rng.uniform(0.1, 0.6, len(face_idx)), 0.0)
    share = rng.random((len(ends), POINTS_PER_PATCH, 1))
    share[:, 0], share[:, 1] = 0.0, 1.0
    spots = ends[:, :1] * (1 - share) + ends[:, 1:] * share
    # Each patch errs as a whole (depth calibration), its points by 2 cm.
    across = off[:, None] + sigmas_m[:, None] * rng.standard_normal((len(ends), 1))
    across = across + NOISE_M * rng.standard_normal((len(ends), POINTS_PER_PATCH))
    spots = spots + across[..., None] * normals[:, None]
    wall = np.concatenate([spots, rng.uniform(0.2, 2.5, (*spots.shape[:2], 1))], axis=-1)
    cams_from_plan = se3.inverse(true)
    points_cam = se3.transform(cams_from_plan[frame_idx], wall)
    upright = np.concatenate([normals, np.zeros((len(normals), 1))], axis=1)
    floor = np.zeros((n, 60, 3))
    floor[..., :2] = true[:, None, :2, 3] + rng.uniform(-3, 3, (n, 60, 2))
    floor[..., 2] = NOISE_M * rng.standard_normal((n, 60))
    structure = Structure(
        floor=LevelPoints(
            se3.transform(cams_from_plan, floor).reshape(-1, 3).astype(np.float32),
            np.arange(n + 1) * 60,
        ),
        floor_heights_m=np.zeros(n),
        walls=WallPatches(
            points_cam=points_cam.reshape(-1, 3).astype(np.float32),
            start=np.arange(len(ends) + 1) * POINTS_PER_PATCH,
            frame_idx=frame_idx,
            normals_cam=np.einsum("kab,kb->ka", cams_from_plan[frame_idx][:, :3, :3], upright),
            ends_cam=points_cam[:, :2].astype(np.float32),
        ),
        unassigned_points_cam=np.zeros((0, 3)),
        unassigned_frame_idx=np.zeros(0, dtype=int),
        ceiling=no_level_points(n),
        columns=no_wall_patches(),
        back_end="masks",
        floor_height_m=0.0,
    )
    return structure, np.where(is_clutter, -1, face_idx)


def _first_hits(
    eye: np.ndarray, rays: np.ndarray, floorplan: Floorplan
) -> tuple[np.ndarray, np.ndarray]:
    """Face that each ray meets first from its free side (-1: none within reach), and the distance m."""
    first, along = floorplan.ends[:, 0], floorplan.ends[:, 1] - floorplan.ends[:, 0]
    # eye + t ray = first + u along: Cramer's rule, rays by faces.
    cross = rays[:, None, 0] * along[None, :, 1] - rays[:, None, 1] * along[None, :, 0]
    gap = first - eye
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (gap[:, 0] * along[:, 1] - gap[:, 1] * along[:, 0])[None] / cross
        u = (gap[None, :, 0] * rays[:, None, 1] - gap[None, :, 1] * rays[:, None, 0]) / cross
    hits = (t > 0.05) & (t < REACH_M) & (u >= 0) & (u <= 1)
    t = np.where(hits, t, np.inf)
    face = np.argmin(t, axis=1)
    distance = t[np.arange(len(rays)), face]
    return np.where(np.isfinite(distance), face, -1), distance


def _matches(true: np.ndarray, options: FlatOptions, rng: np.random.Generator) -> Matches:
    """Matches of neighbours, and of views that look at the same from nearly the same spot."""
    n, per_pair = len(true), 15
    pairs = [(i, i + k) for k in range(1, options.neighbours + 1) for i in range(n - k)]
    if options.loops and options.neighbours:
        gap = np.linalg.norm(true[:, None, :2, 3] - true[None, :, :2, 3], axis=-1)
        cosine = (
            true[:, :2, 2]
            @ true[:, :2, 2].T
            / np.outer(*[np.linalg.norm(true[:, :2, 2], axis=1)] * 2)
        )
        apart = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
        far = np.argwhere((gap < 0.6) & (cosine > 0.9) & (apart > 40))
        far = far[far[:, 0] < far[:, 1]]
        pairs += [tuple(p) for p in far[:: max(1, len(far) // 40)]]
    chosen = np.array(pairs, dtype=int).reshape(-1, 2)
    m = len(chosen) * per_pair
    points_b = np.stack(
        [rng.uniform(-1.5, 1.5, m), rng.uniform(-1, 1, m), rng.uniform(1.0, 4.0, m)], axis=1
    )
    a_from_b = se3.inverse(true[chosen[:, 0]]) @ true[chosen[:, 1]]
    points_a = se3.transform(a_from_b, points_b.reshape(len(chosen), per_pair, 3)).reshape(m, 3)
    noise = NOISE_M * rng.standard_normal((2, m, 3))
    return Matches(
        pairs=chosen,
        start=np.arange(len(chosen) + 1) * per_pair,
        points_a=(points_a + noise[0]).astype(np.float32),
        points_b=(points_b + noise[1]).astype(np.float32),
        sigma=np.full(m, np.sqrt(2) * NOISE_M, dtype=np.float32),
        n_tried=len(chosen),
        n_keypoints=m,
    )
