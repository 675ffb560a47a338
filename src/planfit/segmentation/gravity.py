"""Which way is up: given by the format, or the most common normal (paper, Implementation Details).

The most common normal is where the search begins; walls, which are square to it, take part in the end.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from planfit.geometry.camera import Camera
from planfit.geometry.depth_normals import depth_normals
from planfit.runtime import Runtime, cache_key, short_repr
from planfit.scan import Scan
from planfit.scan.statistics import MAX_FRAMES

_SOFT_DEG = 1.5
"""Normals that are further off than this weigh less and less."""
_MAX_TILT_DEG = 40.0
"""The camera is held upright within this on average; it tells floor and ceiling from walls."""
_NORMAL_RADIUS_PX, _STEP_PX = 5, 8
"""Of the normals, and between the pixels that have one."""
_CLUSTER_DEG = 5.0
"""Level surfaces and walls within this of level and upright take part in the fit."""


@dataclass(frozen=True)
class Gravity:
    """The direction against gravity."""

    up_world: Float[np.ndarray, "3"]
    """Unit."""
    confidence: float
    """Share of the normals near up that agree with it; 1 where the format knows it."""
    source: str
    """Where it comes from, in words."""

    __repr__ = short_repr


def find_gravity(scan: Scan, runtime: Runtime) -> Gravity:
    """Up direction of a scan, in world axes.

    The fit begins at the most common normal among those within 40 degrees of the mean image-up
    direction: floor and ceiling in most scans. Its sign comes from the cameras. Images of a phone that was
    held upright may lie on their side: up is then along their rows.
    """
    if scan.up_world is not None:
        return Gravity(scan.up_world, 1.0, "recorded by the scan's format")
    frames = np.unique(np.linspace(0, len(scan) - 1, MAX_FRAMES).astype(int))

    def normals_world(item: int) -> dict[str, np.ndarray]:
        i = int(frames[item])
        _, normals = oriented_points(scan.cameras[i], scan.files.depth(i))
        return {"normals": normals @ scan.world_from_cams[i, :3, :3].T}

    key = cache_key(scan.fingerprint, scan.world_from_cams[frames].tobytes())
    items = runtime.map("gravity", key, len(frames), normals_world)
    normals = np.concatenate([item["normals"] for item in items])
    return most_common_upright(normals, _up_of_cameras(scan.world_from_cams[:, :3, :3], normals))


def _up_of_cameras(
    world_from_cams: Float[np.ndarray, "n 3 3"], normals: Float[np.ndarray, "m 3"]
) -> Float[np.ndarray, "3"]:
    """Mean image-up direction, a unit vector, or one along the images' rows where that alone keeps its
    direction as a walk turns about: the end of it that floors and tables face, which are seen more of than
    ceilings."""
    along, up = world_from_cams[:, :, 0].mean(axis=0), -world_from_cams[:, :, 1].mean(axis=0)
    kept = np.cos(np.deg2rad(_MAX_TILT_DEG))
    if np.linalg.norm(up) < kept < np.linalg.norm(along):
        cosine = normals @ along
        up = along * np.sign(cosine[np.abs(cosine) > kept].sum() + 1e-9)
    return up / max(float(np.linalg.norm(up)), 1e-9)


def oriented_points(
    camera: Camera, depth: Float[np.ndarray, "h w"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Points (m) and unit normals of some pixels of a depth image, camera axes; none of one too small."""
    if min(depth.shape) < 4 * _NORMAL_RADIUS_PX:
        return np.zeros((0, 3)), np.zeros((0, 3))
    points = camera.lift_image(depth)
    normals = depth_normals(points, _NORMAL_RADIUS_PX, step_px=_STEP_PX).reshape(-1, 3)
    is_told = np.isfinite(normals).all(axis=1)
    return points[::_STEP_PX, ::_STEP_PX].reshape(-1, 3)[is_told], normals[is_told]


def most_common_upright(normals: np.ndarray, near: np.ndarray) -> Gravity:
    """The mode of normals (n, 3) within 40 degrees of `near` (3,), by votes, refined."""
    cosine = normals @ near
    # A ceiling's normal points down: antipodes count as one.
    upright = np.where((cosine < 0)[:, None], -normals, normals)
    upright = upright[np.abs(cosine) > np.cos(np.deg2rad(_MAX_TILT_DEG))]
    if len(upright) < 100:
        return Gravity(near, 0.0, "the mean image-up direction: too few level surfaces were seen")
    candidates = upright[np.linspace(0, len(upright) - 1, 1500).astype(int)]
    votes = (upright[:: max(1, len(upright) // 5000)] @ candidates.T) > np.cos(np.deg2rad(3.0))
    up = candidates[np.argmax(votes.sum(axis=0))]
    return _refined(normals, upright, up)


def _refined(normals: np.ndarray, upright: np.ndarray, up: np.ndarray) -> Gravity:
    """Up as the direction that level surfaces face and walls are square to.

    With unit normals m of level surfaces and n of walls, the sum of squared sines is
    sum (n.u)^2 + sum (1 - (m.u)^2): a quadratic form, whose smallest eigenvector is up. Walls halve the
    error where little floor is seen. Weights fall with the angle, so that the clutter's slopes, which
    are never as sharp a peak as the floor, weigh little.
    """
    for _ in range(8):  # iteratively reweighted
        form = np.zeros((3, 3))
        for group, sign in ((upright, -1.0), (normals, 1.0)):
            cosine = np.clip(group @ up, -1.0, 1.0)
            angle_deg = np.rad2deg(np.arccos(cosine) if sign < 0 else np.arcsin(np.abs(cosine)))
            near = angle_deg < _CLUSTER_DEG
            weight = 1.0 / (1.0 + (angle_deg[near] / _SOFT_DEG) ** 2) ** 2
            form += sign * (group[near].T * weight) @ group[near]
        found = np.linalg.eigh(form)[1][:, 0]
        up = found if found @ up > 0 else -found
    agrees = upright @ up > np.cos(np.deg2rad(_CLUSTER_DEG))
    return Gravity(up.astype(float), float(np.mean(agrees)), "level surfaces and walls")
