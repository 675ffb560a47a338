"""A database as a place where files lie: `image/7` and `depth/7` are blobs of node 7."""

import sqlite3
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from threading import Lock

from planfit.errors import ScanError
from planfit.scan.source import HEAD_BYTES, MAX_ENTRY_BYTES, TAIL_BYTES, fingerprint_of_file
from planfit.scan.tables import shorten

FOLDERS = ("image", "depth", "calibration")
"""Columns of the table Data that are read."""


class DatabaseSource:
    """Blobs of the table Data, by name; safe to use from several threads."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = Lock()
        try:
            self._connection = sqlite3.connect(
                f"{path.resolve().as_uri()}?mode=ro", uri=True, check_same_thread=False
            )
        except sqlite3.Error as error:
            raise ScanError(f"{path}: expected a database, cannot be opened ({error})") from error
        weakref.finalize(self, self._connection.close)

    def rows(self, query: str) -> list[tuple]:
        """What a query finds.

        Raises:
            ScanError: a table or column is missing, or the file is damaged.
        """
        with self._reading():
            return self._connection.execute(query).fetchall()

    def columns(self, table: str) -> list[str]:
        """Names of a table's columns; none where it is not there."""
        return [str(row[1]) for row in self.rows(f"PRAGMA table_info({table})")]

    def copy_to(self, path: Path) -> sqlite3.Connection:
        """A copy that can be changed, open."""
        path.unlink(missing_ok=True)
        copy = sqlite3.connect(path)
        with self._reading():
            self._connection.backup(copy)
        return copy

    def names(self, folder: str = "") -> list[str]:
        """See `FileSource`: numbers of the nodes that have the blob."""
        return sorted(self._lengths.get(folder, {}), key=int)

    def folders(self) -> list[str]:
        """See `FileSource`."""
        return sorted(FOLDERS)

    def exists(self, name: str) -> bool:
        """See `FileSource`."""
        folder, _, number = name.partition("/")
        return number in self._lengths.get(folder, {})

    def read(self, name: str) -> bytes:
        """See `FileSource`."""
        return self._part(name, 0, self._length(name))

    def ends(self, name: str) -> tuple[bytes, bytes]:
        """See `FileSource`; the rest of the blob stays on the disk."""
        length = self._length(name)
        tail = min(length, TAIL_BYTES)
        return self._part(name, 0, min(length, HEAD_BYTES)), self._part(name, length - tail, tail)

    def stamp(self, name: str) -> str:
        """See `FileSource`: that of the whole file."""
        return f"{self._length(name)} {self._stamp}"

    def locate(self, name: str) -> Path:
        """See `FileSource`."""
        return self.path / name

    def on_disk(self, name: str) -> Path:
        """See `FileSource`; nothing of a database needs it."""
        raise ScanError(f"{self.path}: expected {name} as a file, found it in a database")

    @cached_property
    def _stamp(self) -> str:
        return fingerprint_of_file(self.path)

    @cached_property
    def _lengths(self) -> dict[str, dict[str, int]]:
        found = {}
        for folder in FOLDERS:
            query = f"SELECT id, length({folder}) FROM Data WHERE length({folder}) > 0"
            found[folder] = {str(number): int(length) for number, length in self.rows(query)}
        return found

    def _length(self, name: str) -> int:
        folder, _, number = name.partition("/")
        length = self._lengths.get(folder, {}).get(number)
        if length is None or length > MAX_ENTRY_BYTES:
            raise ScanError(f"{self.path}: expected {name}, found {length or 'no'} bytes")
        return length

    def _part(self, name: str, begin: int, count: int) -> bytes:
        folder, _, number = name.partition("/")
        with (
            self._reading(),
            self._connection.blobopen("Data", folder, int(number), readonly=True) as blob,
        ):
            blob.seek(begin)
            return blob.read(count)

    @contextmanager
    def _reading(self) -> Iterator[None]:
        try:
            with self._lock:
                yield
        except (sqlite3.Error, OverflowError, UnicodeDecodeError) as error:
            raise ScanError(
                f"{self.path}: expected a database of RTAB-Map, found one that cannot be read "
                f"({shorten(error)}); copy it again, or run rtabmap-recovery"
            ) from error
