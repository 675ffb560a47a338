"""The output folder of a run: one process at a time, results written whole or not at all.

Results are written into a folder beside the old ones, which a rename turns into one to be moved in: from
then on they hold, whatever happens. A process that dies before leaves the old results, one that dies while
they are moved in leaves the rest to whoever takes the folder next. They may come in two parts: with the
first, the old ones go; until the second is there, the run has not finished.
"""

import json
import os
import platform
import shutil
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from planfit.errors import OutputError
from planfit.runtime.whole_files import PART, made_folder, write_whole

RECORD = "run.json"
_CACHE = "cache"
_OWNER, _LOCK = ".planfit.json", ".planfit.lock"
_STAGING, _READY = ".writing", ".ready"
ALIGNMENT, CANDIDATE = "alignment.json", "candidate_{}.png"
"""What `planfit align` writes: a run with the same scan and plan goes on beside it."""


@dataclass(frozen=True)
class RunFolder:
    """A folder that belongs to one scan and one plan, or to a scan without one."""

    path: Path
    inputs: dict[str, str]
    """What the run reads, by name and fingerprint."""

    @property
    def cache_dir(self) -> Path:
        """Where stages keep their results between runs."""
        return self.path / _CACHE

    @staticmethod
    @contextmanager
    def claimed(path: Path, inputs: dict[str, str], overwrite: bool) -> Iterator["RunFolder"]:
        """Take a folder for a run, which no other process may take meanwhile; it is made if it is not there.

        A run that ends with an error leaves what it finished, in its cache; where that is nothing, it leaves
        nothing.

        Args:
            path: the folder.
            inputs: what the run reads. The same inputs may come back, with other options too: finished
                stages are then reused.
            overwrite: whether another run's results may be replaced; files that are no run's never.

        Raises:
            OutputError: the folder holds another run or other files, another process writes to it, or it
                cannot be written.
        """
        if path.exists() and not path.is_dir():
            raise OutputError(
                f"{path}: expected a folder for results, found a file; choose another"
            )
        if path.is_dir():
            _check_owner(path, inputs, overwrite)
        with _made(path), _locked(path):
            folder = RunFolder(path, inputs)
            try:
                # Once more: another process may have finished a run between the look and the lock.
                _check_owner(path, inputs, overwrite)
                if not _is_of(_owner(path).get("inputs") or inputs, inputs):
                    remove_alignment(path)
                _move_in(path)
                shutil.rmtree(path / _STAGING, ignore_errors=True)
                folder._write_owner(_results(path))
            except OSError as error:
                raise _unwritable(path, error) from error
            try:
                yield folder
            except BaseException:
                _leave_nothing_empty(path)
                raise

    @contextmanager
    def writing(self, to_come: Sequence[str] = (), has_begun: bool = False) -> Iterator[Path]:
        """A folder to write results into; on leaving, all of them replace the old ones.

        On any error nothing of the old results is touched and nothing new stays.

        Args:
            to_come: names of results that a second part brings; till then the run has not finished.
            has_begun: whether this is the second part, which takes the place of none but its own names.

        Raises:
            OutputError: a file cannot be written (a full disk, say).
        """
        staging = self.path / _STAGING
        try:
            staging.mkdir()
            yield staging
            names = [item.name for item in staging.iterdir()]
            new = sorted({*names, *(_results(self.path) if has_begun else ())})
            # Of no effect without what is ready, which the next line makes.
            owner = _owner(self.path) | {"moving": new, "to_come": list(to_come)}
            _write_json(self.path / _OWNER, owner)
            staging.rename(self.path / _READY)  # from here on, these are the results
            _move_in(self.path)
        except OSError as error:
            name = error.filename or self.path
            raise OutputError(
                f"{name}: cannot be written ({error.strerror}); free disk space or choose another "
                "folder with -o, then run again: finished stages are kept in the cache"
            ) from error
        finally:
            shutil.rmtree(staging, ignore_errors=True)

    def _write_owner(self, results: list[str]) -> None:
        process = {"id": os.getpid(), "host": platform.node()}
        _write_json(
            self.path / _OWNER, {"inputs": self.inputs, "process": process, "results": results}
        )


def finished_record(path: Path) -> dict[str, Any] | None:
    """What the last run of a folder that finished says of itself; None where none did, or files are gone.

    A run that died while its results were moved in has finished: the rest is moved in here.

    Raises:
        OutputError: another process writes to the folder.
    """
    if not (path / _OWNER).is_file():
        return None
    if (path / _READY).is_dir():
        with _locked(path):
            _move_in(path)
    if any(not (path / name).exists() for name in _results(path)):
        return None
    try:
        record = json.loads((path / RECORD).read_text())
    except (OSError, ValueError, RecursionError):
        return None
    return record if isinstance(record, dict) else None


def inputs_of_owner(path: Path) -> dict[str, Any]:
    """What the run that a folder belongs to reads, finished or not; nothing where it is no run's."""
    inputs = _owner(path).get("inputs") or _recorded_inputs(path)
    return inputs if isinstance(inputs, dict) else {}


