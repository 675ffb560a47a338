"""Alignment problems made from geometry alone: no images are rendered.

A case is a synthetic building, a walk through part of it, and what a camera with 66 degrees of view would
see of its walls from every half metre of the walk, as wall patches with noise. Furniture hides walls,
and some of it is taken for wall. The walk drifts by up to 2 % of its length. As in `planfit.refine`, loops
are closed before the alignment: where the walk comes back to a place with a like view, a pose graph ties
the two together; what the graph leaves, deforms the scan. The plan has walls too many, too few, and in the
wrong alignment.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import spsolve

from planfit.alignment import WallSamples, sample_walls
from planfit.floorplan import Floorplan
from planfit.geometry import segments
from planfit.synth import BuildingOptions, make_building
from planfit.synth.building import Building, Part

FOV_DEG, RANGE_M, STEP_M, N_RAYS = 66.0, 7.0, 0.5, 45
MIN_PATCH_M = 0.3


@dataclass(frozen=True)
class Case:
    """A scan, a plan, and where the scan is."""

    walls: WallSamples
    residual_m: float  # RMS distance of the deformed scan from its best rigid alignment
    cloud: (
        np.ndarray
    )  # (n, 3) m, level frame: points of wall, furniture and floor, for the paper's method
    floorplan: Floorplan  # turned and scaled; in metres or without unit
    plan_from_level: np.ndarray  # (3, 3) true alignment of the middle of the scan, plan in metres
    metres_per_unit: float
    is_scale_known: bool
    coverage: float
    drift: float
    wrong_share: float
    n_furniture: int

    @property
    def words(self) -> str:
        """The conditions in one line."""
        return (
            f"coverage {self.coverage:4.0%}, drift {self.drift:4.1%}, wrong walls {self.wrong_share:3.0%}, "
            f"furniture {self.n_furniture:2}, scale {'known' if self.is_scale_known else 'unknown'}"
        )


def make_case(seed: int, close_loops: bool = True) -> Case:
    """The case of a seed: everything about it is drawn from the ranges of the battery."""
    rng = np.random.default_rng([2024, seed])
    n_furniture = int(rng.integers(0, 9))
    options = BuildingOptions(
        n_rooms=int(rng.integers(6, 13)),
        has_corridor=bool(rng.random() < 0.6),
        room_size_m=(3.0, float(rng.uniform(4.5, 8.0))),
        corridor_width_m=float(rng.uniform(1.6, 2.6)),
        furniture_per_room=n_furniture,
        n_columns=int(rng.integers(0, 3)),
    )
    building = make_building(options, rng)
    rooms, coverage = _rooms_walked(building, float(rng.uniform(0.25, 1.0)), rng)
    poses = _walk(building, rooms, rng)
    ends, normals, pose_of = _seen(building, poses, rng)
    share = float(rng.uniform(0.0, 0.02))
    drifted = _drift(poses, share, rng)
    if close_loops:
        drifted = _close_loops(poses, drifted, rng)
    seen_ends, seen_normals = _carry(ends, normals, poses[pose_of], drifted[pose_of])
    walls = sample_walls(seen_normals, seen_ends, seen_from=drifted[pose_of, :2])
    true_xy, _ = segments.sample(ends, 0.1)
    wrong_share = float(rng.uniform(0.0, 0.2))
    faces = _spoilt(building, wrong_share, rng)
    is_known = bool(rng.random() < 0.5)
    yaw, translation = rng.uniform(-np.pi, np.pi), rng.uniform(-50, 50, 2)
    scale = 1.0 if is_known else float(10 ** rng.uniform(-2, 2))
    c, s = np.cos(yaw), np.sin(yaw)
    rotation = np.array([[c, -s], [s, c]])
    floorplan = Floorplan(
        f"case {seed}",
        (faces @ rotation.T + translation) / scale,
        segments.left_normals(faces) @ rotation.T,
        np.ones(len(faces), dtype=bool),
        is_metric=is_known,
    )
    truth = np.eye(3)
    level = _rigid(walls.xy, true_xy @ rotation.T + translation)
    truth[:2] = level
    deformation = walls.xy @ level[:, :2].T + level[:, 2] - (true_xy @ rotation.T + translation)
    residual_m = float(np.sqrt(np.mean(np.sum(deformation**2, axis=1))))
    return Case(
        walls, residual_m, _cloud(walls, drifted, rng), floorplan, truth, scale, is_known, coverage, share,
        wrong_share, n_furniture,
    )  # fmt: skip


def _rooms_walked(
    building: Building, wanted: float, rng: np.random.Generator
) -> tuple[list[int], float]:
    """Rooms in the order they are first entered, through doors, until a share of the area is covered."""
    layout = building.layout
    area = np.array([room.area for room in layout.rooms])
    order = [int(rng.integers(len(area)))]
    while area[order].sum() < wanted * area.sum():
        next_rooms = [
            b if a in order else a
            for a, b in (door.rooms for door in layout.doors)
            if (a in order) != (b in order)
        ]
        if not next_rooms:
            break
        order.append(int(rng.choice(next_rooms)))
    return order, float(area[order].sum() / area.sum())


def _walk(building: Building, rooms: list[int], rng: np.random.Generator) -> np.ndarray:
    """Camera (n, 3) x, y, yaw: round each room near its middle, then back the way through doors."""
    layout = building.layout
    stops: list[np.ndarray] = []
    came_from = {rooms[0]: None}
    for room in rooms[1:]:
        came_from[room] = next(
            (a if b == room else b, door)
            for door in layout.doors
            for a, b in [door.rooms]
            if (a == room and b in came_from) or (b == room and a in came_from)
        )
    here = rooms[0]
    stops += _round(layout.rooms[here], rng)
    for room in rooms[1:]:
        stops += _way(here, room, came_from, layout)
        stops += _round(layout.rooms[room], rng)
        here = room
    corners = np.array(stops)
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    at = np.arange(0.0, along[-1], STEP_M)
    xy = np.column_stack([np.interp(at, along, corners[:, k]) for k in range(2)])
    heading = np.gradient(xy, axis=0)
    yaw = np.unwrap(np.arctan2(heading[:, 1], heading[:, 0]))
    sway = np.deg2rad(50) * np.sin(np.arange(len(yaw)) * rng.uniform(0.3, 0.6))
    return np.column_stack([xy, yaw + sway])


def _round(room, rng) -> list[np.ndarray]:
    """Corners of a round through a room."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * room.size * rng.uniform(0.12, 0.25)
    start = int(rng.integers(4))
    return [room.centre + corners[(start + k) % 4] for k in range(4)]


