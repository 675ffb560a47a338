"""Paths that lead into zip archives: `scans.zip/office/floorplan.npy`."""

import shutil
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


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
