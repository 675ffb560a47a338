"""Small worlds whose truth is known: a box room to look at, and a room's worth of measurements."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from types import ModuleType

import cv2
import numpy as np
import pytest

from planfit.adjust import AdjustOptions, Measurements, PlanCorrespondences, build_problem
from planfit.adjust.association import Association
from planfit.floorplan import Floorplan
from planfit.geometry import se3, segments
from planfit.geometry.camera import Camera
from planfit.matching import Matches
from planfit.scan import Scan
from planfit.scan.odometry import Odometry, OdometryOptions, make_odometry
from planfit.segmentation import (
    LevelPoints,
    Structure,
    WallPatches,
    no_level_points,
    no_wall_patches,
)

CAMERA = Camera(160, 120, 130.0, 130.0, 79.5, 59.5)


@contextmanager
def with_constants(module: ModuleType, **values: float) -> Iterator[None]:
    """Other values of constants of a module for a while; names in lower case."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in values.items():
            patch.setattr(module, name.upper(), value)
        yield


def look(position, yaw_deg, pitch_deg=0.0, roll_deg=0.0):
    """target_from_cam (4, 4) of a camera in a frame with z up, looking along yaw, pitched down."""
    yaw, pitch = np.deg2rad(yaw_deg), np.deg2rad(pitch_deg)
    forward = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)])
    right = np.array([np.sin(yaw), -np.cos(yaw), 0.0])
    upright = np.stack([right, np.cross(forward, right), forward], axis=1)
    return se3.make_transform(
        upright @ se3.exp_so3(np.deg2rad([0.0, 0.0, roll_deg])), np.asarray(position, dtype=float)
    )


