"""The output folder of a run: claimed once, written whole or not at all."""

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from planfit.errors import OutputError

RECORD = "run.json"
_INPUTS = "inputs.json"
_STAGING = ".writing"


@dataclass(frozen=True)
class RunFolder:
    """A folder that belongs to one scan and one plan, or to a scan without one."""

    path: Path

    @property
    def cache_dir(self) -> Path:
        """Where stages keep their results between runs."""
        return self.path / "cache"

    @staticmethod
    def claim(path: Path, inputs: dict[str, str], overwrite: bool) -> "RunFolder":
        """Take a folder for a run; it is made if it is not there.

        Args:
            path: the folder.
            inputs: what the run reads, by name and fingerprint. The same inputs may come back, with
                other options too: finished stages are then reused.
            overwrite: whether another run's results may be replaced; files that are no run's never.

        Raises:
            OutputError: the folder holds another run or other files, or cannot be written.
        """
        folder = RunFolder(path)
        if path.exists() and not path.is_dir():
            raise OutputError(
                f"{path}: expected a folder for results, found a file; choose another"
            )
        if path.is_dir():
            folder._check_owner(inputs, overwrite)
        try:
            folder.cache_dir.mkdir(parents=True, exist_ok=True)
            (folder.cache_dir / _INPUTS).write_text(json.dumps(inputs, indent=1))
            shutil.rmtree(path / _STAGING, ignore_errors=True)
        except OSError as error:
            raise OutputError(
                f"{path}: cannot be written ({error.strerror}); choose another folder with -o"
            ) from error
        return folder

    @contextmanager
    def writing(self) -> Iterator[Path]:
        """A folder to write results into; on leaving, all of them replace the old ones.

        On any error nothing of the old results is touched and nothing new stays.

        Raises:
            OutputError: a file cannot be written (a full disk, say).
        """
        staging = self.path / _STAGING
        try:
            staging.mkdir()
            yield staging
            for item in sorted(staging.iterdir()):
                target = self.path / item.name
                if target.is_dir():
                    shutil.rmtree(target)
                item.replace(target)
        except OSError as error:
            name = error.filename or self.path
            raise OutputError(
                f"{name}: cannot be written ({error.strerror}); free disk space or choose another "
                "folder with -o, then run again: finished stages are kept in the cache"
            ) from error
        finally:
            shutil.rmtree(staging, ignore_errors=True)

    def _check_owner(self, inputs: dict[str, str], overwrite: bool) -> None:
        """Raise `OutputError` where the folder holds something that is not to be replaced.

        A run is told by the paths of its scan and plan: the same files may have changed since.
        """
        names = {item.name for item in self.path.iterdir()} - {_STAGING}
        if not names or (names == {"cache"} and (self.cache_dir / _INPUTS).exists()):
            return  # nothing yet, or a run that never finished
        try:
            owner = json.loads((self.path / RECORD).read_text())["inputs"]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise OutputError(
                f"{self.path}: expected an empty folder or an earlier run of planfit, found other "
                "files; choose another folder with -o"
            ) from error
        same = all(owner.get(name) == inputs.get(name) for name in ("scan", "plan"))
        if not same and not overwrite:
            raise OutputError(
                f"{self.path}: expected an empty folder, found the results of another run "
                f"({owner.get('scan', 'unknown scan')} with {owner.get('plan') or 'no plan'})"
                "; choose another folder with -o, or pass --overwrite"
            )
