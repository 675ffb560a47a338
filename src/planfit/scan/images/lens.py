"""Lenses of recorded images, and the way from them to the pinhole camera that all stages see.

Colour and depth are brought to one pinhole camera once, when a frame is read: matching, structure, adjustment
and export then know no lens, and 640 x 480 px of one remap take 2 ms (docs/adr/0007-scan-formats.md).
"""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from planfit.errors import ScanError
from planfit.geometry.camera import Camera

MAX_SIZE_PX = 100_000
MIN_FOCAL_SHARE = 0.02
"""Of a side of the image; fisheyes of 220 degrees have 0.26. Matrices that nobody filled in are the
identity."""
MAX_INTRINSIC_PX = 100 * MAX_SIZE_PX
"""Far beyond cameras of at most that size; pixels of others are no numbers of an array."""


@dataclass(frozen=True, slots=True)
class Lens:
    """Intrinsics of stored images, with distortion."""

    camera: Camera
    distortion: tuple[float, ...] = ()
    """OpenCV's k1 k2 p1 p2 [k3 [k4 k5 k6]], or four fisheye coefficients."""
    is_fisheye: bool = False

    @property
    def is_distorted(self) -> bool:
        """Whether any coefficient is not zero."""
        return self.is_fisheye or any(self.distortion)

    def scaled(self, width: int, height: int) -> "Lens":
        """The same lens for images resized to width x height."""
        if (width, height) == (self.camera.width, self.camera.height):
            return self  # to the last bit, so that nothing is resampled
        return Lens(self.camera.scaled(width, height), self.distortion, self.is_fisheye)

    def pixels(self, rays: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
        """Where rays with z = 1 fall in the stored image: uv px."""
        camera = self.camera
        if not self.is_distorted:
            return rays[:, :2] * [camera.fx, camera.fy] + [camera.cx, camera.cy]
        matrix, coefficients = camera.matrix, np.array(self.distortion, dtype=float)
        if self.is_fisheye:
            uv, _ = cv2.fisheye.projectPoints(
                rays.reshape(1, -1, 3), np.zeros(3), np.zeros(3), matrix, coefficients
            )
        else:
            uv, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, coefficients)
        return uv.reshape(-1, 2)


def working_camera(color: Lens, depth: Lens, size_px: int | None) -> Camera:
    """The pinhole camera that a frame's colour and depth are brought to.

    As large as the colour, but its longer side is at most `size_px`, or without one at most that of VGA or of
    the depth: more pixels than either cost time in every stage and bring neither matches nor depth.
    """
    camera = color.camera
    long_side = max(camera.width, camera.height)
    limit = size_px or max(640, depth.camera.width, depth.camera.height)
    if long_side <= limit:
        return camera
    width, height = (round(v * limit / long_side) for v in (camera.width, camera.height))
    return camera.scaled(width, height)


def resample_color(
    image: UInt8[np.ndarray, "h w 3"], lens: Lens, camera: Camera
) -> UInt8[np.ndarray, "h2 w2 3"]:
    """Colour as `camera` would have seen it; black where the lens saw nothing."""
    if lens.camera == camera and not lens.is_distorted:
        return image
    size = (camera.width, camera.height)
    if not lens.is_distorted and lens.camera.scaled(*size) == camera:
        return cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    # Shrink first: bilinear sampling of an image twice too large would alias.
    shrink = min(lens.camera.width / size[0], lens.camera.height / size[1])
    if shrink > 1.5:
        small = lens.scaled(round(lens.camera.width / shrink), round(lens.camera.height / shrink))
        image = cv2.resize(
            image, (small.camera.width, small.camera.height), interpolation=cv2.INTER_AREA
        )
        lens = small
    return cv2.remap(image, *_float_maps(lens, camera), cv2.INTER_LINEAR)


def resample_depth(
    depth: Float[np.ndarray, "h w"], lens: Lens, camera: Camera
) -> Float[np.ndarray, "h2 w2"]:
    """Depth m as `camera` would have seen it, NaN where the lens saw nothing.

    Each pixel takes one stored measurement, the nearest: a mean across an edge would be a point in mid-air.
    """
    return _resample_nearest(depth, lens, camera, np.nan)


def resample_labels(
    labels: UInt8[np.ndarray, "h w"], lens: Lens, camera: Camera
) -> UInt8[np.ndarray, "h2 w2"]:
    """Labels as `camera` would have seen them, each the nearest stored one; 0 where the lens saw nothing."""
    return _resample_nearest(labels, lens, camera, 0)


