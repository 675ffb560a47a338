"""Rows of numbers that lie in a file and are looked at through a memory map.

They are ordinary arrays, read-only. Pages of them take memory from when they are looked at until they are let
go, so a pass in parts, each of which is let go, takes the memory of a part.
"""

import mmap
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from planfit.errors import OutputError
from planfit.runtime.cache_chunks import TemporaryFolder

MIN_BYTES = 4_000_000
"""Fewer stay in memory."""
ROWS_AT_A_TIME = 65_536
"""Bounds what a pass, or a thread, holds at a time."""
CAN_LET_GO = hasattr(mmap.mmap, "madvise") and hasattr(mmap, "MADV_DONTNEED")
"""Whether this system takes advice on maps; where it takes none (Windows), all rows stay in memory."""


def map_rows(
    parts: Iterable[Float[np.ndarray, "_ c"]], shape: tuple[int, int], dtype: np.dtype
) -> Float[np.ndarray, "m c"]:
    """Parts, taken one by one, as one array of a shape; in a temporary file where they are large.

    Raises:
        OutputError: the file cannot be written.
    """
    size = shape[0] * shape[1] * dtype.itemsize
    if size < MIN_BYTES or not CAN_LET_GO:
        return np.concatenate([np.zeros((0, shape[1]), dtype), *parts])
    keeper = TemporaryFolder()
    path = keeper.path / "rows"
    try:
        with path.open("wb") as file:
            for part in parts:
                file.write(np.ascontiguousarray(part, dtype).data)
        mapped = _Mapped(path, dtype, mode="c", shape=shape)
        assert isinstance(mapped, _Mapped)
        mapped.keeper = keeper
    except OSError as error:
        raise OutputError(
            f"{path}: {size / 1e6:.0f} MB of points cannot be kept there ({error.strerror}); free disk "
            "space, or set TMPDIR to another place"
        ) from error
    rows = mapped.view(np.ndarray)
    rows.flags.writeable = False  # what is written to a page is lost when it is let go
    return rows


def concatenated(arrays: Sequence[Float[np.ndarray, "_ c"]]) -> Float[np.ndarray, "m c"]:
    """Arrays one after the other: mapped where any of them is."""
    if not any(is_mapped(array) for array in arrays):
        return np.concatenate(arrays)
    rows = (part for array in arrays for part in row_parts(array))
    shape = (sum(map(len, arrays)), arrays[0].shape[1])
    return map_rows(rows, shape, np.result_type(*arrays))


def taken(rows: Float[np.ndarray, "m c"], idx: Int[np.ndarray, " k"]) -> Float[np.ndarray, "k c"]:
    """Some rows, in an order: mapped where they are."""
    if not is_mapped(rows):
        return rows[idx]
    parts = (idx[k : k + ROWS_AT_A_TIME] for k in range(0, len(idx), ROWS_AT_A_TIME))
    return map_rows((rows[part] for part in parts), (len(idx), rows.shape[1]), rows.dtype)


def changed(
    rows: Float[np.ndarray, "m c"],
    change: Callable[[Float[np.ndarray, "_ c"]], Float[np.ndarray, "_ c"]],
) -> Float[np.ndarray, "m c"]:
    """What a function of each row makes of them: mapped where they are."""
    if not is_mapped(rows):
        return change(rows)
    return map_rows((change(part) for part in row_parts(rows)), rows.shape, rows.dtype)


def is_mapped(array: np.ndarray) -> bool:
    """Whether an array lies in a file."""
    return _map_of(array) is not None


def row_parts(rows: Float[np.ndarray, "m ..."]) -> Iterator[Float[np.ndarray, "_ ..."]]:
    """Some rows at a time, each let go when the next are asked for."""
    for first in range(0, len(rows), ROWS_AT_A_TIME):
        part = rows[first : first + ROWS_AT_A_TIME]
        yield part
        let_go(part)


def let_go(rows: np.ndarray) -> None:
    """Give back the memory of contiguous rows of a map, and of what lies before them on their first page.

    Of other arrays, nothing. Whoever looks at them again reads them again.
    """
    whole = _map_of(rows)
    if whole is None or rows.nbytes == 0:
        return
    begin = _address(rows) - _address(whole)
    first, last = begin // mmap.PAGESIZE * mmap.PAGESIZE, begin + rows.nbytes
    if last < whole.nbytes:
        last = last // mmap.PAGESIZE * mmap.PAGESIZE
    if last > first:
        whole._mmap.madvise(mmap.MADV_DONTNEED, first, last - first)  # pyright: ignore


def for_kernels(rows: np.ndarray) -> np.ndarray:
    """The same rows for compiled loops that do not write to them.

    For arrays that are read-only these would be compiled once more.
    """
    whole = _map_of(rows)
    if whole is None:
        return rows
    begin = _address(rows) - _address(whole)
    flat = whole.view(np.ndarray).reshape(-1).view(np.uint8)[begin : begin + rows.nbytes]
    return flat.view(rows.dtype).reshape(rows.shape)


class _Mapped(np.memmap):
    """A map that keeps its file's folder."""

    keeper: Any = None


def _map_of(array: np.ndarray) -> "_Mapped | None":
    base: Any = array
    while base is not None and not isinstance(base, _Mapped):
        base = getattr(base, "base", None)
    return base


def _address(array: np.ndarray) -> int:
    return array.__array_interface__["data"][0]
