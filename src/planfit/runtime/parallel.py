"""The runtime of a run: work over many frames or pairs in parallel, cached, interruptible; timed stages."""

import ctypes
import hashlib
import logging
import os
import shutil
import sys
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from types import TracebackType

from planfit.errors import OutputError, require_positive
from planfit.runtime.cache_chunks import (
    SUFFIX,
    Arrays,
    DamagedChunk,
    StoredItem,
    TemporaryFolder,
    read_chunk,
    write_chunk,
)
from planfit.runtime.option_values import require_kinds
from planfit.runtime.threads import blas_on_one_thread

log = logging.getLogger(__name__)

Progress = Callable[[str, int, int], None]
"""Called with the stage's name, how many items are done, and of how many (0: not known)."""
SEED = 0
"""Of random samples and trials, by frame or pair: a scan looked at again shows the same."""


def cache_key(source: str, *parts: object) -> str:
    """Short name for a stage's result: changes when any part's `repr` or planfit's version does.

    `source` is the fingerprint of what is computed from, or the key of an earlier stage. Where it is empty,
    nothing tells one source from another (a scan in memory); so is the key then, and nothing is kept.
    """
    if not source:
        return ""
    return hashlib.sha256(repr((version("planfit"), source, *parts)).encode()).hexdigest()[:16]


def give_back_memory() -> None:
    """Return memory that was freed to the system, where the C library can be asked to (glibc).

    Images come and go in several threads, small arrays of results among them: of 3,000 frames of 640 x 480,
    260 MB would stay with the process after the last image was closed.
    """
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)


@dataclass(frozen=True)
class Runtime:
    """How a run computes: threads, cache, progress. The default keeps nothing and says nothing."""

    workers: int = field(default_factory=lambda: os.cpu_count() or 1)
    """Threads; the heavy parts (OpenCV, NumPy, compiled loops) let go of the interpreter's lock."""
    cache_dir: Path | None = None
    """Folder that keeps finished chunks, so that a run that was stopped goes on where it was."""
    on_progress: Progress | None = None
    """Told how far each stage is."""

    def __post_init__(self) -> None:
        require_kinds(self)
        require_positive(self, "workers")

    def map(
        self,
        stage: str,
        key: str,
        n_items: int,
        compute: Callable[[int], Arrays],
        chunk_size: int = 32,
    ) -> list[Arrays]:
        """Arrays of each item 0..n_items-1, in order, computed in parallel or taken from the cache.

        Args:
            stage: name for progress and for the folder in the cache.
            key: from `cache_key`; whatever the result depends on must be in it. Empty: nothing is kept.
            n_items: how many items there are.
            compute: gives the named arrays of one item; called from several threads.
            chunk_size: items that are kept together in one file.
        """
        items = self.map_stored(stage, key, n_items, compute, (), chunk_size)
        return [item.arrays for item in items]

    def map_stored(
        self,
        stage: str,
        key: str,
        n_items: int,
        compute: Callable[[int], Arrays],
        stored: Collection[str],
        chunk_size: int = 32,
    ) -> list[StoredItem]:
        """As `map`, but arrays of the names `stored` stay in the cache, to be read when they are asked for.

        Where nothing is kept, in a folder among the system's temporary files, which lives as long as they do.

        Raises:
            OutputError: the cache, or the temporary folder, cannot be written.
        """
        folder, keeper = self._folder(stage, key), None
        if folder is None and stored:
            keeper = TemporaryFolder()
            folder = keeper.path
        starts = range(0, n_items, chunk_size)
        chunks: dict[int, list[StoredItem]] = {}
        done = 0

        def path_of(start: int) -> Path | None:
            return folder / f"{start:06d}{SUFFIX}" if folder else None

        def one_chunk(start: int) -> list[StoredItem]:
            items = [compute(i) for i in range(start, min(start + chunk_size, n_items))]
            path = path_of(start)
            # Written at once: what is finished stays, even where another chunk fails.
            located = write_chunk(path, items) if path else [{} for _ in items]
            return [
                StoredItem(
                    {name: array for name, array in item.items() if name not in stored},
                    {name: replace(at[name], keeper=keeper) for name in stored},
                )
                for item, at in zip(items, located, strict=True)
            ]

        missing, n_damaged = [], 0
        for start in starts:
            path, found = path_of(start), None
            try:
                if path:
                    found = read_chunk(path, min(chunk_size, n_items - start), stored)
            except DamagedChunk:
                n_damaged += 1
            if found is None:
                missing.append(start)
            else:
                chunks[start] = found
                done += len(found)
        if n_damaged:
            log.warning(
                "%s: expected files as %s left them, found %d of %d damaged or exchanged; these are redone",
                folder, stage, n_damaged, len(starts),
            )  # fmt: skip
        self.report(stage, done, n_items)
        pool = ThreadPoolExecutor(self.workers)
        # Set here and not in the workers: the limit is the process's, and they would undo each other's.
        with blas_on_one_thread():
            try:
                futures = {pool.submit(one_chunk, start): start for start in missing}
                for future in as_completed(futures):
                    start = futures[future]
                    chunks[start] = future.result()
                    done += len(chunks[start])
                    self.report(stage, done, n_items)
            finally:
                # On an error or Ctrl-C: chunks not yet begun are dropped, finished ones are on disk.
                pool.shutdown(wait=True, cancel_futures=True)
        if missing:
            give_back_memory()
        return [item for start in starts for item in chunks[start]]

    def report(self, stage: str, done: int, total: int) -> None:
        """Tell the listener, if there is one."""
        if self.on_progress:
            self.on_progress(stage, done, total)

    def _folder(self, stage: str, key: str) -> Path | None:
        if self.cache_dir is None or not key:
            return None
        folder = self.cache_dir / f"{stage.replace(chr(32), chr(95))}-{key}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"{folder}: cannot be made ({error.strerror})") from error
        return folder


