"""Rigid transforms as 4x4 matrices, and their tangent vectors.

A transform named `target_from_source` maps points of the source frame into the target frame.
A tangent vector is `(rotation, translation)`, in radians and metres, in the target's axes:
`retract(T, delta) = [exp(rotation) R | t + translation]`. The point `y = R p + t` then moves, to first
order, by `rotation x (R p) + translation`. This is the chart of SO(3) x R^3, not the exponential of
SE(3): a turn is about the source's own origin (the camera), so turns and shifts stay of one scale
however far a building lies from the origin of its plan.
"""

import numpy as np
from scipy.spatial.transform import Rotation

_SMALL_ANGLE_SQ = 1e-8


def transform(target_from_source: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Map points (..., n, 3) by transforms (..., 4, 4); leading axes broadcast."""
    rotation = target_from_source[..., :3, :3]
    return points @ np.swapaxes(rotation, -1, -2) + target_from_source[..., None, :3, 3]


def transform_each(target_from_sources: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Map points (n, 3), each by its own transform (n, 4, 4)."""
    turned = np.einsum("nij,nj->ni", target_from_sources[:, :3, :3], points)
    return turned + target_from_sources[:, :3, 3]


def inverse(target_from_source: np.ndarray) -> np.ndarray:
    """Inverse of rigid transforms (..., 4, 4)."""
    source_from_target = np.zeros_like(target_from_source)
    rotation_t = np.swapaxes(target_from_source[..., :3, :3], -1, -2)
    source_from_target[..., :3, :3] = rotation_t
    source_from_target[..., :3, 3] = -(rotation_t @ target_from_source[..., :3, 3:])[..., 0]
    source_from_target[..., 3, 3] = 1.0
    return source_from_target


def make_transform(rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """Stack rotations (..., 3, 3) and translations (..., 3) into transforms (..., 4, 4)."""
    rotation = np.asarray(rotation, dtype=float)
    translation = np.asarray(translation, dtype=float)
    result = np.zeros((*np.broadcast_shapes(rotation.shape[:-2], translation.shape[:-1]), 4, 4))
    result[..., :3, :3] = rotation
    result[..., :3, 3] = translation
    result[..., 3, 3] = 1.0
    return result


def skew(vectors: np.ndarray) -> np.ndarray:
    """Cross-product matrices (..., 3, 3) of vectors (..., 3): `skew(a) @ b == a x b`."""
    result = np.zeros((*vectors.shape, 3))
    result[..., 0, 1], result[..., 0, 2] = -vectors[..., 2], vectors[..., 1]
    result[..., 1, 0], result[..., 1, 2] = vectors[..., 2], -vectors[..., 0]
    result[..., 2, 0], result[..., 2, 1] = -vectors[..., 1], vectors[..., 0]
    return result


def exp_so3(rotation_vectors: np.ndarray) -> np.ndarray:
    """Rotations (..., 3, 3) of rotation vectors (..., 3) in radians (Rodrigues)."""
    theta_sq = np.sum(rotation_vectors**2, axis=-1)[..., None, None]
    small = theta_sq < _SMALL_ANGLE_SQ
    theta = np.sqrt(np.where(small, 1.0, theta_sq))  # safe first: 0/0 would poison both branches
    a = np.where(small, 1.0 - theta_sq / 6.0, np.sin(theta) / theta)
    b = np.where(small, 0.5 - theta_sq / 24.0, (1.0 - np.cos(theta)) / theta**2)
    k = skew(rotation_vectors)
    return np.eye(3) + a * k + b * (k @ k)


def log_so3(rotations: np.ndarray) -> np.ndarray:
    """Rotation vectors (..., 3) in radians of rotations (..., 3, 3); safe at 0 and at pi."""
    flat = Rotation.from_matrix(rotations.reshape(-1, 3, 3)).as_rotvec()
    return flat.reshape(*rotations.shape[:-2], 3)


def retract(target_from_source: np.ndarray, delta: np.ndarray) -> np.ndarray:
    """Apply tangent vectors (..., 6) [rad, m] to transforms (..., 4, 4); see the module's page."""
    return make_transform(
        exp_so3(delta[..., :3]) @ target_from_source[..., :3, :3],
        target_from_source[..., :3, 3] + delta[..., 3:],
    )


def difference(to_target: np.ndarray, from_target: np.ndarray) -> np.ndarray:
    """Tangent vectors (..., 6) with `retract(from_target, difference) == to_target`."""
    turn = to_target[..., :3, :3] @ np.swapaxes(from_target[..., :3, :3], -1, -2)
    return np.concatenate([log_so3(turn), to_target[..., :3, 3] - from_target[..., :3, 3]], axis=-1)


def project_to_so3(matrices: np.ndarray) -> np.ndarray:
    """Nearest rotations (..., 3, 3) in the Frobenius norm."""
    u, _, vt = np.linalg.svd(matrices)
    sign = np.ones(matrices.shape[:-1])
    sign[..., 2] = np.sign(np.linalg.det(u @ vt))
    return (u * sign[..., None, :]) @ vt


def rotation_angle(rotations: np.ndarray) -> np.ndarray | np.float64:
    """Angles (...,) in radians of rotations (..., 3, 3)."""
    return np.linalg.norm(log_so3(rotations), axis=-1)


def rotation_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Smallest rotation (3, 3) that takes direction a (3,) to direction b (3,)."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    axis, cosine = np.cross(a, b), float(a @ b)
    sine = float(np.linalg.norm(axis))
    if cosine < 0 and sine < 1e-8:
        # Half a turn: any axis across `a` will do; take the one furthest from it. What the cross
        # product holds of the axis is rounding; what is left to `b` is a small turn, well defined.
        across = np.cross(a, np.eye(3)[np.argmin(np.abs(a))])
        return rotation_between(-a, b) @ exp_so3(np.pi * across / np.linalg.norm(across))
    if sine < 1e-12:
        return np.eye(3)
    return exp_so3(axis / sine * np.arctan2(sine, cosine))


def yaw_transform(yaw: float, shift: np.ndarray | None = None) -> np.ndarray:
    """Transform (4, 4) that turns about +z by `yaw` (rad), then shifts by (3,) m."""
    return make_transform(
        exp_so3(np.array([0.0, 0.0, yaw])), np.zeros(3) if shift is None else shift
    )


def fit_rigid(
    source: np.ndarray, target: np.ndarray, weights: np.ndarray | None = None
) -> np.ndarray:
    """Least-squares rigid `target_from_source` (4, 4) of point pairs (n, 3), n >= 3 (Kabsch, Umeyama)."""
    w = np.ones(len(source)) if weights is None else weights
    w = w / w.sum()
    source_mean, target_mean = w @ source, w @ target
    covariance = (target - target_mean).T @ ((source - source_mean) * w[:, None])
    rotation = project_to_so3(covariance)
    return make_transform(rotation, target_mean - rotation @ source_mean)