def _way(here: int, there: int, came_from: dict, layout) -> list[np.ndarray]:
    """Door by door through the tree of rooms entered so far."""

    def to_root(room):
        steps = []
        while came_from[room] is not None:
            parent, door = came_from[room]
            steps.append((room, door, parent))
            room = parent
        return steps

    up, down = to_root(here), to_root(there)
    while up and down and up[-1] == down[-1]:
        up.pop()
        down.pop()
    stops = []
    for _, door, parent in up:
        stops += [door.rect.centre, layout.rooms[parent].centre]
    for room, door, _ in reversed(down):
        stops += [door.rect.centre, layout.rooms[room].centre]
    return stops


def _seen(
    building: Building, poses: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Wall patches that each camera sees: ends (k, 2, 2), normals (k, 2) and camera (k,), true frame."""
    is_wall = building.faces.parts != Part.LINTEL
    ends = [building.faces.ends[is_wall]]
    for patch in building.furniture:
        foot = patch.footprint
        c, s = np.cos(foot.yaw), np.sin(foot.yaw)
        corners = np.array([[-1, -1], [-1, 1], [1, 1], [1, -1]]) * foot.half @ np.array(
            [[c, s], [-s, c]]
        ) + np.array(foot.centre)
        ends.append(np.stack([corners, np.roll(corners, -1, axis=0)], axis=1))
    # Every third piece of furniture is tall: it hides the wall and is taken for one.
    keep = [ends[0], *(e for e in ends[1:] if rng.random() < 0.35)]
    all_ends = np.concatenate(keep)
    normals = segments.left_normals(all_ends)
    patches, patch_normals, camera = [], [], []
    fan = np.deg2rad(np.linspace(-FOV_DEG / 2, FOV_DEG / 2, N_RAYS))
    for i, (x, y, yaw) in enumerate(poses):
        rays = np.stack([np.cos(yaw + fan), np.sin(yaw + fan)], axis=1)
        face, hit = _cast(np.array([x, y]), rays, all_ends)
        breaks = np.flatnonzero(np.diff(face)) + 1
        for run in np.split(np.arange(N_RAYS), breaks):
            f = face[run[0]]
            if f < 0 or len(run) < 3:
                continue
            patch = hit[[run[0], run[-1]]]
            if np.linalg.norm(patch[1] - patch[0]) < MIN_PATCH_M:
                continue
            normal = normals[f]
            if normal @ (np.array([x, y]) - patch[0]) < 0:
                continue
            tilt = rng.normal(0.0, np.deg2rad(1.0))
            c, s = np.cos(tilt), np.sin(tilt)
            middle = patch.mean(axis=0) + rng.normal(0.0, 0.02) * normal
            rotation = np.array([[c, -s], [s, c]])
            patches.append((patch - patch.mean(axis=0)) @ rotation.T + middle)
            patch_normals.append(rotation @ normal)
            camera.append(i)
    return np.array(patches), np.array(patch_normals), np.array(camera)


def _cast(eye: np.ndarray, rays: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First face (r,) that each ray meets within range, or -1, and where (r, 2)."""
    a, b = ends[:, 0] - eye, ends[:, 1] - ends[:, 0]
    cross = rays[:, :1] * b[:, 1] - rays[:, 1:] * b[:, 0]
    safe = np.where(np.abs(cross) < 1e-12, 1e-12, cross)
    t = (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / safe
    u = (a[:, 0] * rays[:, 1:] - a[:, 1] * rays[:, :1]) / safe
    t = np.where((u >= 0) & (u <= 1) & (t > 0.05) & (t < RANGE_M), t, np.inf)
    face = np.argmin(t, axis=1)
    reach = t[np.arange(len(rays)), face]
    hit = eye + np.where(np.isfinite(reach), reach, 0.0)[:, None] * rays
    return np.where(np.isfinite(reach), face, -1), hit


def _drift(poses: np.ndarray, share: float, rng: np.random.Generator) -> np.ndarray:
    """Poses (n, 3) with a random walk of step and yaw; its end is off by `share` of the way."""
    n = len(poses)
    heading = np.cumsum(rng.normal(0.0, 1.0, n)) * 0.02
    slip = rng.normal(0.0, 1.0, (n, 2)) * 0.02

    def walked(size: float) -> np.ndarray:
        step = np.diff(poses[:, :2], axis=0)
        yaw = size * heading[:-1]
        c, s = np.cos(yaw), np.sin(yaw)
        moved = np.column_stack([c * step[:, 0] - s * step[:, 1], s * step[:, 0] + c * step[:, 1]])
        xy = poses[0, :2] + np.concatenate([[[0, 0]], np.cumsum(moved + size * slip[1:], axis=0)])
        return np.column_stack([xy, poses[:, 2] + size * heading])

    way = float(np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1).sum())
    low, high = 0.0, 8.0
    for _ in range(40):  # the largest error along the way grows with the size of the random steps
        size = (low + high) / 2
        off = np.linalg.norm(walked(size)[:, :2] - poses[:, :2], axis=1).max()
        low, high = (size, high) if off < share * way else (low, size)
    return walked(low)


def _close_loops(poses: np.ndarray, drifted: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Drifted poses (n, 3) after a pose graph over steps and revisits (sparse Gauss-Newton)."""
    n = len(poses)
    first, second = np.triu_indices(n, 15)
    near = np.linalg.norm(poses[first, :2] - poses[second, :2], axis=1) < 1.5
    alike = np.cos(poses[first, 2] - poses[second, 2]) > 0.5
    loops = np.column_stack([first, second])[near & alike]
    if len(loops) == 0:
        return drifted
    steps = np.column_stack([np.arange(n - 1), np.arange(1, n)])
    pairs = np.concatenate([steps, loops])
    noise = rng.normal(size=(len(loops), 3)) * [0.05, 0.05, np.deg2rad(0.5)]
    wanted = np.concatenate([_relative(drifted, steps), _relative(poses, loops) + noise])
    sigma = np.concatenate(
        [np.tile([0.03, 0.03, 0.015], (n - 1, 1)), np.tile([0.05, 0.05, 0.01], (len(loops), 1))]
    )
    solved = drifted.copy()
    for _ in range(8):
        residual = (_relative(solved, pairs) - wanted) / sigma
        jacobian = _graph_jacobian(solved, pairs, sigma)[:, 3:]
        # The loss of Cauchy keeps far revisits of a badly deformed start from tearing the path.
        weight = 1.0 / (1.0 + (residual / 10.0) ** 2).ravel()
        normal = (jacobian.T @ jacobian.multiply(weight[:, None])).tocsc()
        step = spsolve(normal, -jacobian.T @ (weight * residual.ravel()))
        solved[1:] += step.reshape(-1, 3)
    return solved


def _relative(poses: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Second pose (k, 3) of each pair in the axes of the first."""
    a, b = poses[pairs[:, 0]], poses[pairs[:, 1]]
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    d = b - a
    return np.column_stack([c * d[:, 0] + s * d[:, 1], c * d[:, 1] - s * d[:, 0], d[:, 2]])


def _graph_jacobian(poses: np.ndarray, pairs: np.ndarray, sigma: np.ndarray) -> csr_matrix:
    """Derivative of `_relative` over sigma, (3 k, 3 n)."""
    a, k = poses[pairs[:, 0]], len(pairs)
    c, s, relative = np.cos(a[:, 2]), np.sin(a[:, 2]), _relative(poses, pairs)
    of_second = np.zeros((k, 3, 3))
    of_second[:, 0, 0], of_second[:, 0, 1] = c, s
    of_second[:, 1, 0], of_second[:, 1, 1] = -s, c
    of_second[:, 2, 2] = 1.0
    of_first = -of_second
    of_first[:, 0, 2], of_first[:, 1, 2] = relative[:, 1], -relative[:, 0]
    blocks = np.concatenate([of_first, of_second]) / np.concatenate([sigma, sigma])[:, :, None]
    rows = np.tile(3 * np.arange(k), 2)[:, None, None] + np.arange(3)[None, :, None]
    columns = 3 * pairs.T.ravel()[:, None, None] + np.arange(3)[None, None, :]
    rows, columns = np.broadcast_arrays(rows, columns)
    return csr_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), (3 * k, 3 * len(poses)))


