"""Arrays of some items as one file of the cache: written whole or not at all, believed by its checksum alone.

A file that was cut, flipped or written by another program is no file: its items are computed again.
"""

import hashlib
import json
import os
from pathlib import Path

import numpy as np

from planfit.whole_files import whole_file

Arrays = dict[str, np.ndarray]
SUFFIX = ".chunk"
_MAGIC = b"planfit chunk 1\n"
_DIGEST_BYTES, _LENGTH_BYTES = 16, 8


def write_chunk(path: Path, items: list[Arrays]) -> None:
    """Write named arrays of items.

    After the magic: BLAKE2 of the rest, the length of the index, the index (JSON: how many items; item, name,
    type and shape of each array), the arrays. As members of an archive each array would cost 0.3 ms to find
    and to read, and a scan has thousands of small ones.

    Raises:
        OutputError: it cannot be written.
        TypeError: an array holds objects or records.
    """
    arrays = [(i, name, array) for i, item in enumerate(items) for name, array in item.items()]
    for _, name, array in arrays:
        if array.dtype.hasobject or array.dtype.names:
            raise TypeError(f"{name}: expected an array of plain values, found {array.dtype}")
    table = [(i, name, array.dtype.str, array.shape) for i, name, array in arrays]
    index = json.dumps({"items": len(items), "arrays": table}).encode()
    parts = [
        len(index).to_bytes(_LENGTH_BYTES, "little"),
        index,
        *(a.tobytes() for _, _, a in arrays),
    ]
    kept = "free disk space and run again, finished work is kept"
    # Processes that share a cache may write the same file at the same time: any of theirs may stay.
    with whole_file(path, kept, f".{os.getpid()}") as part, part.open("wb") as file:
        file.write(_MAGIC + _digest(parts))
        file.writelines(parts)


def read_chunk(path: Path, n_items: int) -> list[Arrays] | None:
    """The arrays of `n_items`, each with memory of its own; None where there is no such file, it is not
    exactly what was written, or holds another number of items."""
    try:
        data = memoryview(path.read_bytes())
    except OSError:
        return None
    begin = len(_MAGIC) + _DIGEST_BYTES
    if data[: len(_MAGIC)] != _MAGIC or data[len(_MAGIC) : begin] != _digest([data[begin:]]):
        return None
    at = begin + _LENGTH_BYTES
    content = at + int.from_bytes(data[begin:at], "little")
    index = json.loads(bytes(data[at:content]))
    if index["items"] != n_items:
        return None
    items: list[Arrays] = [{} for _ in range(n_items)]
    for i, name, kind, shape in index["arrays"]:
        array = np.zeros(shape, np.dtype(kind))
        # A copy: what a stage does not keep must not stay in memory for what it does.
        array.reshape(-1).view(np.uint8)[:] = np.frombuffer(data, np.uint8, array.nbytes, content)
        items[i][name] = array
        content += array.nbytes
    return items


def _digest(parts: list[bytes] | list[memoryview]) -> bytes:
    digest = hashlib.blake2b(digest_size=_DIGEST_BYTES)
    for part in parts:
        digest.update(part)
    return digest.digest()
