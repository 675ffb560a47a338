"""Refine one place of the scan on the plan: iterated closest faces with shrinking distance."""

from dataclasses import dataclass

import numpy as np

from planfit.floorplan import Floorplan
from planfit.geometry import se3

SCORE_SIGMA_M = 0.15
"""A wall this far from its face scores 0.6. As built and as drawn differ by centimetres; leftover
drift before the walls pull is about a decimetre."""


@dataclass(frozen=True)
class Fit:
    """One place of the scan on the plan."""

    yaw: float  # rad
    shift: np.ndarray  # (2,) m
    score: float
    """Mean over wall samples of exp(-d^2 / 2 sigma^2), d the distance to the nearest face that
    looks the same way."""

    @property
    def transform(self) -> np.ndarray:
        """plan_from_level (4, 4)."""
        return se3.yaw_transform(self.yaw, np.array([*self.shift, 0.0]))


def refine_fit(
    xy: np.ndarray,
    normals: np.ndarray,
    floorplan: Floorplan,
    yaw: float,
    shift: np.ndarray,
    max_samples: int = 600,
) -> Fit:
    """Move a start (yaw rad, shift (2,) m) so that wall samples (m, 2) lie on faces of the plan."""
    pick = np.unique(np.linspace(0, len(xy) - 1, max_samples).astype(int))
    xy, normals = xy[pick], normals[pick]
    centre = xy.mean(axis=0)
    for max_distance_m in (1.5, 1.0, 0.7, 0.5, 0.35, 0.35, 0.35):
        turn = rotation_2d(yaw)
        lever = (xy - centre) @ turn.T
        at = lever + turn @ centre + shift
        distance, face = nearest_faces(at, normals @ turn.T, floorplan, max_distance_m)
        ok = face >= 0
        if ok.sum() < 3:
            break
        face_normal = floorplan.normals[face[ok]]
        # About the middle of the scan, so that turn and shift barely mix.
        across = np.stack([-lever[ok, 1], lever[ok, 0]], axis=1)
        jacobian = np.column_stack([np.sum(across * face_normal, axis=1), face_normal])
        weight = 1.0 / (1.0 + (distance[ok] / (0.3 * max_distance_m)) ** 2)
        hessian = jacobian.T @ (jacobian * weight[:, None]) + 1e-6 * ok.sum() * np.eye(3)
        step = np.linalg.solve(hessian, -jacobian.T @ (weight * distance[ok]))
        middle = turn @ centre + shift + step[1:]
        yaw = float(yaw + step[0])
        shift = middle - rotation_2d(yaw) @ centre
    turn = rotation_2d(yaw)
    distance, face = nearest_faces(xy @ turn.T + shift, normals @ turn.T, floorplan, 1.0)
    closeness = np.where(face >= 0, np.exp(-0.5 * (distance / SCORE_SIGMA_M) ** 2), 0.0)
    return Fit(yaw, shift, float(closeness.mean()))


def nearest_faces(
    xy: np.ndarray, normals: np.ndarray, floorplan: Floorplan, max_distance_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Signed distance (m,) to the nearest face beside each sample that looks its way, and the face, or -1."""
    cosine = normals @ floorplan.normals.T
    looks_alike = np.where(floorplan.is_oriented, cosine, np.abs(cosine)) > np.cos(np.deg2rad(25.0))
    distance = xy @ floorplan.normals.T - floorplan.offsets
    along = (floorplan.ends[:, 1] - floorplan.ends[:, 0]) / floorplan.lengths[:, None]
    at = xy @ along.T - np.sum(floorplan.ends[:, 0] * along, axis=1)
    beside = (at > -0.3) & (at < floorplan.lengths + 0.3)
    ok = looks_alike & beside & (np.abs(distance) < max_distance_m)
    size = np.where(ok, np.abs(distance), np.inf)
    face = np.argmin(size, axis=1)
    rows = np.arange(len(xy))
    return distance[rows, face], np.where(np.isfinite(size[rows, face]), face, -1)


def rotation_2d(yaw: float) -> np.ndarray:
    """Turn (2, 2) by `yaw` rad, counter-clockwise seen from above."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s], [s, c]])