def _carry(
    ends: np.ndarray, normals: np.ndarray, poses: np.ndarray, drifted: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Patches as the drifted cameras put them."""
    angle = drifted[:, 2] - poses[:, 2]
    c, s = np.cos(angle), np.sin(angle)
    rotation = np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], axis=1)
    moved = np.einsum("kab,keb->kea", rotation, ends - poses[:, None, :2]) + drifted[:, None, :2]
    return moved, np.einsum("kab,kb->ka", rotation, normals)


def _spoilt(building: Building, share: float, rng: np.random.Generator) -> np.ndarray:
    """Faces (n, 2, 2) of the plan, with a share of its walls left out, moved, or added."""
    is_drawn = building.faces.parts != Part.LINTEL
    ends = building.faces.ends[is_drawn].copy()
    normals, lengths = segments.left_normals(ends), segments.lengths(ends)
    gone = np.zeros(len(ends), dtype=bool)
    long = np.flatnonzero(lengths > 0.8)
    for i in rng.permutation(long)[: round(share * 2 / 3 * len(long) / 1.5)]:
        behind = -(ends.mean(axis=1) - ends[i].mean(axis=0)) @ normals[i]
        is_partner = (normals @ normals[i] < -0.99) & (behind > 0) & (behind < 0.6)
        along = (ends[i, 1] - ends[i, 0]) / lengths[i]
        at = (ends.mean(axis=1) - ends[i, 0]) @ along
        wall = [*np.flatnonzero(is_partner & (at > 0) & (at < lengths[i])), i]
        if rng.random() < 0.5:
            gone[wall] = True
        else:
            ends[wall] += rng.choice([-1, 1]) * rng.uniform(0.3, 1.0) * normals[i]
    added = []
    for _ in range(round(share / 3 * len(long) / 2)):
        room = building.layout.rooms[int(rng.integers(len(building.layout.rooms)))]
        axis = int(rng.integers(2))
        low = np.array([room.x0, room.y0]) + rng.uniform(0.2, 0.8, 2) * room.size
        length = rng.uniform(0.3, 0.8) * room.size[axis]
        step = np.eye(2)[axis] * length
        across = np.eye(2)[1 - axis] * 0.15
        added += [[low, low + step], [low + step - across, low - across]]
        if axis == 1:
            added[-2:] = [[low + step, low], [low - across, low + step - across]]
    kept = ends[~gone]
    return np.concatenate([kept, np.array(added)]) if added else kept


def _rigid(xy: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Rigid (2, 3) that brings points (n, 2) nearest to their targets: the true alignment of a deformed
    scan."""
    a, b = xy - xy.mean(axis=0), target - target.mean(axis=0)
    yaw = np.angle(np.sum(np.conj(a[:, 0] + 1j * a[:, 1]) * (b[:, 0] + 1j * b[:, 1])))
    c, s = np.cos(yaw), np.sin(yaw)
    rotation = np.array([[c, -s], [s, c]])
    return np.column_stack([rotation, target.mean(axis=0) - rotation @ xy.mean(axis=0)])


def _cloud(walls: WallSamples, poses: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Points of wall at random heights, and of floor around the way."""
    wall = np.column_stack([walls.xy, rng.uniform(0.0, 2.5, len(walls.xy))])
    n = len(walls.xy) // 2
    floor = poses[rng.integers(len(poses), size=n), :2] + rng.uniform(-1.5, 1.5, (n, 2))
    return np.concatenate([wall, np.column_stack([floor, rng.normal(0.0, 0.01, n)])])
