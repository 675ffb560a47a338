"""Where paths of input lead: into zip archives (`scans.zip/a/plan.npy`), out of a folder, to no file."""

import os
import shutil
import stat
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

from planfit.errors import PlanfitError

_NO_CONTENT = {
    stat.S_ISFIFO: "a pipe",
    stat.S_ISSOCK: "a socket",
    stat.S_ISCHR: "a device",
    stat.S_ISBLK: "a device",
}
"""What is neither a file nor a folder: to read it waits for a writer, or has no end."""


def leads_out(name: str) -> bool:
    """Whether a name that a file or an archive lists goes up, or begins at a root or a drive."""
    parts = PurePosixPath(name.replace("\\", "/")).parts
    return bool(parts) and (".." in parts or parts[0].startswith("/") or ":" in parts[0])


def path_inside(folder: Path, name: str) -> Path | None:
    """The path of a file by the name that another file has for it, relative to a folder or absolute; None
    where it leads out of the folder. Links are not looked at."""
    if not leads_out(name):
        return folder / name
    for top in (folder.resolve(), folder.absolute()):
        path = Path(os.path.normpath(top / name))
        if path.is_relative_to(top):
            return folder / path.relative_to(top)
    return None


def require_content(path: Path, kind: type[PlanfitError], expected: str) -> None:
    """Raise an error where a path leads to a pipe, a socket or a device; not where it leads nowhere."""
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        return
    found = next((words for is_one, words in _NO_CONTENT.items() if is_one(mode)), "")
    if found:
        raise kind(
            f"{path}: expected {expected}, found {found}; write what it gives into a file, and give that"
        )


def archive_of(path: Path) -> Path | None:
    """The zip archive that a path is or leads into; None where there is none."""
    for part in (path, *path.parents):
        if part.is_file():
            return part if zipfile.is_zipfile(part) else None
    return None


@contextmanager
def unpacked(path: Path) -> Iterator[Path]:
    """A file of an archive, by a path that leads into it, as a file of its own while the context lasts.

    Raises:
        OSError: the archive has no such file, or it is damaged.
    """
    archive = archive_of(path)
    if archive is None or archive == path:
        raise FileNotFoundError(f"{path} leads into no archive")
    with tempfile.TemporaryDirectory(prefix="planfit-") as folder:
        copy = Path(folder) / path.name
        try:
            with (
                zipfile.ZipFile(archive) as whole,
                whole.open(path.relative_to(archive).as_posix()) as packed,
                copy.open("wb") as out,
            ):
                shutil.copyfileobj(packed, out)
        except (KeyError, zipfile.BadZipFile, EOFError, RuntimeError, ValueError) as error:
            raise FileNotFoundError(f"{path} cannot be read ({error})") from error
        yield copy
