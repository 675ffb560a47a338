"""Rigid transforms as 4x4 matrices, and their tangent vectors.

A transform named `target_from_source` maps points of the source frame into the target frame.
A tangent vector is `(rotation, translation)`, in radians and metres, in the target's axes:
`retract(T, delta) = [exp(rotation) R | t + translation]`. The point `y = R p + t` then moves, to first
order, by `rotation x (R p) + translation`. This is the chart of SO(3) x R^3, not the exponential of
SE(3): a rotation is about the source's own origin (the camera), so rotations and translations stay of one
scale however far a building lies from the origin of its plan.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float, Int, Real

from planfit.geometry.rotation_kernels import rotation_vectors

Poses = Float[np.ndarray, "n 4 4"]
"""A transform for each frame."""

_SMALL_ANGLE_SQ = 1e-8

POINTS_AT_A_TIME = 65_536
"""Points that are each given a transform of their own at once: 8 MB."""


def transform(
    target_from_source: Float[np.ndarray, "*#batch 4 4"], points: Float[np.ndarray, "*#batch n 3"]
) -> Float[np.ndarray, "... n 3"]:
    """Map points by transforms; leading axes broadcast."""
    rotation = target_from_source[..., :3, :3]
    return points @ np.swapaxes(rotation, -1, -2) + target_from_source[..., None, :3, 3]


def transform_each(
    target_from_sources: Poses, points: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """Map points, each by its own transform."""
    rotated = np.einsum("nij,nj->ni", target_from_sources[:, :3, :3], points)
    return rotated + target_from_sources[:, :3, 3]


def transform_indexed(
    target_from_sources: Poses,
    idx: Int[np.ndarray, " m"],
    points: Float[np.ndarray, "m 3"],
) -> Float[np.ndarray, "m 3"]:
    """Map points, each by the transform that `idx` takes; a few at a time, as a transform is 128 bytes."""
    moved = np.zeros(points.shape)
    for first in range(0, len(points), POINTS_AT_A_TIME):
        part = slice(first, first + POINTS_AT_A_TIME)
        moved[part] = transform_each(target_from_sources[idx[part]], points[part])
    return moved


def points_in_parts(
    start: Int[np.ndarray, " l"],
) -> Iterator[tuple[slice, Int[np.ndarray, " p"]]]:
    """Points of groups, group k of which are start[k]:start[k + 1], some at a time, and the group of each.

    What is made for each point then takes no memory that grows with the scan.
    """
    m = int(start[-1])
    for first in range(0, m, POINTS_AT_A_TIME):
        part = slice(first, min(first + POINTS_AT_A_TIME, m))
        yield part, np.searchsorted(start, np.arange(part.start, part.stop), side="right") - 1


def groups_in_parts(start: Int[np.ndarray, " l"], at_a_time: int = 0) -> Iterator[slice]:
    """The same by whole groups: a part is one group, or several that have no more points together.

    Args:
        start: (k + 1,) of k groups.
        at_a_time: points; 0: `POINTS_AT_A_TIME`.
    """
    first, n_groups = 0, len(start) - 1
    while first < n_groups:
        most = start[first] + (at_a_time or POINTS_AT_A_TIME)
        last = max(int(np.searchsorted(start, most, side="right")) - 1, first + 1)
        yield slice(first, min(last, n_groups))
        first = last


def inverse(
    target_from_source: Float[np.ndarray, "*batch 4 4"],
) -> Float[np.ndarray, "*batch 4 4"]:
    """Inverse of rigid transforms."""
    source_from_target = np.zeros_like(target_from_source)
    rotation_t = np.swapaxes(target_from_source[..., :3, :3], -1, -2)
    source_from_target[..., :3, :3] = rotation_t
    source_from_target[..., :3, 3] = -(rotation_t @ target_from_source[..., :3, 3:])[..., 0]
    source_from_target[..., 3, 3] = 1.0
    return source_from_target


def make_transform(
    rotation: Real[np.ndarray, "*#batch 3 3"], translation: Real[np.ndarray, "*#batch 3"]
) -> Float[np.ndarray, "... 4 4"]:
    """Stack rotations and translations into transforms; leading axes broadcast."""
    rotation = np.asarray(rotation, dtype=float)
    translation = np.asarray(translation, dtype=float)
    result = np.zeros((*np.broadcast_shapes(rotation.shape[:-2], translation.shape[:-1]), 4, 4))
    result[..., :3, :3] = rotation
    result[..., :3, 3] = translation
    result[..., 3, 3] = 1.0
    return result


def skew(vectors: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Cross-product matrices of vectors: `skew(a) @ b == a x b`."""
    result = np.zeros((*vectors.shape, 3))
    result[..., 0, 1], result[..., 0, 2] = -vectors[..., 2], vectors[..., 1]
    result[..., 1, 0], result[..., 1, 2] = vectors[..., 2], -vectors[..., 0]
    result[..., 2, 0], result[..., 2, 1] = -vectors[..., 1], vectors[..., 0]
    return result


