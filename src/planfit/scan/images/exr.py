"""Depth as OpenEXR, in metres: what Record3D and newer versions of 3D Scanner App write."""

import struct
from pathlib import Path

import numpy as np
from jaxtyping import Float

from planfit.errors import ScanError
from planfit.scan.recording import Size
from planfit.scan.tables import shorten

MAGIC = b"\x76\x2f\x31\x01"
_WINDOW = b"dataWindow\0box2i\0" + struct.pack("<i", 16)


def read_exr(file: Path, path: Path) -> Float[np.ndarray, "h w"]:
    """The depth of an OpenEXR file, its one channel or the first of three; messages call it `path`.

    Raises:
        ScanError: the file is none, or the library OpenEXR is missing.
    """
    try:
        import OpenEXR  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise ScanError(
            f"{path}: expected the library OpenEXR for depth as EXR, found none; install planfit[record3d]"
        ) from error
    try:
        with OpenEXR.File(str(file)) as image:
            channels = [channel.pixels for channel in image.channels().values()]
    except Exception as error:  # the library's own error class is not documented
        raise ScanError(
            f"{path}: expected an OpenEXR image, found a damaged file ({shorten(error)})"
        ) from error
    if len(channels) != 1 or channels[0].ndim not in (2, 3):
        raise ScanError(f"{path}: expected one channel of depth, found {len(channels)} channels")
    plane = channels[0] if channels[0].ndim == 2 else channels[0][..., 0]
    return np.asarray(plane, dtype=np.float32)


def exr_size(head: bytes, path: Path) -> Size:
    """Width and height that the first bytes of an OpenEXR file tell.

    Raises:
        ScanError: they are none of such a file.
    """
    at = head.find(_WINDOW)
    if not head.startswith(MAGIC) or at < 0 or len(head) < at + len(_WINDOW) + 16:
        raise ScanError(
            f"{path}: expected an OpenEXR image, found other bytes; copy it again from the source"
        )
    left, top, right, bottom = struct.unpack_from("<4i", head, at + len(_WINDOW))
    return right - left + 1, bottom - top + 1