OTHER = "other"
"""What a run does between its stages."""


class StageTimer:
    """Times the stages of a run, and reports that they began and ended."""

    def __init__(self, runtime: Runtime, begun: float | None = None) -> None:
        """Begin now, or at a moment of `time.perf_counter` before, since when the input was read."""
        self.seconds: dict[str, float] = {}
        """By stage, of those that ended; of one within another the other has the rest."""
        self._runtime = runtime
        self._begun = time.perf_counter() if begun is None else begun
        self._within_s = 0.0
        if begun is not None:
            self.seconds["read"] = time.perf_counter() - begun

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time what is done inside, and report it; a stage that fails has no time."""
        self._runtime.report(name, 0, 0)
        with self.timed(name):
            yield
            give_back_memory()
        self._runtime.report(name, 1, 0)

    @contextmanager
    def timed(self, name: str) -> Iterator[None]:
        """Time what is done inside."""
        begin, within_s, self._within_s = time.perf_counter(), self._within_s, 0.0
        yield
        own_s = time.perf_counter() - begin
        # A stage may come again: each storey is aligned with its own plan.
        self.add({name: own_s - self._within_s})
        self._within_s = within_s + own_s

    def add(self, seconds: Mapping[str, float]) -> None:
        """Take what others timed."""
        for name, value in seconds.items():
            self.seconds[name] = self.seconds.get(name, 0.0) + value

    def all_seconds(self) -> dict[str, float]:
        """By stage, and what is left of the time since the beginning."""
        rest_s = time.perf_counter() - self._begun - sum(self.seconds.values())
        known = {name: value for name, value in self.seconds.items() if name != OTHER}
        return known | {OTHER: self.seconds.get(OTHER, 0.0) + max(rest_s, 0.0)}


class ProgressLine:
    """Says how far each stage is, and leaves no line behind; use as a context, and give it to a `Runtime`.

    Terminals and notebooks write over a line from its beginning; where neither shows it, nothing is said.
    """

    def __init__(self) -> None:
        self.is_shown = sys.stderr.isatty() or "ipykernel" in sys.modules

    def __call__(self, stage: str, done: int, total: int) -> None:
        """As `planfit.runtime.Progress` is called."""
        self._write(f"planfit: {stage}{f' {done}/{total}' if total else ''}")

    def __enter__(self) -> "ProgressLine":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._write("")

    def _write(self, words: str) -> None:
        if self.is_shown:
            width = shutil.get_terminal_size().columns - 1
            sys.stderr.write(f"\r{words[:width]:<{width}}\r")
            sys.stderr.flush()
