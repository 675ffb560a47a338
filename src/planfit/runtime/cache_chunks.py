"""Arrays of some items as one file of the cache: written whole or not at all, believed by its checksum alone.

The checksum is of the content and of the place: stage, key of all that the result depends on, first item. A
file that was cut, flipped, put in another's place or written by another program is no file: its items are
computed again. Large arrays may stay there until they are asked for.
"""

import hashlib
import json
import os
import shutil
import tempfile
import weakref
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from planfit.errors import OutputError
from planfit.runtime.whole_files import whole_file

Arrays = dict[str, np.ndarray]
SUFFIX = ".chunk"
_MAGIC = b"planfit chunk 2\n"
_DIGEST_BYTES, _LENGTH_BYTES = 16, 8


class DamagedChunk(Exception):
    """A file is not exactly what was written to its place."""


class TemporaryFolder:
    """A folder among the system's temporary files, which goes when nothing refers to this any more."""

    def __init__(self) -> None:
        """Make it.

        Raises:
            OutputError: it cannot be made.
        """
        try:
            self.path = Path(tempfile.mkdtemp(prefix="planfit-"))
        except OSError as error:
            raise OutputError(
                f"{tempfile.gettempdir()}: no temporary folder can be made ({error.strerror}); free disk "
                "space, or set TMPDIR to another place"
            ) from error
        weakref.finalize(self, shutil.rmtree, self.path, ignore_errors=True)


@dataclass(frozen=True)
class StoredArray:
    """An array that stays in a file, from which it is read each time it is asked for."""

    path: Path
    begin: int
    """Bytes of the file before it."""
    dtype: np.dtype
    shape: tuple[int, ...]
    keeper: object = field(default=None, repr=False)
    """What has to live as long as the file does: the owner of a temporary folder."""

    def __len__(self) -> int:
        return self.shape[0]

    def read(self) -> np.ndarray:
        """The array, with memory of its own.

        Raises:
            OutputError: the file is gone, or shorter than it was.
        """
        count = int(np.prod(self.shape))
        try:
            flat = np.fromfile(self.path, self.dtype, count, offset=self.begin)
        except OSError as error:
            raise self._lost(error.strerror or str(error)) from error
        if len(flat) < count:
            raise self._lost("it was cut")
        return flat.reshape(self.shape)

    def __getitem__(self, rows: slice | np.ndarray) -> np.ndarray:
        """Some of its rows, read."""
        return self.read()[rows]

    def _lost(self, why: str) -> OutputError:
        return OutputError(
            f"{self.path}: expected what this run kept there, found {why}; run again, and leave the cache "
            "alone while it runs"
        )


@dataclass(frozen=True)
class StoredItem:
    """Arrays of an item, the large ones where they are stored."""

    arrays: Arrays
    stored: dict[str, StoredArray]


def write_chunk(path: Path, items: list[Arrays]) -> list[dict[str, StoredArray]]:
    """Write named arrays of items; returns where each lies.

    After the magic: BLAKE2 of the place and the rest, the length of the index, the index (JSON: how many
    items; item, name, type and shape of each array), the arrays. As members of an archive each array would
    cost 0.3 ms to find and to read, and a scan has thousands of small ones.

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
        file.write(_MAGIC + _digest(path, parts))
        file.writelines(parts)
    content = len(_MAGIC) + _DIGEST_BYTES + _LENGTH_BYTES + len(index)
    return _located(path, len(items), table, content)


def read_chunk(path: Path, n_items: int, stored: Collection[str] = ()) -> list[StoredItem] | None:
    """The arrays of `n_items`, each with memory of its own, but those of the names `stored` stay in the file;
    None where there is no such file.

    Raises:
        DamagedChunk: it is not exactly what was written there, or holds another number of items.
    """
    if not path.is_file():  # nor a pipe
        return None
    try:
        data = memoryview(path.read_bytes())
    except OSError:
        return None
    begin = len(_MAGIC) + _DIGEST_BYTES
    if data[: len(_MAGIC)] != _MAGIC or data[len(_MAGIC) : begin] != _digest(path, [data[begin:]]):
        raise DamagedChunk(path)
    at = begin + _LENGTH_BYTES
    content = at + int.from_bytes(data[begin:at], "little")
    index = json.loads(bytes(data[at:content]))
    if index["items"] != n_items:
        raise DamagedChunk(path)
    located = _located(path, n_items, index["arrays"], content)
    return [
        StoredItem(
            {name: _copied(data, at) for name, at in item.items() if name not in stored},
            {name: at for name, at in item.items() if name in stored},
        )
        for item in located
    ]


def _located(
    path: Path, n_items: int, table: Sequence[Sequence], content: int
) -> list[dict[str, StoredArray]]:
    """Where the arrays of each item lie, by the file's table and the bytes before the first of them."""
    items: list[dict[str, StoredArray]] = [{} for _ in range(n_items)]
    for i, name, kind, shape in table:
        items[i][name] = StoredArray(path, content, np.dtype(kind), tuple(shape))
        content += items[i][name].dtype.itemsize * int(np.prod(shape))
    return items


def _copied(data: memoryview, at: StoredArray) -> np.ndarray:
    """A copy of an array of a file's data: what a stage does not keep must not stay for what it does."""
    array = np.zeros(at.shape, at.dtype)
    array.reshape(-1).view(np.uint8)[:] = np.frombuffer(data, np.uint8, array.nbytes, at.begin)
    return array


def _digest(path: Path, parts: list[bytes] | list[memoryview]) -> bytes:
    """Of a place, as the folder of stage and key and the file's name have it, and what is written there."""
    digest = hashlib.blake2b(
        f"{path.parent.name}/{path.name}\n".encode(), digest_size=_DIGEST_BYTES
    )
    for part in parts:
        digest.update(part)
    return digest.digest()