@contextmanager
def _made(path: Path) -> Iterator[None]:
    with ExitStack() as stack:
        try:
            stack.enter_context(made_folder(path))
        except OSError as error:
            raise _unwritable(path, error) from error
        yield


def _leave_nothing_empty(path: Path) -> None:
    """Remove what says whose a folder is where nothing else lies in it. The lock is held still: whoever
    comes next makes another."""
    if {item.name for item in path.iterdir()} <= {_OWNER, _LOCK}:
        with suppress(OSError):  # Windows removes no file that is open
            (path / _OWNER).unlink(missing_ok=True)
            (path / _LOCK).unlink(missing_ok=True)


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """The folder for this process alone; the system frees it when the process ends or dies."""
    try:
        lock = FileLock(path / _LOCK, timeout=0)
        lock.acquire()
    except Timeout as error:
        process = _owner(path).get("process", {})
        raise OutputError(
            f"{path}: expected a folder that no other run writes to, found one in use by process "
            f"{process.get('id', '?')} on {process.get('host', '?')}; wait for it, or choose another with -o"
        ) from error
    except OSError as error:
        raise _unwritable(path, error) from error
    try:
        yield
    finally:
        lock.release()


def _move_in(path: Path) -> None:
    """Put finished results in their place, and take away those of the run before that they do not replace.

    Begun by the process that wrote them, or ended by the next one: each step may be done again.
    """
    ready = path / _READY
    if not ready.is_dir():
        return
    owner = _owner(path)
    new = owner.get("moving") or sorted(item.name for item in ready.iterdir())
    for name in [*_results(path), *new]:
        target = path / name
        is_new = (ready / name).exists()
        if target.is_dir() and (is_new or name not in new):
            shutil.rmtree(target)
        elif name not in new or (ready / name).is_dir():
            target.unlink(missing_ok=True)
        if is_new:
            (ready / name).replace(target)
    # What was moved is told until the next run takes the folder: an empty folder of results means none.
    _write_json(
        path / _OWNER, owner | {"results": [*new, *owner.get("to_come", [])], "moving": new}
    )
    ready.rmdir()


def _check_owner(path: Path, inputs: dict[str, str], overwrite: bool) -> None:
    """Raise `OutputError` where the folder holds something that is not to be replaced.

    A run is told by the paths of its scan and plan: the same files may have changed since.
    """
    ours = {_CACHE, _OWNER, _LOCK, _STAGING, _READY, f"{_OWNER}{PART}"}
    aligned = {item.name for item in _alignment_files(path)}
    if not {item.name for item in path.iterdir()} - ours - aligned:
        return  # nothing yet, an alignment, or a run that never finished
    owner = _owner(path).get("inputs") or _recorded_inputs(path)
    if owner is None:
        raise OutputError(
            f"{path}: expected an empty folder or an earlier run of planfit, found other "
            "files; choose another folder with -o"
        )
    if not _is_of(owner, inputs) and not overwrite:
        raise OutputError(
            f"{path}: expected an empty folder, found the results of another run "
            f"({owner.get('scan', 'unknown scan')} with {owner.get('plan') or 'no plan'})"
            "; choose another folder with -o, or pass --overwrite"
        )


def _is_of(owner: dict[str, Any], inputs: dict[str, str]) -> bool:
    return all(owner.get(name) == inputs.get(name) for name in ("scan", "plan"))


def remove_alignment(path: Path) -> None:
    """Remove what `planfit align` wrote into a folder."""
    for file in _alignment_files(path):
        file.unlink()


def _alignment_files(path: Path) -> list[Path]:
    parts = [name + end for name in (ALIGNMENT, CANDIDATE.format("*")) for end in ("", PART)]
    return [file for name in parts for file in path.glob(name)]


def _results(path: Path) -> list[str]:
    """Names of the results that lie in the folder."""
    names = _owner(path).get("results", [])
    # Only what lies in the folder itself: the names are removed.
    return [name for name in names if isinstance(name, str) and Path(name).name == name]


def _recorded_inputs(path: Path) -> dict[str, Any] | None:
    """What the run of a folder without an owner's file says that it read."""
    try:
        inputs = json.loads((path / RECORD).read_text())["inputs"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return inputs if isinstance(inputs, dict) else None


def _owner(path: Path) -> dict[str, Any]:
    """What the folder says of itself; nothing where it is new."""
    try:
        owner = json.loads((path / _OWNER).read_text())
    except (OSError, ValueError, RecursionError):
        return {}
    return owner if isinstance(owner, dict) else {}


def _write_json(path: Path, content: dict[str, Any]) -> None:
    write_whole(path, json.dumps(content, indent=1))


def _unwritable(path: Path, error: OSError) -> OutputError:
    return OutputError(
        f"{path}: cannot be written ({error.strerror}); choose another folder with -o"
    )
