"""Adjustment problems of any size, with known truth, made without images.

A walk goes round a building's ring corridor, lap after lap, so that every place is seen again a lap
later. Matches, floor points and wall patches are drawn with noise at the true poses; the recorded
poses have drifted.
"""

from dataclasses import dataclass

import numpy as np

from planfit.adjust import Measurements
from planfit.adjust.association import Association
from planfit.floorplan import Floorplan
from planfit.geometry import se3
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

STEP_M = 0.1
EYE_M = 1.5
NOISE_M = 0.02


@dataclass(frozen=True)
class Problem:
    """Measurements, their truth, and where a solve begins."""

    measurements: Measurements
    floorplan: Floorplan
    association: Association
    true_plan_from_cams: np.ndarray
    initial_plan_from_cams: np.ndarray


def make_problem(
    n_frames: int,
    seed: int = 0,
    frames_per_lap: int = 2500,
    neighbours: int = 4,
    revisits: int = 1,
    matches_per_pair: int = 100,
    points_per_frame: int = 2000,
    drift: DriftOptions | None = None,
    face_m: float | None = None,
) -> Problem:
    """A problem of `n_frames`; each frame is matched with twice `neighbours` + `revisits` others."""
    rng = np.random.default_rng(seed)
    frames_per_lap = min(frames_per_lap, n_frames)
    side_m = frames_per_lap * STEP_M / 4
    floorplan = _ring_corridor(side_m, face_m or side_m)
    true = _walk(n_frames, frames_per_lap, side_m, rng)
    up = np.array([0.0, 0.0, 1.0])
    drift = drift or DriftOptions(yaw_deg=0.02, translation_m=0.004)
    recorded = drift_poses(true, drift, rng, up)
    matches = _matches(true, frames_per_lap, neighbours, revisits, matches_per_pair, rng)
    structure, face_idx = _structure(true, floorplan, points_per_frame, rng)
    return Problem(
        Measurements(matches, structure, make_odometry(recorded, OdometryOptions())),
        floorplan,
        Association(face_idx, np.zeros(len(face_idx))),
        true,
        recorded,
    )


def _ring_corridor(side_m: float, face_m: float) -> Floorplan:
    """A square corridor 3 m wide about the walk, walls 0.2 m thick, drawn in faces of this length."""
    patches = []
    for out in (-1.7, -1.5, 1.5, 1.7):
        low, high = -out, side_m + out
        corners = np.array([[low, low], [high, low], [high, high], [low, high]])
        for first, last in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            share = np.linspace(0, 1, max(1, round(side_m / face_m)) + 1)[:, None]
            cuts = first * (1 - share) + last * share
            patches.append(np.stack([cuts[:-1], cuts[1:]], axis=1))
    return Floorplan.from_segments(np.concatenate(patches), name="ring corridor")


def _walk(n: int, frames_per_lap: int, side_m: float, rng: np.random.Generator) -> np.ndarray:
    """True poses (n, 4, 4), plan from camera: along the corridor, looking a little to the side."""
    at = (np.arange(n) % frames_per_lap) * STEP_M
    side, along = np.divmod(at, side_m)
    side = side.astype(int) % 4
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * side_m
    heads = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]], dtype=float)
    xy = corners[side] + heads[side] * along[:, None] + rng.normal(size=(n, 2)) * 0.05
    look = np.arctan2(heads[side, 1], heads[side, 0]) + 0.5 * np.sin(np.arange(n) / 7.0)
    right = np.stack([np.sin(look), -np.cos(look), np.zeros(n)], axis=1)
    ahead = np.stack([np.cos(look), np.sin(look), np.full(n, -0.2)], axis=1)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    rotation = np.stack([right, np.cross(ahead, right), ahead], axis=2)
    return se3.make_transform(rotation, np.column_stack([xy, np.full(n, EYE_M)]))


