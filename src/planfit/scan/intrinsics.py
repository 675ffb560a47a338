"""Cameras from the numbers that files hold."""

import numpy as np
from jaxtyping import Float

from planfit.errors import ScanError
from planfit.geometry.camera import Camera

MAX_SIZE_PX = 100_000
MIN_FOCAL_SHARE = 0.02
"""Of a side of the image; fisheyes of 220 degrees have 0.26. Matrices that nobody filled in are the
identity."""
MAX_INTRINSIC_PX = 1e7
"""Far beyond cameras of at most that size; pixels of others are no numbers of an array."""


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
    return (
        float(matrix[0, 0]),
        float(matrix[1, 1]),
        float(matrix[0, 2]),
        float(matrix[1, 2]),
    )
