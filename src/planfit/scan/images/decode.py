"""Image files to arrays, with errors that name the file."""

import io
import math
import re
import struct
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, Shaped, UInt8
from PIL import Image

from planfit.compiled import kernel
from planfit.errors import ScanError
from planfit.scan.tables import shorten

N_DEPTH_FRAMES = 9
"""So many frames tell the unit of a scan's depth."""
USUAL_DEPTH_M = (0.2, 20.0)
"""The middle of what a depth camera sees in a building lies between these."""
MAX_PIXELS = 100_000_000
"""No depth camera has more; a damaged header may claim anything."""
_PNG = b"\x89PNG\r\n\x1a\n"
_EXR = b"\x76\x2f\x31\x01"
_WINDOW = b"dataWindow\0box2i\0" + struct.pack("<i", 16)


def decode_image(data: bytes, path: Path, flags: int) -> Shaped[np.ndarray, "h w *channels"]:
    """Decode the bytes of an image file, which messages call `path`, by OpenCV's read `flags`.

    Raises:
        ScanError: they are truncated, no image, or claim to be larger than any camera's.
    """
    _check_claims(data, path)
    image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags) if data else None
    if image is None:
        raise ScanError(
            f"{path}: expected an image, found {len(data)} bytes that cannot be decoded; "
            "copy it again from the source"
        )
    return image


def _check_claims(data: bytes, path: Path) -> None:
    """Refuse what OpenCV would make room for before it looks: pixels of a JPEG (5 GB for 30,000 squared, in
    23 s), and chunks of a PNG that are longer than the file."""
    try:
        with Image.open(io.BytesIO(data)) as image:
            n_pixels = math.prod(image.size)
    except Image.DecompressionBombError:  # Pillow's own bound is higher
        n_pixels = MAX_PIXELS + 1
    except Exception:
        return  # none that Pillow knows; OpenCV tells whether it does
    if n_pixels > MAX_PIXELS:
        raise ScanError(
            f"{path}: expected an image of at most {MAX_PIXELS:,} pixels, found a header that says more; "
            "copy it again from the source"
        )
    at = len(_PNG) if data.startswith(_PNG) else len(data)
    while at + 8 <= len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        if length > len(data) - at - 8:
            raise ScanError(
                f"{path}: expected a whole PNG, found {len(data) - at - 8:,} bytes where {length:,} should "
                "follow; copy it again from the source"
            )
        at += 12 + length


def decode_color(data: bytes, path: Path) -> UInt8[np.ndarray, "h w 3"]:
    """Colour image, RGB, as stored: a mark that says "turn me" is not followed."""
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    return cv2.cvtColor(decode_image(data, path, flags), cv2.COLOR_BGR2RGB)


def decode_depth(
    data: bytes, metres_per_unit: float, path: Path, metres_per_float: float = 1.0
) -> Float[np.ndarray, "h w"]:
    """The bytes of a depth image of 16-bit or floating-point numbers (TIFF), or of a `.npy` array, to float32
    m, NaN where nothing was measured.

    Args:
        data: of the file.
        metres_per_unit: of whole numbers.
        path: for messages; its suffix tells the kind.
        metres_per_float: of floating-point numbers.

    Raises:
        ScanError: they are neither.
    """
    if path.suffix.lower() == ".npy":
        try:
            raw = np.load(io.BytesIO(data), allow_pickle=False)
        except (ValueError, OSError, EOFError) as error:
            raise ScanError(f"{path}: expected an array of depth, found {error}") from error
        raw = raw.squeeze()
    elif path.suffix.lower() == ".bin":
        raw = read_dense_map(data, path)
    else:
        raw = decode_image(data, path, cv2.IMREAD_UNCHANGED)
    if raw.ndim == 2 and raw.dtype.kind == "f":
        return depth_from_metres(raw * metres_per_float)
    return depth_from_raw(raw, metres_per_unit, path)


def read_dense_map(data: bytes, path: Path) -> Float[np.ndarray, "h w"]:
    """Depth as COLMAP's patch_match_stereo writes it: `width&height&1&`, then float32 by row.

    Raises:
        ScanError: it is none.
    """
    head = re.match(rb"(\d{1,6})&(\d{1,6})&1&", data)
    width, height = (int(number) for number in head.groups()) if head else (0, 0)
    begin = head.end() if head else 0
    if not width * height or len(data) - begin != 4 * width * height:
        raise ScanError(
            f"{path}: expected depth as COLMAP writes it (width&height&1& and as many numbers), found other "
            "bytes; copy it again from the source"
        )
    return np.frombuffer(data, "<f4", width * height, begin).reshape(height, width)


def depth_from_raw(raw: np.ndarray, metres_per_unit: float, path: Path) -> Float[np.ndarray, "h w"]:
    """16-bit depth to float32 m; 0 and 65535 stand where nothing was measured and become NaN.

    Raises:
        ScanError: the image is not 16-bit with one channel.
    """
    if raw.ndim != 2 or raw.dtype != np.uint16:
        raise ScanError(
            f"{path}: expected a 16-bit depth image with one channel, found {raw.dtype} "
            f"of shape {raw.shape}; export depth as 16-bit PNG in millimetres"
        )
    depth = raw.astype(np.float32) * np.float32(metres_per_unit)
    depth[(raw == 0) | (raw == 65535)] = np.nan
    return depth


