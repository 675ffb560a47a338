"""The machine that golden runs are made on, and what makes them the same on others as far as can be."""

import platform
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path

from threadpoolctl import threadpool_info

from planfit.compiled.decorator import READY, ready_here, settings_of_the_level, what_is_here
from planfit.compiled.making import make_ready

_LIBRARIES = ("numpy", "scipy", "numba", "llvmlite", "opencv-python-headless", "shapely", "ezdxf")
_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
_OF_THE_LEVEL = {
    "OPENBLAS_CORETYPE": "Haswell",
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512F AVX512CD "
    "AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL AVX512_SPR",
}
"""BLAS and numpy as on a CPU that has no more than the level of the kernels. With what an EPYC of 2023 has
besides, some pixels of colour are rendered one level off, and poses lie up to 4e-7 m away."""


def environment(folder: Path) -> dict[str, str]:
    """Variables for the processes that run.

    All is computed as on a CPU of the level that kernels are compiled for, where this one has it: code for
    the very CPU adds in another order. Runs are two at a time, so BLAS has one thread each.

    Args:
        folder: for what numba compiles all the same. Its usual cache knows a kernel by its own file: an edit
            of what the kernel calls would go unseen.
    """
    chosen = settings_of_the_level()
    if "NUMBA_CPU_NAME" in chosen:
        chosen |= _OF_THE_LEVEL
    return chosen | dict.fromkeys(_ONE_THREAD, "1") | {"NUMBA_CACHE_DIR": str(folder)}


def ensure_ready_kernels() -> bool:
    """Compile the package's kernels where those that are ready are not of these sources; whether it was so.

    Raises:
        OutputError: they cannot be compiled, or not be written.
    """
    if not isinstance(ready_here(), str):
        return False
    make_ready(READY)
    return True


def describe_machine() -> dict[str, str]:
    """What the bits of this process follow from: the processor and what is installed, by name."""
    blas = {f"{each.get('version')} {each.get('architecture')}" for each in threadpool_info()}
    return {
        "system": f"{platform.system()} {platform.machine()}",
        "processor": _processor(),
        "python": platform.python_version(),
        **{name: version(name) for name in _LIBRARIES},
        "blas": ", ".join(sorted(blas)),
        "kernels": what_is_here().cpu,
    }


def what_differs(here: Mapping[str, str], kept: Mapping[str, str]) -> str:
    """In words; empty where it is the same machine."""
    return "; ".join(
        f"{name} {here.get(name)} instead of {kept.get(name)}"
        for name in dict.fromkeys((*here, *kept))
        if here.get(name) != kept.get(name)
    )


def _processor() -> str:
    """Its model where the system tells."""
    try:
        with Path("/proc/cpuinfo").open(encoding="utf-8") as file:
            told = dict(line.split(":", 1) for line in file if ":" in line)
    except OSError:
        return platform.processor()
    names = {name.strip(): value.strip() for name, value in told.items()}
    parts = (names.get(name, "") for name in ("model name", "cpu family", "model", "stepping"))
    return " ".join(part for part in parts if part) or platform.processor()
