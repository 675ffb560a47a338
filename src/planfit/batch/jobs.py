"""The jobs of a batch: rows checked and turned into what `planfit refine` is to be called with."""

import difflib
import hashlib
import json
import math
import os
import re
import unicodedata
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from planfit import __version__
from planfit.batch import addresses
from planfit.batch.sheet import Row, Values, read_rows
from planfit.errors import OptionError, ScanError, printable, require
from planfit.runtime import archive_of

OWN_COLUMNS = ("name", "scan", "plan", "memory-gb")
"""What a job has beside options of refine."""
SWITCH_WORDS = {"true": True, "yes": True, "1": True, "x": True, "on": True} | {
    "false": False, "no": False, "0": False, "off": False,
}  # fmt: skip
RESERVED_NAMES = ("batch", "index.html", "jobs.csv")
"""What lies beside the jobs' folders."""
MAX_NAME = 120
"""Characters; file systems end at 255 bytes, and names get endings."""
_ADDRESS = re.compile(r"^[a-z][a-z0-9+.-]+(://|::)", re.IGNORECASE)
_OF_STOREY = re.compile(r"^([+-]?\d+)=(.+)$")
_BY_WINDOWS = {"con", "prn", "aux", "nul"} | {
    f"{d}{i}" for d in ("com", "lpt") for i in range(1, 10)
}


@dataclass(frozen=True)
class Column:
    """An option of refine, as far as a cell of it has to be understood."""

    is_switch: bool = False
    has_no: bool = False
    """Whether `--no-NAME` switches it off."""
    is_file: bool = False
    is_repeated: bool = False
    """Whether several values take the flag once each."""


@dataclass(frozen=True)
class Option:
    """A flag of refine and its values."""

    flag: str
    values: Values = ()
    is_file: bool = False
    """Whether the values are paths or addresses of files."""

    @property
    def words(self) -> list[str]:
        """As on the command line."""
        if len(self.values) == 1 and self.values[0].startswith("-"):
            return [f"{self.flag}={self.values[0]}"]
        return [self.flag, *self.values]


@dataclass(frozen=True)
class Job:
    """One scan to be refined."""

    name: str
    """And name of its folder."""
    scan: str
    """Absolute path, or address."""
    plans: Values = ()
    """Absolute paths or addresses, with `NUMBER=` before them where there is one for each storey; without,
    the plan in the scan's folder."""
    options: tuple[Option, ...] = ()
    memory_gb: float | None = None
    """What it needs, where the user knows."""


def is_address(text: str) -> bool:
    """Whether it is no path of this machine but `s3://...`, `https://...` or `zip://...::...`."""
    return bool(_ADDRESS.match(text))


def split_storey(plan: str) -> tuple[str, str]:
    """`NUMBER=` or nothing, and the file."""
    found = _OF_STOREY.match(plan)
    return (f"{found[1]}=", found[2]) if found else ("", plan)


def read_jobs(path: Path, columns: Mapping[str, Column]) -> list[tuple[Row, Job]]:
    """Jobs of a file, in its order, each with the row it comes from.

    Args:
        path: CSV, TOML or JSON; relative paths in it begin at its folder.
        columns: the options of refine, by name without dashes.

    Raises:
        OptionError: a column or name is missing, unknown or comes twice, or a cell cannot work.
    """
    rows = read_rows(path)
    named = {column for row in rows for column in row.cells}
    for needed in ("name", "scan"):
        require(
            needed in named,
            f"{path}: expected a column {needed!r}, found {_listed(named)}; each job needs a name and a scan",
        )
    folder = path.resolve().parent
    jobs: list[tuple[Row, Job]] = []
    seen: dict[str, str] = {}
    for row in rows:
        _check_columns(row, columns)
        job = _job(row, columns, folder)
        # Folders of macOS and Windows do not tell upper from lower case.
        key = unicodedata.normalize("NFC", job.name).casefold()
        require(
            key not in seen,
            f"{row.where}: expected a name that no other job has, found {job.name!r}, which is the name in "
            f"{seen.get(key)}; each job has a folder of its own name",
        )
        seen[key] = row.where.rsplit(", ", 1)[-1]
        jobs.append((row, job))
    return jobs


