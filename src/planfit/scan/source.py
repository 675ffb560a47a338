"""Where a scan's files lie: a folder or a zip archive, read by name, never written."""

import hashlib
import os
import re
import shutil
import stat
import tempfile
import weakref
import zipfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path, PurePosixPath
from typing import Protocol, runtime_checkable

from planfit.errors import ScanError
from planfit.runtime import archive_of, leads_out, path_inside, require_content

MAX_ENTRY_BYTES = 500_000_000
"""An archive's entry that unpacks to more is no image and no table."""

MAX_UNPACKED_BYTES = 16_000_000_000
"""No video of a scan is longer; an archive may claim anything."""

HEAD_BYTES, TAIL_BYTES = 32_768, 4096
MAX_NAME = 300
"""Characters of a name that a message repeats; no file system knows longer ones."""


@runtime_checkable
class ImageSource(Protocol):
    """Images and other files by name; names are relative, with forward slashes."""

    @property
    def path(self) -> Path:
        """The folder, archive or other file that they lie in."""
        ...

    def exists(self, name: str) -> bool:
        """Whether there is a file of this name."""
        ...

    def read(self, name: str) -> bytes:
        """The bytes of a file.

        Raises:
            ScanError: it is missing or cannot be read.
        """
        ...

    def ends(self, name: str) -> tuple[bytes, bytes]:
        """The first and last few thousand bytes of a file, enough for the header of most images.

        Raises:
            ScanError: it is missing or cannot be read.
        """
        ...

    def stamp(self, name: str) -> str:
        """Size and time of a file, for the fingerprint."""
        ...

    def on_disk(self, name: str) -> Path:
        """Where the content of a file lies on this disk, for libraries that open nothing but files.

        Raises:
            ScanError: it is missing or cannot be unpacked.
        """
        ...


@runtime_checkable
class FileSource(ImageSource, Protocol):
    """A folder or archive. A name that leads elsewhere is refused, whoever asks for it: lists of files name
    what they like."""

    def names(self, folder: str = "") -> list[str]:
        """Names (without the folder) of the files directly inside a folder, sorted; none where it is not."""
        ...

    def folders(self, folder: str = "") -> list[str]:
        """Names (without the folder) of the folders directly inside a folder, sorted; at the top without."""
        ...

    def locate(self, name: str) -> Path:
        """A path that names a file for good; one that leads into an archive (`runtime.archives`), too."""
        ...


@dataclass(frozen=True)
class FolderSource:
    """A folder on disk."""

    path: Path

    def names(self, folder: str = "") -> list[str]:
        """See `FileSource`; broken and circular links are no files."""
        inside = self._at(folder)
        if not inside.is_dir():
            return []
        return sorted(item.name for item in inside.iterdir() if item.is_file())

    def folders(self, folder: str = "") -> list[str]:
        """See `FileSource`."""
        return sorted(item.name for item in self._at(folder).iterdir() if item.is_dir())

    def exists(self, name: str) -> bool:
        """See `FileSource`.

        Raises:
            ScanError: no file can have this name, or it cannot be looked for.
        """
        path = self._at(name)
        try:
            return path.is_file()
        except OSError as error:
            raise _unreadable(path, error) from error

    def read(self, name: str) -> bytes:
        """See `FileSource`."""
        path = self.on_disk(name)
        try:
            return path.read_bytes()
        except OSError as error:
            raise _unreadable(path, error) from error

    def ends(self, name: str) -> tuple[bytes, bytes]:
        """See `FileSource`."""
        path = self.on_disk(name)
        try:
            with path.open("rb") as file:
                head = file.read(HEAD_BYTES)
                size = file.seek(0, os.SEEK_END)
                file.seek(max(0, size - TAIL_BYTES))
                return head, file.read()
        except OSError as error:
            raise _unreadable(path, error) from error

    def stamp(self, name: str) -> str:
        """See `FileSource`."""
        return fingerprint_of_file(self._at(name))

    def locate(self, name: str) -> Path:
        """See `FileSource`."""
        return self._at(name)

    def on_disk(self, name: str) -> Path:
        """See `FileSource`; no pipe, whose reader would wait."""
        path = self._at(name)
        require_content(path, ScanError, "a file")
        return path

    def linked_out(self, names: Iterable[str]) -> list[str]:
        """Those that links lead out of the folder, or whose own folder they do."""
        top = self.path.resolve()
        is_out = cache(lambda path: not path.resolve().is_relative_to(top))
        paths = ((name, self.path / name) for name in names)
        return [n for n, p in paths if is_out(p.parent) or (p.is_symlink() and is_out(p))]

    def _at(self, name: str) -> Path:
        """Where a file of this name lies.

        Raises:
            ScanError: outside of the folder.
        """
        path = path_inside(self.path, name)
        if path is None:
            raise ScanError(
                f"{self.path}: expected names of files inside this folder, found {name[:MAX_NAME]!r} in one "
                "of its lists, which leads out of it; put that file inside and mend the list, or do not "
                "trust this scan"
            )
        return path


