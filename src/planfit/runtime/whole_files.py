"""Files and folders that are written whole or not at all: under another name first, which a rename ends.

On a full disk, on any other error and on Ctrl-C nothing new stays, and what was there before is as it was.
"""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from planfit.errors import OutputError

PART = ".part"
"""What stands behind the name of a file while it is written; a process that is killed may leave one."""


@contextmanager
def made_folder(path: Path) -> Iterator[None]:
    """A folder, and those above it, made where they are not there; on an error those that are new go again
    unless something lies in them.

    Raises:
        OSError: it cannot be made.
    """
    new = [folder for folder in (path, *path.parents) if not folder.exists()]
    try:
        path.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:
        with suppress(OSError):  # one that is in use, and with it all above
            for folder in new:
                folder.rmdir()
        raise


@contextmanager
def whole_file(
    path: Path, advice: str = "free disk space or choose another place", writer: str = ""
) -> Iterator[Path]:
    """A path to write a file to, which becomes `path` on leaving.

    Args:
        path: the file; its folder is made if it is not there. One that is there is replaced.
        advice: what is to be done where it cannot be written.
        writer: who writes, where several may write the same file at the same time.

    Raises:
        OutputError: it cannot be written (a full disk, say).
    """
    part = path.with_name(path.name + writer + PART)
    with _told(path, part, advice), made_folder(path.parent):
        try:
            yield part
            part.replace(path)
        except BaseException:
            with suppress(OSError):  # the error that led here is what is told
                part.unlink(missing_ok=True)
            raise


@contextmanager
def whole_folder(
    path: Path, advice: str = "free disk space or choose another place"
) -> Iterator[Path]:
    """An empty folder to write into, which becomes `path` on leaving.

    Raises:
        OutputError: it cannot be written.
    """
    with _told(path, None, advice), made_folder(path.parent):
        part = Path(tempfile.mkdtemp(PART, f".{path.name[:100]}.", path.parent))
        with _told(path, part, advice):
            try:
                # A temporary folder is its owner's alone; a usual one has the rights of that it is in.
                part.chmod(path.parent.stat().st_mode & 0o777)
                yield part
                if path.is_dir():
                    path.rmdir()  # no rename replaces an empty folder on Windows
                part.replace(path)
            except BaseException:
                shutil.rmtree(part, ignore_errors=True)
                raise


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file whole or not at all, text as UTF-8.

    Raises:
        OutputError: it cannot be written.
    """
    with whole_file(path) as part:
        part.write_bytes(content.encode() if isinstance(content, str) else content)


@contextmanager
def _told(path: Path, part: Path | None, advice: str) -> Iterator[None]:
    """What the system says of writing becomes one line about the file asked for; of others, it passes."""
    try:
        yield
    except OSError as error:
        of = error.filename
        if (
            isinstance(of, str)
            and part is not None
            and not Path(of).is_relative_to(part)
            and of != str(path)
        ):
            raise
        why = error.strerror or str(error) or "no reason given"
        raise OutputError(f"{path}: cannot be written ({why}); {advice}") from error