def _check_columns(row: Row, columns: Mapping[str, Column]) -> None:
    known = [*OWN_COLUMNS, *columns]
    for column in row.cells:
        if column in known:
            continue
        near = (
            difflib.get_close_matches(column, known, n=3, cutoff=0.6)
            or [name for name in known if name.rpartition(".")[2] == column][:3]
        )
        hint = f"did you mean {' or '.join(near)}?" if near else "see planfit refine --help-all"
        raise OptionError(
            f"{row.where}: expected name, scan, plan, memory-gb or an option of planfit refine, found the "
            f"column {column!r}; {hint}"
        )


def _job(row: Row, columns: Mapping[str, Column], folder: Path) -> Job:
    cells = row.cells
    for needed in ("name", "scan"):
        require(
            needed in cells, f"{row.where}: expected a {needed}, found none; each job needs one"
        )
    plans = []
    for plan in cells.get("plan", ()):
        number, file = split_storey(plan)
        plans.append(number + _located(file, folder))
    options = [
        option
        for name, column in columns.items()
        if name in cells
        for option in _options(row, name, column, cells[name], folder)
    ]
    return Job(
        _name(row, _one(row, "name")),
        _located(_one(row, "scan"), folder),
        tuple(plans),
        tuple(options),
        _memory(row),
    )


def _one(row: Row, column: str) -> str:
    values = row.cells[column]
    require(
        len(values) == 1,
        f"{row.where}: expected one {column}, found {len(values)}: {', '.join(values)}",
    )
    return values[0]


def _name(row: Row, text: str) -> str:
    """A name that every file system takes."""
    name = unicodedata.normalize("NFC", text)
    is_plain = (
        not set(name) & set('<>:"/\\|?*')
        and printable(name) == name
        and not name.startswith(".")
        and not name.endswith((".", " "))
        and len(name) <= MAX_NAME
        and name.split(".")[0].casefold() not in _BY_WINDOWS
    )
    require(
        is_plain,
        f'{row.where}: expected a name that can be that of a folder (no / \\ : * ? " < > |, no dot at its '
        f"ends, at most {MAX_NAME} letters), found {printable(text)!r}",
    )
    require(
        name.casefold() not in RESERVED_NAMES,
        f"{row.where}: expected another name than {name!r}, which is that of a file beside the jobs' folders",
    )
    return name


def _located(text: str, folder: Path) -> str:
    """Absolute path, from the folder of the jobs file, or the address as it is."""
    if is_address(text):
        return text
    path = Path(text)
    return str(path.expanduser() if text.startswith("~") else folder / path)


def _options(
    row: Row, name: str, column: Column, values: Values, folder: Path
) -> tuple[Option, ...]:
    """The flag as `planfit refine` takes it; none where a switch is off that is off by itself."""
    if column.is_switch:
        word = _one(row, name).lower()
        require(
            word in SWITCH_WORDS, f"{row.where}: expected true or false as {name}, found {word!r}"
        )
        if SWITCH_WORDS[word]:
            return (Option(f"--{name}"),)
        group, dot, own = name.rpartition(".")
        return (Option(f"--{group}{dot}no-{own}"),) if column.has_no else ()
    if column.is_file:
        values = tuple(_located(value, folder) for value in values)
    if column.is_repeated:
        return tuple(Option(f"--{name}", (value,), column.is_file) for value in values)
    return (Option(f"--{name}", values, column.is_file),)


def _memory(row: Row) -> float | None:
    if "memory-gb" not in row.cells:
        return None
    text = _one(row, "memory-gb")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    require(
        0 < value < math.inf,
        f"{row.where}: expected gigabytes as memory-gb, as 4.5, found {text!r}",
    )
    return value


def _listed(names: set[str]) -> str:
    return ", ".join(repr(name) for name in sorted(names)) or "none"


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
