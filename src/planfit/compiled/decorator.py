"""The decorator of compiled functions: `numba.njit`, with what is ready before numba's own cache."""

import pickle  # of the package's own code: see docs/security.md
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import FunctionCache
from numba.core.compiler import CompileResult
from numba.core.dispatcher import Dispatcher

from planfit.compiled.here import is_cpu_named, what_is_here
from planfit.compiled.ready_files import Ready, read_ready
from planfit.compiled.signatures import line_of

READY = Path(__file__).with_name("ready")
"""Where kernels lie that were compiled before; no part of the sources."""
_decorated: set[str] = set()
"""Names of all kernels so far: one that comes again was edited, and is not what was compiled."""


def kernel(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Compile a function by numba, without Python's lock held; also with options: `@kernel(fastmath=True)`.

    Args:
        function: of numbers, arrays and tuples of them alone.
        options: of `numba.njit`.
    """
    if function is None:
        return lambda each: kernel(each, **options)
    compiled = numba.njit(nogil=True, cache=True, **options)(function)
    name = f"{function.__module__}.{function.__qualname__}"
    ready = ready_here()
    # With NUMBA_DISABLE_JIT it is the function itself.
    if isinstance(ready, Ready) and isinstance(compiled, Dispatcher) and name not in _decorated:
        set_cache(compiled, ReadyFirst(function, name, ready))
    _decorated.add(name)
    return compiled


def set_cache(dispatcher: Any, its_cache: Any) -> None:
    """Let a compiled function keep what is compiled elsewhere, as numba's own `enable_caching` does."""
    dispatcher._cache = its_cache


@cache
def ready_here() -> Ready | str:
    """The package's kernels, looked for once: if this process can take them, or why not."""
    return usable(READY)


def usable(folder: Path) -> Ready | str:
    """The kernels of a folder, if this process can take them, or why not, in words for users."""
    ready = read_ready(folder)
    if isinstance(ready, str):
        return ready
    here = what_is_here()
    if is_cpu_named() and ready.made.cpu != here.cpu:
        return f"made for {ready.made.cpu}, numba is told to compile for {here.cpu}"
    return ready.made.misfit(here) or ready


class ReadyFirst(FunctionCache):
    """numba's cache of one kernel, before which the package is asked; nothing is written to the package."""

    def __init__(self, function: Callable[..., Any], name: str, ready: Ready) -> None:
        super().__init__(function)
        self._kernel = name
        self._ready = ready

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """What was compiled for a signature, or None: then numba compiles it."""
        blob = self._ready.blob(line_of(self._kernel, sig)) if isinstance(sig, tuple) else None
        if blob is None:
            return super().load_overload(sig, target_context)
        target_context.refresh()
        return CompileResult._rebuild(target_context, *pickle.loads(blob))
