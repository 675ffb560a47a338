"""Distance of the map to a true scan (NND), after the rigid motion that brings them closest."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from planfit.errors import ScanError
from planfit.evaluation.neighbourhoods import as_matrices, covariances, make_grid
from planfit.geometry import se3
from planfit.runtime import SEED

_MAX_POINTS = 10_000
"""Points that take part in the registration; NND itself is taken of all points."""
_ROUNDS = 60


@dataclass(frozen=True)
class TrueCloud:
    """Points of a true scan, with what nearest neighbours and registration need."""

    points: Float[np.ndarray, "t 3"]  # m
    normals: Float[np.ndarray, "t 3"]  # unit, either side
    tree: cKDTree


@dataclass(frozen=True)
class NearestNeighbours:
    """Distance of a map to a true scan."""

    nnd_m: float
    """Mean distance from the map's points to the nearest true point, after registration."""
    unregistered_m: float
    """The same where the registration began, of the points that took part in it."""
    truth_from_map: Float[np.ndarray, "4 4"]
    """The registration."""


def read_true_cloud(path: Path, spacing_m: float) -> TrueCloud:
    """Read a true scan: the points of a cloud, or points on the surface of a mesh, about one in a square of
    `spacing_m`.

    Raises:
        ScanError: the file is missing, of no known format, or empty.
    """
    import trimesh  # a tenth of what all commands would take to start

    if not path.exists():
        raise ScanError(f"{path}: expected a true scan (PLY, OBJ), found nothing; check the path")
    try:
        loaded = trimesh.load(path, process=False)
    except Exception as error:  # a reader of many formats raises errors of many kinds
        raise ScanError(f"{path}: expected a point cloud or mesh, found {error}") from error
    if isinstance(loaded, trimesh.Scene):
        loaded = loaded.to_mesh()
    if isinstance(loaded, trimesh.Trimesh) and len(loaded.faces):
        count = int(np.clip(loaded.area / spacing_m**2, 1, 20_000_000))
        points = trimesh.sample.sample_surface(loaded, count, seed=SEED)[0]
    else:
        points = getattr(loaded, "vertices", np.zeros((0, 3)))
    points = np.asarray(points, dtype=float).reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 10:
        raise ScanError(f"{path}: expected a true scan, found {len(points)} points")
    return make_true_cloud(points, 3 * spacing_m)


def make_true_cloud(points: Float[np.ndarray, "t 3"], normal_radius_m: float) -> TrueCloud:
    """A true scan of points (m); normals are those of the points within `normal_radius_m`."""
    normals = np.zeros((len(points), 3))
    for idx, _, covariance in covariances(make_grid(points, normal_radius_m)):
        normals[idx] = np.linalg.eigh(as_matrices(covariance))[1][:, :, 0]
    return TrueCloud(points, normals, cKDTree(points))


def nearest_neighbours(
    points: Float[np.ndarray, "m 3"],
    truth: TrueCloud,
    truth_from_map: Float[np.ndarray, "4 4"] | None = None,
    reach_m: float = 1.0,
    workers: int = 1,
) -> NearestNeighbours:
    """NND of a map.

    Args:
        points: the map, m.
        truth: the true scan.
        truth_from_map: where the registration begins; by default where the map lies. It must be
            right within about `reach_m`.
        reach_m: pairs further apart than this take no part; it shrinks to a tenth during the registration.
        workers: threads.
    """
    start = np.eye(4) if truth_from_map is None else truth_from_map
    step = max(1, -(-len(points) // _MAX_POINTS))
    fitted = register(points[::step], truth, start, reach_m, workers)
    return NearestNeighbours(
        nnd_m=_mean_distance(points, truth, fitted, workers),
        unregistered_m=_mean_distance(points[::step], truth, start, workers),
        truth_from_map=fitted,
    )


def _mean_distance(points: np.ndarray, truth: TrueCloud, pose: np.ndarray, workers: int) -> float:
    total = 0.0
    for first in range(0, len(points), 1_000_000):
        moved = se3.transform(pose, points[first : first + 1_000_000])
        total += float(np.sum(truth.tree.query(moved, workers=workers)[0]))
    return total / len(points) if len(points) else np.nan


def register(
    points: Float[np.ndarray, "m 3"],
    truth: TrueCloud,
    start: Float[np.ndarray, "4 4"],
    reach_m: float,
    workers: int = 1,
) -> Float[np.ndarray, "4 4"]:
    """Point-to-plane ICP: truth_from_map that brings points (m) onto the true scan, begun at `start`.

    Pairs of nearest points, distances across the true surface; pairs further apart than `reach_m` are left
    out, and it shrinks to a tenth.
    """
    pose = start
    for round_idx in range(_ROUNDS):
        reach = reach_m * max(0.1, 0.9**round_idx)
        moved = se3.transform(pose, points)
        found = truth.tree.query(moved, distance_upper_bound=reach, workers=workers)
        distance, idx = np.asarray(found[0]), np.asarray(found[1])
        paired = np.isfinite(distance)
        if paired.sum() < 6:
            return pose
        at, normals = moved[paired], truth.normals[idx[paired]]
        centre = at.mean(axis=0)
        jacobian = np.concatenate([np.cross(at - centre, normals), normals], axis=1)
        off = np.einsum("ni,ni->n", truth.points[idx[paired]] - at, normals)
        # A little damping holds what the surfaces leave open: along a single wall, say.
        hessian = jacobian.T @ jacobian
        hessian += 1e-6 * np.trace(hessian) * np.eye(6)
        delta = np.linalg.solve(hessian, jacobian.T @ off)
        rotation = se3.exp_so3(delta[:3])  # about the centre, where the linearisation holds best
        translation = centre + delta[3:] - rotation @ centre
        pose = se3.make_transform(rotation, translation) @ pose
        if reach <= 0.1001 * reach_m and np.abs(delta).max() < 1e-5:
            break
    return pose