def depth_from_metres(depth: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    """Depth m as float32, a copy; what is not a positive finite number becomes NaN."""
    depth = np.array(depth, dtype=np.float32)
    depth[~(np.isfinite(depth) & (depth > 0))] = np.nan
    return depth


def depth_from_inverse(raw: np.ndarray, a: float, b: float) -> Float[np.ndarray, "h w"]:
    """Depth a / (raw - b) as float32 m, as ROS and RTAB-Map quantise it; 0 where nothing was measured."""
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(raw > 0, a / (raw.astype(np.float32) - np.float32(b)), np.nan)
    return depth_from_metres(depth)


def decode_rvl(data: bytes, width: int, height: int, path: Path) -> Shaped[np.ndarray, "h w"]:
    """16-bit depth in Wilson's RVL code (Fast Lossless Depth Image Compression, ISS 2017): runs of zeros and
    of differences, as numbers of a varying count of nibbles in 32-bit words.

    Raises:
        ScanError: it ends early, or is longer than the image.
    """
    count = width * height
    words = np.frombuffer(data[: len(data) // 4 * 4], "<u4")
    pixels = np.zeros(count if count < MAX_PIXELS else 0, np.uint16)
    if not len(pixels) or not _unpack_rvl(words, pixels):
        raise ScanError(
            f"{path}: expected {width} x {height} px of depth in RVL code, found a damaged one; copy it "
            "again from the source"
        )
    return pixels.reshape(height, width)


@kernel
def _unpack_rvl(words: np.ndarray, pixels: np.ndarray) -> bool:
    """Fill the pixels; whether the words are those of so many."""
    at, previous, nibble = 0, 0, 0
    while at < len(pixels):
        n_zeros, nibble = _rvl_number(words, nibble)
        n_differences, nibble = _rvl_number(words, nibble)
        at += n_zeros
        if min(n_zeros, n_differences) < 0 or at + n_differences > len(pixels):
            return False
        for _ in range(n_differences):
            value, nibble = _rvl_number(words, nibble)
            if value < 0:
                return False
            previous += (value >> 1) ^ -(value & 1)
            pixels[at] = previous
            at += 1
    return True


@kernel
def _rvl_number(words: np.ndarray, nibble: int) -> tuple[int, int]:
    """A number of three bits a nibble, lowest first, and the nibble behind it; -1 where the words end."""
    value, shift = 0, 0
    while nibble < 8 * len(words) and shift < 30:
        four = (int(words[nibble // 8]) >> (28 - 4 * (nibble % 8))) & 15
        nibble += 1
        value |= (four & 7) << shift
        shift += 3
        if four < 8:
            return value, nibble
    return -1, nibble


def header_size(data: bytes, path: Path) -> tuple[int, int]:
    """(width, height) from the first bytes of an image file.

    Raises:
        ScanError: they begin no image.
    """
    try:
        with Image.open(io.BytesIO(data)) as image:
            return image.size
    # Pillow raises what its formats' parsers come across: ValueError for a header that is cut, for one.
    except Exception as error:
        raise ScanError(
            f"{path}: expected an image, found a file that cannot be read as one; "
            "copy it again from the source"
        ) from error


def is_cut_off(head: bytes, tail: bytes) -> bool:
    """Whether a PNG or JPEG lacks its end: the usual fault, seen without decoding."""
    if head.startswith(b"\x89PNG"):
        return b"IEND" not in tail
    if head.startswith(b"\xff\xd8"):
        return b"\xff\xd9" not in tail  # anywhere in it: some cameras append notes of their own
    return False


def read_exr(file: Path, path: Path) -> Float[np.ndarray, "h w"]:
    """The depth of an OpenEXR file, its one channel or the first of three; messages call it `path`.

    Record3D and newer versions of 3D Scanner App write it, in metres.

    Raises:
        ScanError: the file is none, or the library OpenEXR is missing.
    """
    try:
        import OpenEXR  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise ScanError(
            f"{path}: expected the library OpenEXR for depth as EXR, found none; pip install "
            "'planfit[record3d]'"
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


def exr_size(head: bytes, path: Path) -> tuple[int, int]:
    """Width and height that the first bytes of an OpenEXR file tell.

    Raises:
        ScanError: they are none of such a file.
    """
    at = head.find(_WINDOW)
    if not head.startswith(_EXR) or at < 0 or len(head) < at + len(_WINDOW) + 16:
        raise ScanError(
            f"{path}: expected an OpenEXR image, found other bytes; copy it again from the source"
        )
    left, top, right, bottom = struct.unpack_from("<4i", head, at + len(_WINDOW))
    return right - left + 1, bottom - top + 1
