"""A room seen by rays, and the same as a faulty depth camera has it: the truth for calibration."""

from dataclasses import dataclass, replace

import numpy as np

from builders import CAMERA, look, make_matches, make_structure, make_ties, room_plan
from planfit.adjust import AdjustOptions, Measurements, build_problem
from planfit.adjust.association import Association
from planfit.geometry import se3
from planfit.scan.odometry import OdometryOptions, make_odometry

SIZE = np.array([6.0, 4.0, 2.6])


def mislifted(points_cam, undone_by):
    """True points as the files of a faulty sensor give them; its calibration undoes it."""
    wrong, p = undone_by, np.asarray(points_cam, dtype=float)
    beyond = p[..., 2] - wrong.depth_offset_m
    root = np.sqrt(wrong.depth_scale**2 + 4 * wrong.depth_quadratic_per_m * beyond)
    z = 2 * beyond / (wrong.depth_scale + root)
    x = p[..., 0] / p[..., 2] * wrong.focal_scale + wrong.principal_x
    y = p[..., 1] / p[..., 2] * wrong.focal_scale * wrong.focal_aspect + wrong.principal_y
    return np.stack([x * z, y * z, z], axis=-1)


def with_points(measurements, change):
    """Measurements with every point (n, 3) of the camera's changed by a function."""
    matches, structure = measurements.matches, measurements.structure
    floor, walls = structure.floor, structure.walls
    ends = change(walls.ends_cam.reshape(-1, 3)).reshape(-1, 2, 3)
    return replace(
        measurements,
        matches=replace(
            matches, points_a=change(matches.points_a), points_b=change(matches.points_b)
        ),
        structure=replace(
            structure,
            floor=replace(floor, points_cam=change(floor.points_cam)),
            walls=replace(walls, points_cam=change(walls.points_cam), ends_cam=ends),
        ),
    )


@dataclass(frozen=True)
class SensorWorld:
    """A walk round a room: what the cameras see of floor, walls and things between them."""

    plan_from_cams: np.ndarray
    measurements: Measurements
    ties: object

    def measured_by(self, undone_by):
        """The same world as a sensor has it that this calibration puts right."""
        wrong = with_points(self.measurements, lambda points: mislifted(points, undone_by))
        return replace(self, measurements=wrong)

    def problem(self, measurements=None, poses=None, walls=True, options=None):
        chosen = self.measurements if measurements is None else measurements
        poses = self.plan_from_cams if poses is None else poses
        return build_problem(
            chosen, options or AdjustOptions(), poses, self.ties if walls else None
        )


def make_sensor_world(
    rng, n=20, noise_m=0.005, n_rays=400, angles=None, size=SIZE, before_line=None
):
    """Cameras on an oval in a box room (3 m), turning as they go; rays meet floor and walls."""
    angle = np.arange(n) * 360.0 / n if angles is None else angles
    around = np.deg2rad(angle)
    x, y = 0.5 * size[0] + 1.2 * np.cos(around), 0.5 * size[1] + 0.8 * np.sin(around)
    at = np.stack([x, y, np.full(n, 1.5)], axis=1)
    poses = np.stack([look(p, a + 150, 25) for p, a in zip(at, angle, strict=True)])
    plan = replace(room_plan(*size[:2]), before_line=before_line)
    floor, patches, faces = [], [], []
    for i, pose in enumerate(poses):
        pixels = rng.uniform([0, 0], [CAMERA.width, CAMERA.height], (n_rays, 2))
        ways = CAMERA.rays(pixels) @ pose[:3, :3].T
        origin = pose[:3, 3]
        exits = np.maximum(-origin / ways, (size - origin) / ways)
        first = exits.argmin(axis=1)
        points = origin + exits.min(axis=1)[:, None] * ways
        floor.append((i, points[(first == 2) & (points[:, 2] < 1)]))
        for face, (ends, normal) in enumerate(zip(plan.ends, plan.normals, strict=True)):
            off = (points[:, :2] - ends[0]) @ normal
            on = (first < 2) & (np.abs(off) < 1e-9)
            if on.sum() >= 20:
                patches.append((i, points[on], normal))
                faces.append(face)
    structure = make_structure(poses, floor, patches)
    matches = _seen_twice(poses, rng, size)
    measured = Measurements(
        matches, structure, make_odometry(poses, OdometryOptions()), (CAMERA,) * n
    )
    if noise_m:
        measured = with_points(measured, lambda p: p + noise_m * rng.normal(size=p.shape))
    ties = make_ties(plan, Association(np.array(faces, dtype=int), np.zeros(len(faces))), n)
    return SensorWorld(poses, measured, ties)


def _seen_twice(poses, rng, size, n_points=1500, reach=4):
    """Points in the room that two cameras both have in their images."""
    points = rng.uniform([0, 0, 0], size, (n_points, 3))
    in_cams = se3.transform_each(
        np.repeat(se3.inverse(poses), n_points, axis=0), np.tile(points, (len(poses), 1))
    ).reshape(len(poses), n_points, 3)
    depth = in_cams[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = CAMERA.fx * in_cams[..., 0] / depth + CAMERA.cx
        v = CAMERA.fy * in_cams[..., 1] / depth + CAMERA.cy
    seen = (depth > 0.5) & (u > 0) & (u < CAMERA.width) & (v > 0) & (v < CAMERA.height)
    n = len(poses)
    pairs = [(i, j) for i in range(n) for j in range(i + 1, n) if min(j - i, n - j + i) <= reach]
    pairs = [(i, j) for i, j in pairs if (seen[i] & seen[j]).sum() >= 20]
    empty = make_matches(poses, [], points[:0])
    if not pairs:
        return empty
    each = [make_matches(poses, [(i, j)], points[seen[i] & seen[j]]) for i, j in pairs]
    return replace(
        empty,
        pairs=np.array(pairs),
        start=np.cumsum([0, *(len(m.points_a) for m in each)]),
        points_a=np.concatenate([m.points_a for m in each]),
        points_b=np.concatenate([m.points_b for m in each]),
        sigma=np.concatenate([m.sigma for m in each]),
        n_tried=len(pairs),
    )