def exp_so3(rotation_vectors: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Rotations of rotation vectors in radians (Rodrigues)."""
    theta_sq = np.sum(rotation_vectors**2, axis=-1)[..., None, None]
    small = theta_sq < _SMALL_ANGLE_SQ
    theta = np.sqrt(np.where(small, 1.0, theta_sq))  # safe first: 0/0 would poison both branches
    a = np.where(small, 1.0 - theta_sq / 6.0, np.sin(theta) / theta)
    b = np.where(small, 0.5 - theta_sq / 24.0, (1.0 - np.cos(theta)) / theta**2)
    k = skew(rotation_vectors)
    return np.eye(3) + a * k + b * (k @ k)


def log_so3(rotations: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch 3"]:
    """Rotation vectors in radians of rotations; safe at 0 and at pi.

    Matrices that are less than orthogonal to 1e-12 are taken for the nearest rotations.

    Raises:
        ValueError: one is left-handed, or flat.
        LinAlgError: one is no number.
    """
    flat = np.ascontiguousarray(rotations, dtype=float).reshape(-1, 3, 3)
    vectors, is_rotation = np.zeros((len(flat), 3)), np.zeros(len(flat), dtype=bool)
    rotation_vectors(flat, vectors, is_rotation)
    if not is_rotation.all():
        others = flat[~is_rotation]
        if (np.linalg.det(others) <= 0).any():
            raise ValueError("log_so3: expected rotations, found a left-handed or a flat matrix")
        nearest, found = project_to_so3(others), np.zeros((len(others), 3))
        rotation_vectors(nearest, found, np.zeros(len(others), dtype=bool))
        vectors[~is_rotation] = found
    return vectors.reshape(*rotations.shape[:-2], 3)


def retract(
    target_from_source: Float[np.ndarray, "*#batch 4 4"], delta: Float[np.ndarray, "*#batch 6"]
) -> Float[np.ndarray, "... 4 4"]:
    """Apply tangent vectors [rad, m] to transforms; see the module's page."""
    return make_transform(
        exp_so3(delta[..., :3]) @ target_from_source[..., :3, :3],
        target_from_source[..., :3, 3] + delta[..., 3:],
    )


def difference(
    to_target: Float[np.ndarray, "*#batch 4 4"], from_target: Float[np.ndarray, "*#batch 4 4"]
) -> Float[np.ndarray, "... 6"]:
    """Tangent vectors with `retract(from_target, difference) == to_target`."""
    rotation = to_target[..., :3, :3] @ np.swapaxes(from_target[..., :3, :3], -1, -2)
    translation = to_target[..., :3, 3] - from_target[..., :3, 3]
    return np.concatenate([log_so3(rotation), translation], axis=-1)


def interpolate(
    before: Float[np.ndarray, "*batch 4 4"],
    after: Float[np.ndarray, "*batch 4 4"],
    share: Float[np.ndarray, "*batch"],
) -> Float[np.ndarray, "*batch 4 4"]:
    """Poses at constant velocity between two: `before` at share 0, `after` at 1; beyond, extrapolated.

    Rotations R_before exp(share log(R_before^T R_after)), at constant angular velocity; straight positions.
    """
    turn = log_so3(np.swapaxes(before[..., :3, :3], -1, -2) @ after[..., :3, :3])
    result = np.zeros_like(before)
    result[..., :3, :3] = before[..., :3, :3] @ exp_so3(turn * share[..., None])
    weight = share[..., None]
    result[..., :3, 3] = (1 - weight) * before[..., :3, 3] + weight * after[..., :3, 3]
    result[..., 3, 3] = 1.0
    return result


def project_to_so3(matrices: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Nearest rotations in the Frobenius norm."""
    u, _, vt = np.linalg.svd(matrices)
    sign = np.ones(matrices.shape[:-1])
    sign[..., 2] = np.sign(np.linalg.det(u @ vt))
    return (u * sign[..., None, :]) @ vt


def rotation_angle(
    rotations: Float[np.ndarray, "*batch 3 3"],
) -> Float[np.ndarray, "*batch"] | np.float64:
    """Angles in radians of rotations."""
    return np.linalg.norm(log_so3(rotations), axis=-1)


def rotation_between(
    a: Float[np.ndarray, " 3"], b: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "3 3"]:
    """Smallest rotation that takes direction a to direction b."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    axis, cosine = np.cross(a, b), float(a @ b)
    sine = float(np.linalg.norm(axis))
    if cosine < 0 and sine < 1e-8:
        # Half a turn: any axis across `a` will do; take the one furthest from it. What the cross
        # product holds of the axis is rounding; what is left to `b` is a small rotation, well defined.
        across = np.cross(a, np.eye(3)[np.argmin(np.abs(a))])
        return rotation_between(-a, b) @ exp_so3(np.pi * across / np.linalg.norm(across))
    if sine < 1e-12:
        return np.eye(3)
    return exp_so3(axis / sine * np.arctan2(sine, cosine))


def yaw_transform(
    yaw: float, translation: Real[np.ndarray, " 3"] | None = None
) -> Float[np.ndarray, "4 4"]:
    """Transform that turns about +z by `yaw` (rad), then moves by `translation` (m)."""
    return make_transform(
        exp_so3(np.array([0.0, 0.0, yaw])), np.zeros(3) if translation is None else translation
    )


def yaw_of(
    target_from_source: Float[np.ndarray, "*batch 4 4"],
) -> Float[np.ndarray, "*batch"] | np.float64:
    """Yaw (rad) of transforms about +z, in (-pi, pi]: where the source's x axis points, seen from above."""
    return np.arctan2(target_from_source[..., 1, 0], target_from_source[..., 0, 0])


def wrap_angle(angle: np.ndarray | float) -> np.ndarray | np.float64:
    """Angles (rad, any shape), wrapped to [-pi, pi)."""
    return (np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi


def wrapped_deg(angle_rad: float) -> float:
    """An angle as it is told: degrees in (-180, 180], never -0."""
    return float(-np.rad2deg(wrap_angle(-angle_rad))) + 0.0


def fit_rigid(
    source: Float[np.ndarray, "n 3"],
    target: Float[np.ndarray, "n 3"],
    weights: Float[np.ndarray, " n"] | None = None,
) -> Float[np.ndarray, "4 4"]:
    """Least-squares rigid `target_from_source` of n >= 3 point pairs (Kabsch, Umeyama)."""
    source, target = source.astype(float, copy=False), target.astype(float, copy=False)
    w = np.ones(len(source)) if weights is None else weights.astype(float, copy=False)
    w = w / w.sum()
    source_mean, target_mean = w @ source, w @ target
    covariance = (target - target_mean).T @ ((source - source_mean) * w[:, None])
    rotation = project_to_so3(covariance)
    return make_transform(rotation, target_mean - rotation @ source_mean)
