"""Control term: points of known coordinates lie where they were surveyed.

The residual of a mark is T_i p - X, in metres along the target's axes: p the point as the camera lifted it, X
as surveyed. A point that is seen in a hundred frames is one measurement of the building, and the depth of its
marks shares its errors, so all marks of a point count as a few (ADR 3, Effective observations).
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from planfit.adjust.terms.observation_models import ObservationModel
from planfit.geometry import se3
from planfit.geometry.calibration import SensorCalibration
from planfit.lsq.residual_term import ResidualTerm
from planfit.matching.types import Rows
from planfit.runtime import short_repr

NAME = "control points"


@dataclass(frozen=True)
class ControlMarks(Rows):
    """Marks of control points, and where these points are; m marks."""

    points_cam: Float[np.ndarray, "m 3"]
    """m, axes of the camera."""
    pose_idx: Int[np.ndarray, " m"]
    """Frame of each mark."""
    point_idx: Int[np.ndarray, " m"]
    """Number of the point that each mark shows."""
    sigma_m: Float[np.ndarray, " m"]
    """Standard deviation of each coordinate, by point and depth together."""
    targets: Float[np.ndarray, "m 3"] | None = None
    """The surveyed point of each mark, m, target frame; z is NaN where the height is not known. None as long
    as nothing tells where the survey lies."""

    __repr__ = short_repr

    def corrected(self, sensor: SensorCalibration) -> "ControlMarks":
        """As the corrected sensor sees them; cameras that stood at a point are not corrected."""
        if sensor.is_nominal or len(self) == 0:
            return self
        is_camera = (self.points_cam == 0).all(axis=1)
        points = np.where(is_camera[:, None], 0.0, sensor.points(self.points_cam))
        return replace(self, points_cam=points)


def no_control_marks() -> ControlMarks:
    """Of a scan without a survey."""
    none = np.zeros(0, dtype=int)
    return ControlMarks(np.zeros((0, 3)), none, none, np.zeros(0))


def control_term(marks: ControlMarks, model: ObservationModel) -> ResidualTerm | None:
    """The term; None without marks, targets or weight."""
    if model.weight <= 0 or len(marks) == 0 or marks.targets is None:
        return None
    points, is_known = marks.points_cam, np.isfinite(marks.targets)
    targets = np.where(is_known, marks.targets, 0.0)

    def residual(poses: Float[np.ndarray, "m 1 4 4"]) -> Float[np.ndarray, "m 3"]:
        return np.where(is_known, se3.transform_each(poses[:, 0], points) - targets, 0.0)

    def jacobian(poses: Float[np.ndarray, "m 1 4 4"]) -> Float[np.ndarray, "m 3 6"]:
        # Tangents turn the pose about its own centre: d (R p) = w x R p.
        levers = np.einsum("mij,mj->mi", poses[:, 0, :3, :3], points)
        by = np.concatenate([-se3.skew(levers), np.tile(np.eye(3), (len(points), 1, 1))], axis=2)
        return np.where(is_known[:, :, None], by, 0.0)

    return ResidualTerm(
        marks.pose_idx[:, None],
        residual,
        sigma=(marks.sigma_m * _shared(marks.point_idx, model.max_observations))[:, None],
        loss=model.loss,
        jacobian=jacobian,
        weight=model.weight,
        name=NAME,
    )


def _shared(point_idx: Int[np.ndarray, " m"], most: float) -> Float[np.ndarray, " m"]:
    """Factor on the sigma of each mark, so that those of a point are worth `most` at most."""
    if len(point_idx) == 0:
        return np.zeros(0)
    counts = np.bincount(point_idx)[point_idx]
    return np.sqrt(np.maximum(counts / most, 1.0))
