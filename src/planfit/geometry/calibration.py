"""What a depth camera gets wrong, as corrections of lifted points: depth, focal lengths, principal point."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from planfit.geometry.camera import Camera

PARAMETERS = (
    "depth_scale",
    "depth_offset_m",
    "depth_quadratic_per_m",
    "focal_scale",
    "focal_aspect",
    "principal_x",
    "principal_y",
)
"""Fields of `SensorCalibration`, in the order of vectors and matrices of parameters."""


@dataclass(frozen=True)
class SensorCalibration:
    """Corrections of one device, the same in all frames.

    A depth z that was measured is scale z + offset + quadratic z^2; the camera's true focal lengths and
    principal point follow from the nominal ones by `camera`. All of it is linear in the point that the
    nominal camera lifts, but for the quotients by the focal length.

    Raises:
        ValueError: a number is not finite, or a scale not above 0.
    """

    depth_scale: float = 1.0
    """True depth by measured depth, far away from offset and quadratic."""
    depth_offset_m: float = 0.0
    """Added to every depth."""
    depth_quadratic_per_m: float = 0.0
    """Times the square of the depth (m), added: structured light errs so."""
    focal_scale: float = 1.0
    """True focal length in x by the nominal one."""
    focal_aspect: float = 1.0
    """By so much more the focal length in y is longer than nominal."""
    principal_x: float = 0.0
    """Shift of the principal point, as a share of the nominal focal length in x."""
    principal_y: float = 0.0
    """Likewise in y."""

    def __post_init__(self) -> None:
        if not np.isfinite(self.vector).all():
            raise ValueError(f"a calibration's numbers must be finite, found {self}")
        if min(self.depth_scale, self.focal_scale, self.focal_aspect) <= 0:
            raise ValueError(f"a calibration's scales must be above 0, found {self}")

    @property
    def vector(self) -> Float[np.ndarray, " 7"]:
        """The numbers in the order of `PARAMETERS`."""
        return np.array([getattr(self, name) for name in PARAMETERS])

    @property
    def is_nominal(self) -> bool:
        """Whether nothing is corrected."""
        return self == NOMINAL

    def with_vector(self, vector: Float[np.ndarray, " 7"]) -> "SensorCalibration":
        """Another calibration, from numbers in the order of `PARAMETERS`."""
        return replace(self, **{name: float(v) for name, v in zip(PARAMETERS, vector, strict=True)})

    def after(self, depth_factor: float) -> "SensorCalibration":
        """As one with depth being multiplied by a factor before; the very same one at 1."""
        return replace(
            self,
            depth_scale=self.depth_scale * depth_factor,
            depth_quadratic_per_m=self.depth_quadratic_per_m * depth_factor**2,
        )

    def depths(self, depths_m: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
        """Depths (m) along the optical axis as they should have been measured; NaN stays NaN."""
        corrected = self.depth_scale * depths_m + self.depth_offset_m
        return corrected + self.depth_quadratic_per_m * depths_m**2

    def points(self, points_cam: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Points (m, camera frame) that were lifted with the nominal camera, as they should have been.

        The very same array where nothing is corrected.
        """
        if self.is_nominal:
            return points_cam
        z = points_cam[..., 2]
        safe = np.where(z == 0, 1.0, z)
        depth = self.depths(z)
        x = (points_cam[..., 0] / safe - self.principal_x) / self.focal_scale
        y = (points_cam[..., 1] / safe - self.principal_y) / (self.focal_scale * self.focal_aspect)
        return np.stack([x * depth, y * depth, depth], axis=-1).astype(points_cam.dtype, copy=False)

    def camera(self, nominal: Camera) -> Camera:
        """The camera as it truly is."""
        return replace(
            nominal,
            fx=nominal.fx * self.focal_scale,
            fy=nominal.fy * self.focal_scale * self.focal_aspect,
            cx=nominal.cx + nominal.fx * self.principal_x,
            cy=nominal.cy + nominal.fy * self.principal_y,
        )


NOMINAL = SensorCalibration()
"""The device as its files say."""
