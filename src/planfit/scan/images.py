"""Image files to arrays, with errors that name the file."""

from pathlib import Path

import cv2
import numpy as np
from PIL import Image, UnidentifiedImageError

from planfit.errors import ScanError


def image_size(path: Path) -> tuple[int, int]:
    """(width, height) from the header, without decoding.

    Raises:
        ScanError: the file is not an image.
    """
    try:
        with Image.open(path) as image:
            return image.size
    except (UnidentifiedImageError, Image.DecompressionBombError, OSError) as error:
        raise ScanError(
            f"{path}: expected an image, found a file that cannot be read as one ({error}); "
            "copy it again from the source"
        ) from error


def read_image(path: Path, flags: int) -> np.ndarray:
    """Decode an image with OpenCV's read `flags`.

    Raises:
        ScanError: the file is missing, truncated or not an image.
    """
    try:
        data = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    except OSError as error:
        raise ScanError(f"{path}: cannot be read ({error.strerror})") from error
    image = cv2.imdecode(data, flags) if len(data) else None
    if image is None:
        raise ScanError(
            f"{path}: expected an image, found {len(data)} bytes that cannot be decoded; "
            "copy it again from the source"
        )
    return image


def read_color(path: Path) -> np.ndarray:
    """Colour image (h, w, 3) uint8, RGB."""
    return cv2.cvtColor(read_image(path, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)


def read_depth_mm(path: Path) -> np.ndarray:
    """16-bit depth in millimetres to (h, w) float32 m; 0 and 65535 mean no reading and become NaN.

    Raises:
        ScanError: the image is not 16-bit with one channel.
    """
    raw = read_image(path, cv2.IMREAD_UNCHANGED)
    if raw.ndim != 2 or raw.dtype != np.uint16:
        raise ScanError(
            f"{path}: expected a 16-bit depth image with one channel, found {raw.dtype} "
            f"of shape {raw.shape}; export depth as 16-bit PNG in millimetres"
        )
    depth = raw.astype(np.float32) * np.float32(1e-3)
    depth[(raw == 0) | (raw == 65535)] = np.nan
    return depth
