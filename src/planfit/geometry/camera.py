"""The pinhole camera: x right, y down, z forward; uv = (column, row); integer uv is a pixel centre."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Real


@dataclass(frozen=True, slots=True)
class Camera:
    """Pinhole intrinsics in pixels of an image of `width` x `height`."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        if self.width <= 0 or self.height <= 0:
            raise ValueError(f"image size must be positive, found {self.width} x {self.height}")
        if not (np.isfinite([self.fx, self.fy, self.cx, self.cy]).all()):
            raise ValueError("fx fy cx cy must be finite numbers")
        if self.fx <= 0 or self.fy <= 0:
            raise ValueError(f"focal lengths must be positive, found fx {self.fx}, fy {self.fy}")

    @property
    def matrix(self) -> Float[np.ndarray, "3 3"]:
        """Calibration matrix: rays with z = 1 to homogeneous pixels."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def rays(self, uv: Real[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
        """Directions with z = 1, camera frame, through pixels."""
        return np.stack(
            [
                (uv[:, 0] - self.cx) / self.fx,
                (uv[:, 1] - self.cy) / self.fy,
                np.ones(len(uv)),
            ],
            axis=-1,
        )

    def lift(
        self, uv: Real[np.ndarray, "n 2"], depth: Real[np.ndarray, " n"]
    ) -> Float[np.ndarray, "n 3"]:
        """Pixels at depths (m) along the optical axis to points (m), camera frame."""
        return self.rays(uv) * np.asarray(depth, dtype=float)[:, None]

    def lift_image(self, depth: Real[np.ndarray, "h w"]) -> Float[np.ndarray, "h w 3"]:
        """Depth image (m) to points (m), camera frame; NaN stays NaN."""
        x = (np.arange(depth.shape[1]) - self.cx) / self.fx
        y = (np.arange(depth.shape[0]) - self.cy) / self.fy
        return np.stack([x[None, :] * depth, y[:, None] * depth, depth], axis=-1)

    def project(self, points_cam: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
        """Points (m) in the camera frame to pixels uv; NaN where z <= 0."""
        z = points_cam[:, 2]
        safe = np.where(z > 0, z, np.nan)
        return np.stack(
            [
                self.fx * points_cam[:, 0] / safe + self.cx,
                self.fy * points_cam[:, 1] / safe + self.cy,
            ],
            axis=-1,
        )

    def scaled(self, width: int, height: int) -> "Camera":
        """The same camera for an image resized to width x height (pixel centres at integers)."""
        sx, sy = width / self.width, height / self.height
        return Camera(
            width,
            height,
            self.fx * sx,
            self.fy * sy,
            (self.cx + 0.5) * sx - 0.5,
            (self.cy + 0.5) * sy - 0.5,
        )
