"""What a job reads: stamps of all its files, and the key that changes when any of them or an option does."""

import hashlib
import json
import os
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

from planfit import __version__
from planfit.batch import addresses
from planfit.batch.jobs import Job, is_address, split_storey
from planfit.errors import ScanError
from planfit.runtime import archive_of


@dataclass(frozen=True)
class Stamp:
    """Names, sizes and times of the files at a path or address."""

    digest: str
    n_files: int
    n_bytes: int


def stamp_of(place: str) -> Stamp:
    """Stamp of a file, of everything in a folder, or of what lies at an address.

    Raises:
        ScanError: there is nothing, or the address cannot be read.
        OSError: the files cannot be looked at.
    """
    if is_address(place):
        return _stamp((f.name, f.n_bytes, f.version) for f in addresses.list_files(place))
    path = Path(place)
    if path.is_dir():
        return _stamp(_files_below(path))
    file = path if path.is_file() else archive_of(path)  # a path may lead into an archive
    if file is None:
        raise ScanError(
            f"{place}: expected a file or folder, found nothing; check the path in the file of jobs"
        )
    status = file.stat()
    return _stamp([(file.name, status.st_size, str(status.st_mtime_ns))])


def _files_below(folder: Path) -> Iterable[tuple[str, int, str]]:
    """Scans have tens of thousands of files: `scandir` alone, sorted a folder."""
    folders = [(str(folder), "")]
    while folders:
        path, prefix = folders.pop()
        with os.scandir(path) as entries:
            for entry in sorted(entries, key=lambda entry: entry.name):
                if entry.is_dir(follow_symlinks=False):
                    folders.append((entry.path, f"{prefix}{entry.name}/"))
                elif entry.is_file():
                    status = entry.stat()
                    yield f"{prefix}{entry.name}", status.st_size, str(status.st_mtime_ns)


def _stamp(files: Iterable[tuple[str, int, str]]) -> Stamp:
    digest, n_files, n_bytes = hashlib.sha256(), 0, 0
    for name, size, version in files:
        digest.update(repr((name, size, version)).encode())
        n_files, n_bytes = n_files + 1, n_bytes + size
    return Stamp(digest.hexdigest()[:16], n_files, n_bytes)


@dataclass(frozen=True)
class Inputs:
    """All that a job reads."""

    scan: Stamp
    key: str
    """Changes with any file, path or option, and with planfit's version."""


def inputs_of(job: Job) -> Inputs:
    """Stamps of a job's files and its key.

    Raises:
        ScanError, OSError: as of `stamp_of`.
    """
    scan = stamp_of(job.scan)
    files = [split_storey(plan)[1] for plan in job.plans]
    files += [value for option in job.options if option.is_file for value in option.values]
    job_record = asdict(job)
    # What a result is made of: the name says where it goes, and memory how.
    del job_record["name"], job_record["memory_gb"]
    parts = (__version__, job_record, scan.digest, [stamp_of(file).digest for file in files])
    return Inputs(scan, hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16])
