"""What a call runs on without a runtime: progress where it can be seen, a cache where one is named."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from planfit.compiled.making import compile_what_is_not_ready
from planfit.errors import require
from planfit.runtime import ProgressLine, Runtime


@contextmanager
def running(runtime: Runtime | None, cache: str | Path | None, progress: bool) -> Iterator[Runtime]:
    """The runtime that a user gave, or one of what was asked for in its place.

    Args:
        runtime: threads, cache and progress.
        cache: folder that keeps finished stages.
        progress: whether terminals and notebooks show how far it is.

    Raises:
        OptionError: there are a runtime and a cache.
        OutputError: kernels cannot be compiled.
    """
    if runtime is not None:
        require(
            cache is None,
            "cache: expected a folder or a runtime, found both; give planfit.Runtime(cache_dir=...) alone",
        )
        yield runtime
        return
    with ProgressLine() as line:
        is_shown = progress and line.is_shown
        if is_shown:
            compile_what_is_not_ready(line)
        folder = None if cache is None else Path(cache)
        yield Runtime(cache_dir=folder, on_progress=line if is_shown else None)