@dataclass(frozen=True)
class ZipSource:
    """A zip archive, or a folder in it, read in place; a single folder at its top is taken as the top."""

    path: Path
    """Of the archive; with the folder inside behind it, where one was asked for."""
    _lock_free: zipfile.ZipFile = field(repr=False)  # reading entries is safe from several threads
    _inner: str = ""
    """The folder inside."""

    @staticmethod
    def open(path: Path, inner: str = "") -> "ZipSource":
        """Open an archive.

        `path`: the archive; `inner`: a folder in it, which is taken as the top.

        Raises:
            ScanError: it is damaged, or holds names that point outside of it.
        """
        try:
            archive = zipfile.ZipFile(path)
        # A version of the format that is not known, names in no known letters.
        except (zipfile.BadZipFile, OSError, NotImplementedError, ValueError) as error:
            raise ScanError(
                f"{path}: expected a zip archive, found one that cannot be read ({error}); "
                "export or copy it again"
            ) from error
        for entry in archive.infolist():
            if leads_out(entry.filename) or stat.S_ISLNK(entry.external_attr >> 16):
                archive.close()
                raise ScanError(
                    f"{path}: expected files inside the archive, found {entry.filename!r}, which "
                    "points outside of it; do not trust this archive, export the scan again"
                )
        return ZipSource(path / inner, archive, inner)

    def inside(self, folder: str) -> "ZipSource":
        """A folder of it as a source of its own."""
        whole = self._prefix + folder
        return ZipSource(self.path / folder, self._lock_free, whole)

    def all_folders(self) -> list[str]:
        """Names of all folders that hold anything, at every depth, sorted."""
        found = {str(parent) for name in self._entries for parent in PurePosixPath(name).parents}
        return sorted(found - {"."})

    def names(self, folder: str = "") -> list[str]:
        """See `FileSource`."""
        return self._by_folder.get(folder.strip("/"), [])

    def folders(self, folder: str = "") -> list[str]:
        """See `FileSource`."""
        prefix = f"{folder.strip('/')}/".lstrip("/")
        inside = (name[len(prefix) :] for name in self._entries if name.startswith(prefix))
        return sorted({name.split("/")[0] for name in inside if "/" in name})

    def exists(self, name: str) -> bool:
        """See `FileSource`."""
        return name in self._entries

    def read(self, name: str) -> bytes:
        """See `FileSource`."""
        entry = self._entry(name)
        if entry.file_size > MAX_ENTRY_BYTES:
            raise ScanError(
                f"{self.path}: expected files below {MAX_ENTRY_BYTES // 1_000_000} MB in the archive, "
                f"found {name} of {entry.file_size // 1_000_000} MB; unpack the archive first"
            )
        with self._unpacking(name):
            return self._lock_free.read(entry)

    def ends(self, name: str) -> tuple[bytes, bytes]:
        """See `FileSource`."""
        data = self.read(name)
        return data[:HEAD_BYTES], data[-TAIL_BYTES:]

    def stamp(self, name: str) -> str:
        """See `FileSource`."""
        entry = self._entries[name]
        return f"{entry.file_size} {entry.CRC}"

    def locate(self, name: str) -> Path:
        """See `FileSource`."""
        return Path(str(self._lock_free.filename)) / self._entry(name).filename

    def on_disk(self, name: str) -> Path:
        """See `FileSource`; unpacked into a temporary folder that lives as long as the source."""
        entry = self._entry(name)
        # The archive says beforehand what is unpacked, and zipfile unpacks no more than that.
        if entry.file_size > MAX_UNPACKED_BYTES:
            raise ScanError(
                f"{self.path}: expected files below {MAX_UNPACKED_BYTES // 10**9} GB in the archive, found "
                f"{name} of {entry.file_size // 10**9} GB; unpack the archive first"
            )
        path = self._unpacked / f"{entry.CRC:08x}{PurePosixPath(name).suffix}"
        if not path.exists():
            with (
                self._unpacking(name),
                self._lock_free.open(entry) as packed,
                path.open("wb") as out,
            ):
                shutil.copyfileobj(packed, out)
        return path

    def _entry(self, name: str) -> zipfile.ZipInfo:
        if name not in self._entries:
            raise ScanError(f"{self.path}: expected {name} in the archive, found none")
        return self._entries[name]

    @contextmanager
    def _unpacking(self, name: str) -> Iterator[None]:
        """Whatever unpacking raises, as `ScanError`."""
        try:
            yield
        except (zipfile.BadZipFile, OSError, EOFError, RuntimeError, ValueError) as error:
            raise ScanError(
                f"{self.path}: {name} in the archive cannot be read ({error}); export it again"
            ) from error
        except Exception as error:  # zlib.error and its like have no common base
            raise ScanError(f"{self.path}: {name} in the archive is damaged ({error})") from error

    @cached_property
    def _unpacked(self) -> Path:
        folder = Path(tempfile.mkdtemp(prefix="planfit-"))
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        return folder

    @cached_property
    def _files(self) -> list[zipfile.ZipInfo]:
        """Without folders, and without what macOS adds."""
        return [
            entry
            for entry in self._lock_free.infolist()
            if entry.filename and not entry.is_dir() and not entry.filename.startswith("__MACOSX/")
        ]

    @cached_property
    def _entries(self) -> dict[str, zipfile.ZipInfo]:
        prefix = self._prefix
        return {
            entry.filename[len(prefix) :]: entry
            for entry in self._files
            if entry.filename.startswith(prefix)
        }

    @cached_property
    def _prefix(self) -> str:
        """Of the names of the files in it."""
        if self._inner:
            return f"{self._inner.strip('/')}/"
        names = [entry.filename for entry in self._files]
        tops = {name.split("/")[0] for name in names}
        return f"{tops.pop()}/" if len(tops) == 1 and all("/" in name for name in names) else ""

    @cached_property
    def _by_folder(self) -> dict[str, list[str]]:
        found: dict[str, list[str]] = {}
        for name in sorted(self._entries):
            folder, _, last = name.rpartition("/")
            found.setdefault(folder, []).append(last)
        return found


