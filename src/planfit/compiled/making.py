"""Compile the listed kernels ahead of their first call: for `planfit doctor --compile`, for wheels, and in
front of a first run without either.

`python -m planfit.compiled.making FOLDER < LINES` compiles the kernels of some lines into a folder, as
`make_ready` wants them; without FOLDER, into numba's own cache.
"""

import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from importlib.metadata import distribution
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from numba import types
from numba.core import config, event, serialize
from numba.core.caching import NullCache
from numba.core.dispatcher import Dispatcher

from planfit.compiled import decorator
from planfit.compiled.decorator import ready_here, set_cache, settings_of_the_level, what_is_here
from planfit.compiled.ready_files import Ready, read_ready, write_ready
from planfit.compiled.signatures import listed_lines, parse_line
from planfit.errors import OutputError

COMPILING = "compile once, a minute or two"
"""What progress calls it."""
_MAX_PROCESSES = 4
"""Each takes 300 MB."""


def compile_what_is_not_ready(report: Callable[[str, int, int], None]) -> bool:
    """Compile the listed kernels into numba's own cache, so that it happens in no stage of a run.

    True where there were any to compile.

    Nothing is done where the package has them ready, and nothing is said where numba has kept all. In
    processes of their own: numba compiles one at a time in each.

    Raises:
        OutputError: a kernel cannot be compiled.
    """
    if isinstance(ready_here(), Ready) or vars(config)["DISABLE_JIT"]:
        return False
    lines = [line for line in listed_lines() if not _is_kept(line)]
    if lines:
        report(COMPILING, 0, 0)
        shares = _shares(lines, _n_processes())
        with ThreadPoolExecutor(len(shares)) as pool:
            list(pool.map(lambda share: _in_a_process([], share, {}), shares))
        report(COMPILING, 1, 0)
    return bool(lines)


def _is_kept(line: str) -> bool:
    """Whether numba has the kernel of a line in its cache, and so at hand now."""
    dispatcher, signature = _dispatcher_of(line)
    try:
        with event.install_listener("numba:compile", _Refusing()):
            dispatcher.compile(signature)
    except _NotKeptError:
        return False
    return True


class _NotKeptError(Exception):
    """Instead of being compiled."""


class _Refusing(event.Listener):
    """Stops numba where it begins to compile."""

    def on_start(self, event: object) -> None:  # noqa: ARG002
        """What is kept comes to no compilation."""
        raise _NotKeptError

    def on_end(self, event: object) -> None:
        """Nothing was compiled."""


def make_ready(folder: Path, lines: Sequence[str] | None = None) -> Ready:
    """Compile kernels into a folder, in the place of those that it holds.

    In processes of their own: numba is told for which CPU to compile before it starts. All take one to two
    minutes of CPU time.

    Args:
        folder: `decorator.READY` is the package's own, which runs look into.
        lines: kernels and signatures; by default all of `signatures.txt`.

    Raises:
        OutputError: the folder cannot be written, or a kernel cannot be compiled.
    """
    lines = listed_lines() if lines is None else lines
    shares = _shares(lines, _n_processes())
    with TemporaryDirectory() as temporary, ThreadPoolExecutor(len(shares)) as pool:
        parts = [Path(temporary) / str(i) for i in range(len(shares))]
        made = list(pool.map(_compile_apart, parts, shares))
    blobs = {line: blob for _, part in made for line, blob in part.items()}
    assert sorted(blobs) == sorted(lines)
    first = made[0][0]
    try:
        write_ready(folder, first.made, first.wheel_tag, blobs)
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be written ({error.strerror}); run it as who installed planfit"
        ) from error
    ready = read_ready(folder)
    assert isinstance(ready, Ready)
    return ready


def _compile_apart(folder: Path, lines: Sequence[str]) -> tuple[Ready, dict[str, bytes]]:
    """Compile in a process of its own, by way of a folder that is not there yet.

    Raises:
        OutputError: a kernel cannot be compiled.
    """
    # numba's own cache too: what lies in the user's was perhaps compiled by other settings.
    settings = settings_of_the_level() | {"NUMBA_CACHE_DIR": str(folder / "numba")}
    _in_a_process([str(folder)], lines, settings)
    ready = read_ready(folder)
    assert isinstance(ready, Ready)
    blobs = {line: ready.blob(line) for line in ready.places}
    return ready, {line: blob for line, blob in blobs.items() if blob is not None}


def _in_a_process(words: list[str], lines: Sequence[str], settings: dict[str, str]) -> None:
    """This module's program, with kernels of lines to compile.

    Raises:
        OutputError: it fails.
    """
    done = subprocess.run(
        [sys.executable, "-m", "planfit.compiled.making", *words],
        env={**os.environ, **settings},
        input="\n".join(lines),
        capture_output=True,
        text=True,
    )
    if done.returncode:
        last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        raise OutputError(f"kernels: cannot be compiled ({last}); each will be at its first call")


def _n_processes() -> int:
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return min(usable or 1, _MAX_PROCESSES)


def _shares(lines: Sequence[str], n: int) -> list[list[str]]:
    """Lines in up to n shares, by modules: kernels of one call each other, which are compiled once so."""
    modules = sorted({_module_of(line) for line in lines})
    shares = [[line for line in lines if _module_of(line) in modules[i::n]] for i in range(n)]
    return [share for share in shares if share]


def _module_of(line: str) -> str:
    return line.split()[0].rpartition(".")[0]


def compile_share(folder: Path, lines: Sequence[str]) -> None:
    """Compile the kernels of some lines in this process, for what numba is told, into a folder.

    Raises:
        ValueError: a line names no kernel.
    """
    # Nothing is taken ready: what was loaded for who calls it could not be written again.
    decorator.READY = folder
    write_ready(folder, what_is_here(), wheel_tag(), {line: compiled_blob(line) for line in lines})


def compiled_blob(line: str) -> bytes:
    """The kernel and signature of a line, compiled, in the form of numba's own cache.

    Raises:
        ValueError: the line names no kernel.
    """
    dispatcher, signature = _dispatcher_of(line)
    set_cache(dispatcher, NullCache())  # compiled here and now, whatever is kept
    dispatcher.compile(signature)
    return serialize.dumps(dispatcher.overloads[signature]._reduce())


def _dispatcher_of(line: str) -> tuple[Any, tuple[types.Type, ...]]:
    """The kernel of a line, and types of its arguments.

    Raises:
        ValueError: the line names no kernel.
    """
    name, signature = parse_line(line)
    module, _, function = name.rpartition(".")
    dispatcher = getattr(import_module(module), function, None)
    if not isinstance(dispatcher, Dispatcher):
        raise ValueError(f"{line!r}: expected a kernel, found no {function} in {module}")
    return dispatcher, signature


def wheel_tag() -> str:
    """Tag of a wheel that carries what is compiled here: that of the numba which compiles it.

    Code refers to nothing but what numba and its LLVM offer by name, so it runs where this very numba does.
    """
    text = distribution("numba").read_text("WHEEL") or ""
    tags = [line.split()[1] for line in text.splitlines() if line.startswith("Tag:")]
    return tags[0] if tags else ""


if __name__ == "__main__":
    to_compile = sys.stdin.read().splitlines()
    if len(sys.argv) > 1:
        compile_share(Path(sys.argv[1]), to_compile)
    else:
        for each in to_compile:
            kernel, types_of_it = _dispatcher_of(each)
            kernel.compile(types_of_it)