def _resample_nearest(image: np.ndarray, lens: Lens, camera: Camera, outside: float) -> np.ndarray:
    if lens.camera == camera and not lens.is_distorted:
        return image
    u, v = _nearest(lens, camera)
    result = image[v, u]
    is_outside = _is_outside(lens, camera)
    if is_outside is not None:
        result[is_outside] = outside
    return result


# Most scans have one lens; per-frame intrinsics pass through without being kept long.


@lru_cache(maxsize=8)
def _float_maps(
    lens: Lens, camera: Camera
) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
    """Columns and rows of the stored image that the camera's pixels fall on."""
    shape = (camera.height, camera.width)
    v, u = np.indices(shape).astype(float)
    rays = camera.rays(np.stack([u.ravel(), v.ravel()], axis=1))
    uv = lens.pixels(rays).astype(np.float32)
    return uv[:, 0].reshape(shape), uv[:, 1].reshape(shape)


@lru_cache(maxsize=8)
def _nearest(lens: Lens, camera: Camera) -> tuple[Int[np.ndarray, "*u"], Int[np.ndarray, "*v"]]:
    """Column and row of the nearest stored pixel: index arrays that broadcast to (h, w)."""
    # floor(x + 0.5) and not rint, which takes halves to even numbers: it would use some columns twice and
    # skip others.
    u, v = _places(lens, camera)
    return (
        np.clip(np.floor(u + 0.5), 0, lens.camera.width - 1).astype(np.intp),
        np.clip(np.floor(v + 0.5), 0, lens.camera.height - 1).astype(np.intp),
    )


@lru_cache(maxsize=8)
def _is_outside(lens: Lens, camera: Camera) -> Bool[np.ndarray, "h w"] | None:
    """Pixels of the camera that the stored image does not show; None where it shows all."""
    width, height = lens.camera.width, lens.camera.height
    u, v = _places(lens, camera)
    # A rounding error must not cost the outermost row of an image that was only resized.
    slack = 0.5 + 1e-6
    outside = (u < -slack) | (u > width - 1 + slack) | (v < -slack) | (v > height - 1 + slack)
    return outside if outside.any() else None


def _places(lens: Lens, camera: Camera) -> tuple[Float[np.ndarray, "*u"], Float[np.ndarray, "*v"]]:
    """As `_float_maps`, in arrays that broadcast to (h, w): without distortion u depends on the column alone,
    and v on the row."""
    if lens.is_distorted:
        return _float_maps(lens, camera)
    stored = lens.camera
    u = (np.arange(camera.width) - camera.cx) * (stored.fx / camera.fx) + stored.cx
    v = (np.arange(camera.height) - camera.cy) * (stored.fy / camera.fy) + stored.cy
    return u[None, :], v[:, None]


def make_camera(width: object, height: object, intrinsics: object, where: str) -> Camera:
    """Camera from what a file says of its size and of fx fy cx cy, integer pixels being pixel centres.

    Raises:
        ScanError: they cannot be those of a camera; it begins with `where`.
    """
    try:
        # Whatever a file may hold is taken; float() and the unpacking refuse what is no number.
        size = [float(v) for v in (width, height)]  # type: ignore[arg-type]
        fx, fy, cx, cy = (float(v) for v in intrinsics)  # type: ignore[attr-defined]
        if max(size) > MAX_SIZE_PX:
            raise ValueError(f"width and height must be at most {MAX_SIZE_PX}")
        camera = Camera(int(size[0]), int(size[1]), fx, fy, cx, cy)
        is_short = fx < MIN_FOCAL_SHARE * size[0] or fy < MIN_FOCAL_SHARE * size[1]
        if is_short or max(abs(v) for v in (fx, fy, cx, cy)) > MAX_INTRINSIC_PX:
            raise ValueError(f"found fx fy cx cy of {fx:.3g} {fy:.3g} {cx:.3g} {cy:.3g} px")
        return camera
    except (ValueError, TypeError, OverflowError) as error:
        raise ScanError(
            f"{where}: expected usable intrinsics (w h fx fy cx cy), {error}; "
            "export the calibration again"
        ) from error


def matrix_intrinsics(
    matrix: Float[np.ndarray, "rows columns"], where: str
) -> tuple[float, float, float, float]:
    """fx fy cx cy of a calibration matrix (3, 3) or (4, 4).

    Raises:
        ScanError: it is no such matrix.
    """
    if matrix.shape not in ((3, 3), (4, 4)):
        raise ScanError(f"{where}: expected a 3x3 matrix of intrinsics, found shape {matrix.shape}")
    return (float(matrix[0, 0]), float(matrix[1, 1]), float(matrix[0, 2]), float(matrix[1, 2]))