def random_transforms(rng, n, max_rotation=np.pi, extent_m=5.0):
    """Transforms (n, 4, 4) rotated by up to `max_rotation` rad."""
    axes = rng.normal(size=(n, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return se3.make_transform(
        se3.exp_so3(axes * rng.uniform(0, max_rotation, (n, 1))),
        rng.uniform(-extent_m, extent_m, (n, 3)),
    )


def nudged(rng, transforms, rotation_deg, translation_m):
    """Each transform moved by Gaussian tangent vectors."""
    delta = rng.normal(size=(len(transforms), 6))
    return se3.retract(transforms, delta * ([np.deg2rad(rotation_deg)] * 3 + [translation_m] * 3))


def room_plan(width_m=6.0, depth_m=4.0, name="room"):
    """The four inner faces of a rectangular room from the origin, each looking into the room."""
    corners = np.array([[0, 0], [width_m, 0], [width_m, depth_m], [0, depth_m]], dtype=float)
    return faces_plan(corners, name)


def faces_plan(corners, name="plan"):
    """Faces along a counter-clockwise polygon, looking inwards."""
    corners = np.asarray(corners, dtype=float)
    ends = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
    return Floorplan(name, ends, segments.left_normals(ends), np.ones(len(ends), dtype=bool))


def moved_plan(floorplan, transform):
    """The plan moved by a yaw transform (4, 4)."""
    rotation = transform[:2, :2]
    return replace(
        floorplan,
        ends=floorplan.ends @ rotation.T + transform[:2, 3],
        normals=floorplan.normals @ rotation.T,
    )


def make_structure(plan_from_cams, floor=(), patches=()):
    """Structure from plan-frame truth.

    Args:
        plan_from_cams: (n, 4, 4) true poses.
        floor: pairs (frame, points (k, 3)).
        patches: triples (frame, points (k, 3), normal (2,)); sorted by frame here.
    """
    cams_from_plan = se3.inverse(np.asarray(plan_from_cams))
    n = len(cams_from_plan)
    floors = [np.zeros((0, 3))] * n
    for i, points in floor:
        floors[i] = se3.transform(cams_from_plan[i], points)
    patches = sorted(patches, key=lambda patch: patch[0])
    points, normals, ends = [np.zeros((0, 3))], [], []
    for i, on_wall, normal in patches:
        points.append(se3.transform(cams_from_plan[i], on_wall))
        normals.append(cams_from_plan[i][:3, :3] @ [*normal, 0.0])
        along = np.array([-normal[1], normal[0]])
        at = on_wall[:, :2] @ along
        both = on_wall[[at.argmin(), at.argmax()]].copy()
        both[:, 2] = on_wall[:, 2].mean()
        ends.append(se3.transform(cams_from_plan[i], both))
    return Structure(
        floor=LevelPoints(np.concatenate(floors), np.cumsum([0, *(len(f) for f in floors)])),
        floor_heights_m=np.zeros(n),
        walls=WallPatches(
            points_cam=np.concatenate(points),
            start=np.cumsum([0, *(len(p) for p in points[1:])]),
            frame_idx=np.array([i for i, _, _ in patches], dtype=int),
            normals_cam=np.array(normals).reshape(-1, 3),
            ends_cam=np.array(ends).reshape(-1, 2, 3),
        ),
        unassigned_points_cam=np.zeros((0, 3)),
        unassigned_frame_idx=np.zeros(0, dtype=int),
        ceiling=no_level_points(n),
        columns=no_wall_patches(),
        back_end="masks",
        floor_height_m=0.0,
    )


def make_matches(plan_from_cams, pairs, points_plan, sigma_m=0.03):
    """Exact matches: the same points (m, 3), seen from both cameras of each pair."""
    cams_from_plan = se3.inverse(np.asarray(plan_from_cams))
    pairs = np.array(pairs, dtype=int).reshape(-1, 2)
    a = [se3.transform(cams_from_plan[i], points_plan) for i, _ in pairs]
    b = [se3.transform(cams_from_plan[j], points_plan) for _, j in pairs]
    n = len(points_plan)
    return Matches(
        pairs=pairs,
        start=np.arange(len(pairs) + 1) * n,
        points_a=np.concatenate([*a, np.zeros((0, 3))]),
        points_b=np.concatenate([*b, np.zeros((0, 3))]),
        sigma=np.full(n * len(pairs), sigma_m),
        n_tried=len(pairs),
        n_keypoints=n * len(plan_from_cams),
    )


def make_ties(floorplan, association, n_frames):
    """What walls alone hold a scan to."""
    columns = Association(np.zeros(0, dtype=int), np.zeros(0))
    return PlanCorrespondences(floorplan, association, columns, np.full(n_frames, np.nan), 0.5)


class NoFiles:
    """Files of a scan that nobody should ask; tests give those that they need."""

    def color(self, frame_idx):
        raise AssertionError("colour was not expected to be read")

    def depth(self, frame_idx):
        raise AssertionError("depth was not expected to be read")

    def labels(self, frame_idx):
        raise AssertionError("labels were not expected to be read")

    def write_poses(self, directory, world_from_cams, frame_idx=None):
        raise AssertionError("poses were not expected to be written")


@dataclass(frozen=True)
class World:
    """A walk round a room, with everything the adjustment is given, all of it exact."""

    plan_from_cams: np.ndarray
    floorplan: Floorplan
    structure: Structure
    matches: Matches
    odometry: Odometry

    @property
    def measurements(self):
        return Measurements(self.matches, self.structure, self.odometry)

    @property
    def scan_terms(self):
        """Points, floor and odometry with the default options."""
        return build_problem(self.measurements, AdjustOptions(), self.plan_from_cams).scan_terms


def make_world(rng, n=8, n_points=80):
    """Cameras on a circle in a 6 x 4 m room; each sees floor and two walls; a ring of matches."""
    floorplan = room_plan()
    angle = np.arange(n) * 360.0 / n
    poses = np.stack(
        [
            look([3 + 1.5 * np.cos(np.deg2rad(a)), 2 + np.sin(np.deg2rad(a)), 1.5], a + 40, 15)
            for a in angle
        ]
    )
    floor, patches = [], []
    for i in range(n):
        points = rng.uniform([0.5, 0.5, 0], [5.5, 3.5, 0], (n_points, 3))
        floor.append((i, points))
        for wall in (i % 4, (i + 1) % 4):
            first, last = floorplan.ends[wall]
            t = rng.uniform(0.2, 0.8, (n_points, 1))
            xy = first * (1 - t) + last * t
            on_wall = np.column_stack([xy, rng.uniform(0.3, 2.5, n_points)])
            patches.append((i, on_wall, floorplan.normals[wall]))
    points = rng.uniform([0, 0, 0], [6, 4, 2.5], (25, 3))
    pairs = [(i, i + 1) for i in range(n - 1)] + [(0, n - 1)]
    return World(
        poses,
        floorplan,
        make_structure(poses, floor, patches),
        make_matches(poses, pairs, points),
        make_odometry(poses, OdometryOptions()),
    )


def gradient_by_differences(cost, poses, step=1e-6):
    """Central differences (n, 6) of a cost along the tangent of every pose."""
    result = np.zeros((len(poses), 6))
    for i in range(len(poses)):
        for axis in range(6):
            delta = np.zeros((len(poses), 6))
            delta[i, axis] = step
            high, low = cost(se3.retract(poses, delta)), cost(se3.retract(poses, -delta))
            result[i, axis] = (high - low) / (2 * step)
    return result


def jacobian_by_differences(residuals, poses, step=1e-6):
    """Central differences (m, 6 n) of residuals (m,) along the tangent of every pose."""
    columns = []
    for i in range(len(poses)):
        for axis in range(6):
            delta = np.zeros((len(poses), 6))
            delta[i, axis] = step
            high, low = residuals(se3.retract(poses, delta)), residuals(se3.retract(poses, -delta))
            columns.append((high - low).ravel() / (2 * step))
    return np.stack(columns, axis=1)


def position_rms_m(poses, true_poses):
    gap = poses[:, :3, 3] - true_poses[:, :3, 3]
    return float(np.sqrt(np.mean(np.sum(gap**2, axis=1))))


class RoomFiles:
    """Images of a box room [0, size] with boxes in it, ray-cast; optional holes and noise."""

    def __init__(self, world_from_cams, room_from_world, size_m, boxes, camera, noise_m, holes):
        self._room_from_cams = room_from_world @ world_from_cams
        self._size, self._boxes, self._camera = np.asarray(size_m, dtype=float), boxes, camera
        self._noise_m, self._holes = noise_m, holes
        noise = np.random.default_rng(5).random((6, 400, 400)).astype(np.float32)
        self._textures = [cv2.GaussianBlur(t, (0, 0), 2.0) for t in noise]

    def _cast(self, i):
        rows, columns = np.mgrid[: self._camera.height, : self._camera.width]
        rays = self._camera.rays(np.stack([columns.ravel(), rows.ravel()], axis=1))
        pose = self._room_from_cams[i]
        direction, origin = rays @ pose[:3, :3].T, pose[:3, 3]
        direction = np.where(np.abs(direction) < 1e-12, 1e-12, direction)
        # z of a ray is one, so the way along it is the depth.
        exits = np.maximum(-origin / direction, (self._size - origin) / direction)
        depth = exits.min(axis=1)
        for low, high in self._boxes:
            a, b = (np.array(low) - origin) / direction, (np.array(high) - origin) / direction
            enter, leave = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
            depth = np.where((enter < leave) & (enter > 0) & (enter < depth), enter, depth)
        return depth, origin + depth[:, None] * direction, exits.argmin(axis=1)

    def depth(self, frame_idx):
        depth, _, _ = self._cast(frame_idx)
        noise = np.random.default_rng([9, frame_idx]).normal(size=depth.shape)
        depth = (depth + self._noise_m * noise).reshape(self._camera.height, self._camera.width)
        for row, column in self._holes:
            depth[row, column] = np.nan
        return depth.astype(np.float32)

    def color(self, frame_idx):
        _, points, axis = self._cast(frame_idx)
        grey = np.zeros(len(points), dtype=np.float32)
        for a in range(3):
            for side in range(2):
                on = (axis == a) & ((points[:, a] > self._size[a] / 2) == bool(side))
                uv = np.delete(points[on], a, axis=1).astype(np.float32) * 50.0
                if len(uv):
                    texture = self._textures[2 * a + side]
                    value = cv2.remap(texture, uv[:, 0], uv[:, 1], cv2.INTER_LINEAR)
                    grey[on] = value.ravel()
        grey = np.clip((grey - 0.5) * 1200 + 128, 0, 255).astype(np.uint8)
        image = grey.reshape(self._camera.height, self._camera.width)
        return np.repeat(image[..., None], 3, axis=2)

    def labels(self, _):
        raise AssertionError("this scan has no labels")

    def write_poses(self, _, __):
        raise AssertionError("not asked for")


def room_scan(
    room_from_cams,
    room_from_world=None,
    size_m=(6.0, 4.0, 2.6),
    boxes=(),
    camera=CAMERA,
    noise_m=0.0,
    holes=(),
    fingerprint="room",
):
    """A scan of a box room without masks and without recorded gravity."""
    room_from_world = np.eye(4) if room_from_world is None else room_from_world
    world_from_cams = se3.inverse(room_from_world) @ np.asarray(room_from_cams)
    n = len(world_from_cams)
    return Scan(
        name="room",
        frame_ids=tuple(f"{i:04d}" for i in range(n)),
        timestamps=np.arange(n, dtype=float),
        cameras=(camera,) * n,
        world_from_cams=world_from_cams,
        files=RoomFiles(world_from_cams, room_from_world, size_m, boxes, camera, noise_m, holes),
        fingerprint=fingerprint,
    )


def twin_nearest(xy, floorplan, is_allowed):
    """Nearest face (m,) and its nearest point (m, 2), all faces tried."""
    first, second = floorplan.ends[:, 0], floorplan.ends[:, 1]
    along = second - first
    share = np.einsum("mni,ni->mn", xy[:, None] - first, along) / floorplan.lengths**2
    points = first + np.clip(share, 0, 1)[..., None] * along
    distance = np.linalg.norm(points - xy[:, None], axis=2)
    distance[~is_allowed] = np.inf
    face = distance.argmin(axis=1)
    rows = np.arange(len(xy))
    return face, points[rows, face], distance[rows, face]


@dataclass(frozen=True)
class KeptFiles:
    """Images rendered once for all tests."""

    rendered: object
    colors: list
    depths: list
    label_images: list

    def color(self, i):
        return self.colors[i]

    def depth(self, i):
        return self.depths[i]

    def labels(self, i):
        return self.label_images[i]

    def write_poses(self, directory, world_from_cams, frame_idx=None):
        self.rendered.write_poses(directory, world_from_cams, frame_idx)


def keep_images(scan):
    """The scan with its images in memory: a synthetic one renders each whenever it is asked for."""
    files, n = scan.files, range(len(scan))
    kept = KeptFiles(
        files, *([read(i) for i in n] for read in (files.color, files.depth, files.labels))
    )
    return replace(scan, files=kept)
