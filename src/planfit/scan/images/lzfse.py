"""Apple's LZFSE streams, as Record3D stores depth and confidence."""

import struct
from pathlib import Path

from planfit.errors import ScanError

_END, _PLAIN = b"bvx$", b"bvx-"


def decompress(data: bytes, n_bytes: int, path: Path) -> bytes:
    """A stream that unpacks to `n_bytes`; one that was stored without compression is read without a library.

    Raises:
        ScanError: it unpacks to another size, is damaged, or pyliblzfse is needed and missing.
    """
    if len(data) == n_bytes:
        return data
    if not data.startswith(b"bvx"):
        raise ScanError(
            f"{path}: expected {n_bytes} bytes or an LZFSE stream, found {len(data)} other bytes; "
            "export the recording again"
        )
    found = _plain_blocks(data)
    if found is None:
        found = _by_library(data, path)
    if len(found) != n_bytes:
        raise ScanError(
            f"{path}: expected {n_bytes} bytes after unpacking, found {len(found)}; "
            "export the recording again"
        )
    return found


def _plain_blocks(data: bytes) -> bytes | None:
    """The content of a stream of stored blocks alone; None where a block is compressed."""
    blocks, at = [], 0
    while data[at : at + 4] == _PLAIN and at + 8 <= len(data):
        (size,) = struct.unpack_from("<I", data, at + 4)
        blocks.append(data[at + 8 : at + 8 + size])
        at += 8 + size
    return b"".join(blocks) if data[at : at + 4] == _END else None


def _by_library(data: bytes, path: Path) -> bytes:
    try:
        import liblzfse  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise ScanError(
            f"{path}: expected the library pyliblzfse for depth of Record3D, found none; install "
            "planfit[record3d]"
        ) from error
    try:
        return liblzfse.decompress(data)
    except Exception as error:  # the library's own error class is not documented
        raise ScanError(
            f"{path}: expected an LZFSE stream, found a damaged one ({error})"
        ) from error
