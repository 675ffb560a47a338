"""What code is compiled for in this process: versions, system, numba's settings, the CPU."""

import sys
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import numba
from llvmlite import binding
from numba.core import config
from numba.core.codegen import get_host_cpu_features

from planfit.compiled.ready_files import Made, source_digest

_CONFIG: Any = config
"""What the environment and `.numba_config.yaml` tell numba."""
PACKAGE = Path(__file__).parents[1]
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


@cache
def what_is_here() -> Made:
    """What there is in this process: what numba compiles for, with all features of this machine's CPU unless
    somebody named others to numba."""
    text = get_host_cpu_features() if _CONFIG.CPU_FEATURES is None else _CONFIG.CPU_FEATURES
    settings = " ".join(f"{name}={getattr(_CONFIG, name, None)}" for name in _SETTINGS)
    return Made(
        source=source_digest(PACKAGE),
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