def _unreadable(path: Path, error: OSError) -> ScanError:
    why = error.strerror or str(error)
    return ScanError(f"{path}: cannot be read ({why}); copy or export the scan again")


def fingerprint_of_file(path: Path) -> str:
    """Size and time of a file on this disk."""
    status = path.stat()
    return f"{status.st_size} {status.st_mtime_ns}"


def open_source(path: Path) -> FileSource:
    """The files at a path.

    Raises:
        ScanError: there is nothing, links lead in a circle, or an archive cannot be used.
    """
    if path.is_dir():
        return FolderSource(path)
    archive = archive_of(path)
    if archive is not None:
        inner = path.relative_to(archive).as_posix()
        return ZipSource.open(archive, "" if inner == "." else inner)
    raise ScanError(f"{path}: expected the folder of a scan or a zip archive of one, found a file")


def in_order(name: str) -> list[str | int]:
    """A key to sort names of files by, with numbers by their value: frame_2 before frame_10."""
    return [int(part) if part.isdecimal() else part for part in re.split(r"([0-9]+)", name)]


def read_text(source: FileSource, name: str) -> str:
    """A text file.

    Raises:
        ScanError: it is missing or no text.
    """
    try:
        return source.read(name).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ScanError(
            f"{source.path / name}: expected text, found other bytes ({error.reason} at "
            f"{error.start}); export it again"
        ) from error


def fingerprint(source: ImageSource, names: Iterable[str], *parts: object) -> str:
    """Changes when any of the files (names, sizes, times) or of the other `parts` does."""
    digest = hashlib.sha256(repr(parts).encode())
    for name in names:
        digest.update(f"{name} {source.stamp(name)}\n".encode())
    return digest.hexdigest()[:16]