def _matches(
    true: np.ndarray,
    frames_per_lap: int,
    neighbours: int,
    revisits: int,
    per_pair: int,
    rng: np.random.Generator,
) -> Matches:
    n = len(true)
    ahead = [(np.arange(n - k), np.arange(k, n)) for k in range(1, neighbours + 1) if k < n]
    ahead += [
        (np.arange(n - lap), np.arange(lap, n))
        for lap in (frames_per_lap + k for k in range(revisits))
        if lap < n
    ]
    pairs = np.concatenate([np.stack(p, axis=1) for p in ahead])
    m = len(pairs) * per_pair
    points_b = np.stack(
        [rng.uniform(-2, 2, m), rng.uniform(-1, 1, m), rng.uniform(1.5, 6, m)], axis=1
    ).astype(np.float32)
    a_from_b = (se3.inverse(true[pairs[:, 0]]) @ true[pairs[:, 1]]).astype(np.float32)
    points_a = se3.transform(a_from_b, points_b.reshape(len(pairs), per_pair, 3)).reshape(m, 3)
    for points in (points_a, points_b):
        points += NOISE_M * rng.standard_normal((m, 3), dtype=np.float32)
    return Matches(
        pairs=pairs,
        start=np.arange(len(pairs) + 1) * per_pair,
        points_a=points_a,
        points_b=points_b,
        sigma=np.full(m, np.sqrt(2) * NOISE_M, dtype=np.float32),
        n_tried=len(pairs),
        n_keypoints=m,
    )


def _structure(
    true: np.ndarray, floorplan: Floorplan, per_frame: int, rng: np.random.Generator
) -> tuple[Structure, np.ndarray]:
    """Floor points ahead, and the two nearest faces of each frame as wall patches."""
    n, half, quarter = len(true), per_frame // 2, per_frame // 4
    xy = true[:, :2, 3]
    cams_from_plan = se3.inverse(true)
    floor = np.zeros((n, half, 3), dtype=np.float32)
    floor[..., :2] = xy[:, None] + rng.uniform(-3, 3, (n, half, 2))
    floor[..., 2] = NOISE_M * rng.standard_normal((n, half), dtype=np.float32)
    distance = xy @ floorplan.normals.T - floorplan.offsets
    along = (floorplan.ends[:, 1] - floorplan.ends[:, 0]) / floorplan.lengths[:, None]
    at = xy @ along.T - np.sum(floorplan.ends[:, 0] * along, axis=1)
    beside = (at > 1.0) & (at < floorplan.lengths - 1.0) & (distance > 0)
    faces = np.argsort(np.where(beside, distance, np.inf), axis=1)[:, :2]
    faces = np.sort(faces, axis=1)
    middle = np.take_along_axis(at, faces, axis=1)
    offset = rng.uniform(-1.0, 1.0, (n, 2, quarter))
    spot = (middle[..., None] + offset)[..., None] * along[faces][:, :, None]
    spot = spot + floorplan.ends[faces, 0][:, :, None]
    spot = (
        spot
        + NOISE_M * rng.standard_normal((n, 2, quarter, 1)) * (floorplan.normals[faces][:, :, None])
    )
    height = rng.uniform(0.2, 2.5, (n, 2, quarter, 1))
    wall = np.concatenate([spot, height], axis=-1)
    rotation = cams_from_plan[:, None, :3, :3]
    normals = np.concatenate([floorplan.normals[faces], np.zeros((n, 2, 1))], axis=-1)
    edge = np.stack([wall[:, :, 0], wall[:, :, 1]], axis=2)
    structure = Structure(
        floor=LevelPoints(_to_cam(cams_from_plan, floor), np.arange(n + 1) * half),
        floor_heights_m=np.zeros(n),
        walls=WallPatches(
            points_cam=_to_cam(cams_from_plan, wall.reshape(n, 2 * quarter, 3)),
            start=np.arange(2 * n + 1) * quarter,
            frame_idx=np.repeat(np.arange(n), 2),
            normals_cam=(rotation @ normals[..., None])[..., 0].reshape(2 * n, 3),
            ends_cam=_to_cam(cams_from_plan, edge.reshape(n, 4, 3)).reshape(2 * n, 2, 3),
        ),
        unassigned_points_cam=np.zeros((0, 3)),
        unassigned_frame_idx=np.zeros(0, dtype=int),
        ceiling=no_level_points(n),
        columns=no_wall_patches(),
        back_end="masks",
        floor_height_m=0.0,
    )
    return structure, faces.reshape(-1)


def _to_cam(cams_from_plan: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (n, k, 3) of the plan in camera frames, as one list (n k, 3) float32."""
    return se3.transform(cams_from_plan, points).reshape(-1, 3).astype(np.float32)
