"""The decorator of compiled functions: `numba.njit`, with what is ready before numba's own cache.

What is ready is taken where it was compiled for what there is in this process: versions, system, numba's
settings, the CPU.
"""

import pickle  # of the package's own code: see docs/security.md
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import numba
from llvmlite import binding
from numba.core import config
from numba.core.caching import FunctionCache
from numba.core.codegen import get_host_cpu_features
from numba.core.compiler import CompileResult
from numba.core.dispatcher import Dispatcher

from planfit.compiled.ready_files import Made, Ready, read_ready, source_digest
from planfit.compiled.signatures import line_of

READY = Path(__file__).with_name("ready")
"""Where kernels lie that were compiled before; no part of the sources."""
_CONFIG: Any = config
"""What the environment and `.numba_config.yaml` tell numba."""
LEVEL = "x86-64-v3"
"""CPUs since 2013 (Intel Haswell) and 2015 (AMD Excavator). Code for it passes over points as fast as that
for an EPYC of 2023 with its wider vectors (docs/adr/0029-kernels-in-the-wheel.md)."""
LEVEL_FEATURES = (
    *("64bit", "cmov", "cx8", "fxsr", "mmx", "sse", "sse2"),
    *("cx16", "popcnt", "sahf", "sse3", "sse4.1", "sse4.2", "ssse3"),
    *("avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave"),
)
"""Of the System V ABI for x86-64, levels 1 to 3, by LLVM's names."""
_SETTINGS = ("OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "BOUNDSCHECK", "DEBUGINFO_DEFAULT")
"""Of numba, which its own cache does not tell apart."""
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
        set_cache(compiled, _ReadyFirst(function, name, ready))
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


class _ReadyFirst(FunctionCache):
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


@cache
def what_is_here() -> Made:
    """What there is in this process: what numba compiles for, with all features of this machine's CPU unless
    somebody named others to numba."""
    text = get_host_cpu_features() if _CONFIG.CPU_FEATURES is None else _CONFIG.CPU_FEATURES
    settings = " ".join(f"{name}={getattr(_CONFIG, name, None)}" for name in _SETTINGS)
    return Made(
        source=source_digest(Path(__file__).parents[1]),
        python=f"{sys.implementation.cache_tag}{getattr(sys, 'abiflags', '')}",
        numba=numba.__version__,
        llvmlite=llvmlite.__version__,
        target=binding.get_process_triple(),
        settings=settings,
        cpu=_CONFIG.CPU_NAME or binding.get_host_cpu_name(),
        features=tuple(sorted(each[1:] for each in text.split(",") if each.startswith("+"))),
    )


def is_cpu_named() -> bool:
    """Whether somebody told numba for which CPU to compile."""
    return _CONFIG.CPU_NAME is not None or _CONFIG.CPU_FEATURES is not None


def settings_of_the_level() -> dict[str, str]:
    """Environment in which numba compiles for `LEVEL`, where this CPU has it; for the very CPU elsewhere.

    Without Intel's vector mathematics either way, a library that other machines need not have.
    """
    chosen = {"NUMBA_DISABLE_INTEL_SVML": "1"}
    if not is_cpu_named() and set(LEVEL_FEATURES) <= set(what_is_here().features):
        chosen["NUMBA_CPU_NAME"] = LEVEL
        chosen["NUMBA_CPU_FEATURES"] = ",".join(f"+{name}" for name in LEVEL_FEATURES)
    return chosen
