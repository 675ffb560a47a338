"""Scans and plans at addresses (s3://, https://, zip://...::...), copied to this machine whole or not at all.

Read by fsspec (https://filesystem-spec.readthedocs.io), one library for all of them.
"""

import hashlib
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import unquote

from filelock import FileLock

from planfit.errors import OptionError, ScanError

_VERSIONS = (
    "ETag",
    "etag",
    "VersionId",
    "LastModified",
    "Last-Modified",
    "Content-MD5",
    "Digest",
    "mtime",
    "updated",
    "last_modified",
    "date_time",
    "CRC",
)
"""What file systems call that which changes with the content, as far as they tell."""


@dataclass(frozen=True)
class RemoteFile:
    """A file at or below an address."""

    name: str
    """Below the address; the file's own name where the address is that of a file."""
    path: str
    """As its file system calls it."""
    n_bytes: int
    version: str


def list_files(address: str) -> list[RemoteFile]:
    """Files at or below an address, by name.

    Raises:
        ScanError: there is nothing.
        OptionError: a library is missing.
        OSError: the server does not answer, or refuses.
    """
    with _told(address):
        return _open(address)[1]


def staged(address: str, cache: Path) -> Path:
    """What lies at an address, as a file or folder of this machine.

    A copy is named by the address and the versions of its files: one that is there is whole and up to date.

    Args:
        address: of a file, or of a folder (over http: with `/` at its end).
        cache: folder of the copies.

    Raises:
        As of `list_files`.
    """
    with _told(address):
        system, files, is_folder = _open(address)
        mark = hashlib.sha256(repr((address, files)).encode()).hexdigest()[:16]
        own = unquote(PurePosixPath(_path_of(address)).name)
        own = "scan" if own in ("", ".", "..") else own
        place = cache / mark
        cache.mkdir(parents=True, exist_ok=True)
        # Others wait: two jobs of one building share its plan.
        with FileLock(cache / f"{mark}.lock"):
            if not place.exists():
                _fetch(system, files, place, own if is_folder else "")
        return place / (own if is_folder else files[0].name)


def _fetch(system: Any, files: list[RemoteFile], place: Path, folder: str) -> None:
    """All files into a folder of another name, which is renamed when all are there."""
    part = place.with_name(f"{place.name}.{uuid.uuid4().hex[:8]}.part")
    try:
        for file in files:
            target = part / folder / file.name
            target.parent.mkdir(parents=True, exist_ok=True)
            system.get_file(file.path, str(target))
            found = target.stat().st_size
            if file.n_bytes and found != file.n_bytes:
                raise OSError(f"{file.path}: expected {file.n_bytes} bytes, got {found}")
        part.rename(place)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _open(address: str) -> tuple[Any, list[RemoteFile], bool]:
    """File system, files, and whether the address is that of a folder."""
    try:
        from fsspec.core import url_to_fs  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise OptionError(
            f"{address}: expected fsspec to read an address, found no such library; install it with "
            "pip install 'planfit[remote]', or download the scan"
        ) from error
    system, root = url_to_fs(address, use_listings_cache=False)
    is_http = "http" in str(system.protocol)
    # A web server tells no folder from a file but by the address; asking would fetch the whole file.
    is_folder = address.endswith("/") if is_http else system.isdir(root)
    if not is_folder:
        info = system.info(root)
        name = unquote(PurePosixPath(_path_of(address)).name) or "file"
        return system, [_file(name, root, info)], False
    below = system.find(root, detail=True)
    base = root.rstrip("/")
    files = []
    for path, info in sorted(below.items()):
        name = path[len(base) :].lstrip("/") if path.startswith(base) else path.lstrip("/")
        name = unquote(name) if is_http else name
        if not name or ".." in PurePosixPath(name).parts or PurePosixPath(name).is_absolute():
            continue  # the folder's own mark, or a name that would lead elsewhere
        files.append(_file(name, path, system.info(path) if is_http else info))
    if not files:
        raise FileNotFoundError(address)
    return system, files, True


def _file(name: str, path: str, info: dict[str, Any]) -> RemoteFile:
    version = " ".join(str(info[key]) for key in _VERSIONS if info.get(key) is not None)
    return RemoteFile(name, path, int(info.get("size") or 0), version)


def _path_of(address: str) -> str:
    """`a/b.zip` of `s3://a/b.zip?x`; of a chain, its first link."""
    first = address.split("::")[0]
    rest = first.partition("://")[2] or address.split("::")[-1].partition("://")[2]
    return rest.split("?")[0].split("#")[0].rstrip("/")


@contextmanager
def _told(address: str) -> Iterator[None]:
    """Errors of fsspec and of the servers' libraries as planfit's, or as `OSError` where trying again may
    help."""
    try:
        yield
    except (ScanError, OptionError):
        raise
    except FileNotFoundError as error:
        if _is_away(error.__cause__):
            raise OSError(f"{address}: the server does not answer ({error.__cause__})") from error
        raise ScanError(
            f"{address}: expected a file or folder, found nothing; check the address"
        ) from error
    except PermissionError as error:
        raise ScanError(
            f"{address}: expected a file or folder that may be read, found one that the server refuses "
            f"({error}); give the credentials as its own tools take them"
        ) from error
    except ImportError as error:
        raise OptionError(
            f"{address}: expected the library of this kind of address, found none ({error}); install it: "
            "pip install 'planfit[remote]' has those of s3 and https"
        ) from error
    except ValueError as error:
        raise OptionError(f"{address}: expected an address that fsspec knows ({error})") from error
    except OSError:
        raise
    except (
        Exception
    ) as error:  # libraries of servers have errors of their own, NoCredentialsError say
        raise OSError(f"{address}: cannot be read ({type(error).__name__}: {error})") from error


def _is_away(cause: BaseException | None) -> bool:
    """Whether a file that was not found may be there: fsspec says the same of a server that is not."""
    status = getattr(cause, "status", None)
    return isinstance(cause, OSError | TimeoutError) or (isinstance(status, int) and status >= 500)
