"""Compiled kernels in the package: taken where they are the very ones, compiled anew elsewhere."""

import dataclasses
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba.core import event

import planfit
from planfit.compiled import decorator, making, ready_files
from planfit.compiled.decorator import LEVEL, LEVEL_FEATURES, kernel, usable, what_is_here
from planfit.compiled.making import compiled_blob, make_ready
from planfit.compiled.ready_files import BLOBS, INDEX, Ready, read_ready, write_ready
from planfit.compiled.signatures import line_of, listed_lines, parse_line
from planfit.errors import OutputError

PLAIN = "planfit.matching.pair_kernels.take_within_budget int64[2,C] int64 int64[1,C]"
FAST = "planfit.lsq.moment_kernels.weigh_all float64[1,C] int64 float64"
CALLING = "planfit.matching.surfaces.registration_kernels."
ON_X86 = "64bit" in what_is_here().features


def doubled(numbers: np.ndarray) -> np.ndarray:
    return 2 * numbers


def tripled(numbers: np.ndarray) -> np.ndarray:
    return 3 * numbers


LINE = f"{__name__}.doubled float64[1,C]"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the kernel `doubled`, compiled for what is here."""
    monkey = pytest.MonkeyPatch()
    monkey.setattr(sys.modules[__name__], "doubled", kernel(doubled))
    write_ready(tmp_path, what_is_here(), "", {LINE: compiled_blob(LINE)})
    monkey.undo()
    return tmp_path


def compiled_and_result(
    monkeypatch: pytest.MonkeyPatch, folder: Path, tmp_path: Path, function: Callable[..., Any]
) -> tuple[int, list[float]]:
    """How often numba compiled, in a process that has this folder for the package's and no other cache."""
    monkeypatch.setattr("numba.core.config.CACHE_DIR", str(tmp_path / "numba"))
    monkeypatch.setattr(decorator, "ready_here", lambda: usable(folder))
    monkeypatch.setattr(decorator, "_decorated", set())
    with event.install_recorder("numba:compile") as recorder:
        result = kernel(function)(np.array([1.0, 2.0]))
    return sum(each.is_start for _, each in recorder.buffer), list(result)


def changed(folder: Path, **values: Any) -> None:
    """The same blobs, said to be made from, by or for something else."""
    ready = read_ready(folder)
    assert isinstance(ready, Ready)
    blob = ready.blob(LINE)
    assert blob is not None
    write_ready(folder, dataclasses.replace(ready.made, **values), "", {LINE: blob})


def test_a_ready_kernel_is_not_compiled(folder, tmp_path, monkeypatch):
    assert compiled_and_result(monkeypatch, folder, tmp_path, doubled) == (0, [2.0, 4.0])


def test_what_is_not_ready_is_compiled(tmp_path, monkeypatch):
    empty = tmp_path / "nothing"
    assert usable(empty) == "none are here"
    assert compiled_and_result(monkeypatch, empty, tmp_path, doubled) == (1, [2.0, 4.0])


def test_what_is_not_ready_is_compiled_once_and_told(folder, tmp_path, monkeypatch):
    ready = usable(folder)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "numba"))
    monkeypatch.setattr("numba.core.config.CACHE_DIR", str(tmp_path / "numba"))
    monkeypatch.setenv(
        "NUMBA_OPT", "2"
    )  # nothing ready is for that, in a process of its own neither
    monkeypatch.setattr(decorator, "ready_here", lambda: "none are here")
    monkeypatch.setattr(decorator, "_decorated", set())
    monkeypatch.setattr(making, "listed_lines", lambda: [PLAIN])
    module = import_module("planfit.matching.pair_kernels")
    function = module.take_within_budget.py_func

    def in_a_run(ready: Ready | str) -> list[tuple[str, int, int]]:
        told: list[tuple[str, int, int]] = []
        monkeypatch.setattr(making, "ready_here", lambda: ready)
        monkeypatch.setattr(module, "take_within_budget", kernel(function))
        making.compile_what_is_not_ready(lambda *what: told.append(what))
        return told

    assert in_a_run(ready) == []
    assert in_a_run("none are here") == [(making.COMPILING, 0, 0), (making.COMPILING, 1, 0)]
    assert in_a_run("none are here") == []  # numba has kept it


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("source", "0" * 64, "made for other sources of planfit than these"),
        ("python", "cpython-39", "made for cpython-39, found cpython-3"),
        ("numba", "0.1", "made for numba 0.1, found"),
        ("llvmlite", "0.1", "made for llvmlite 0.1, found"),
        ("target", "riscv64-unknown-linux-gnu", "made for riscv64-unknown-linux-gnu, found"),
        ("settings", "OPT=0", "made for numba's settings OPT=0, found"),
        ("features", ("avx1024",), "this one lacks avx1024"),
    ],
)
def test_a_kernel_made_for_something_else_is_compiled_anew(
    folder, tmp_path, monkeypatch, name, value, told
):
    changed(folder, **{name: value})
    reason = usable(folder)
    assert isinstance(reason, str)
    assert told in reason
    assert compiled_and_result(monkeypatch, folder, tmp_path, doubled) == (1, [2.0, 4.0])


def test_a_cpu_that_is_named_to_numba_is_believed(folder, monkeypatch):
    here = what_is_here()
    monkeypatch.setattr(decorator, "is_cpu_named", lambda: True)
    assert isinstance(usable(folder), Ready)
    changed(folder, cpu="another")
    assert usable(folder) == f"made for another, numba is told to compile for {here.cpu}"


def test_what_kernels_depend_on_changes_the_digest_and_nothing_else_does(tmp_path):
    package = tmp_path / "walls"
    constants, loops, words = (
        package / "sub" / f"{name}.py" for name in ("sizes", "loops", "words")
    )
    constants.parent.mkdir(parents=True)
    constants.write_text("BLOCK = 256\n")
    loops.write_text(
        "from walls.compiled import kernel\nfrom walls.sub import (\n    others,\n    sizes,\n)\n"
    )
    words.write_text("HELLO = 1\n")
    first = ready_files.source_digest(package)
    words.write_text("HELLO = 2\n")
    assert ready_files.source_digest(package) == first
    constants.write_text("BLOCK = 128\n")
    other = ready_files.source_digest(package)
    assert other != first
    constants.write_text("BLOCK = 256\n")
    loops.rename(package / "loops.py")
    assert ready_files.source_digest(package) not in (first, other)


def test_every_module_of_a_listed_kernel_is_in_the_digest(tmp_path):
    package = tmp_path / "planfit"
    shutil.copytree(
        Path(planfit.__file__).parent, package, ignore=lambda _, names: {"ready"} & {*names}
    )
    first = ready_files.source_digest(package)
    for module in {parse_line(line)[0].rpartition(".")[0] for line in listed_lines()}:
        path = package.joinpath(*module.split(".")[1:]).with_suffix(".py")
        path.write_text(path.read_text() + "\n")
        assert ready_files.source_digest(package) != first, module
        first = ready_files.source_digest(package)


def test_a_kernel_that_was_edited_and_loaded_anew_is_compiled(folder, tmp_path, monkeypatch):
    compiled_and_result(monkeypatch, folder, tmp_path, doubled)
    monkeypatch.setattr(tripled, "__qualname__", "doubled")
    assert list(kernel(tripled)(np.array([1.0, 2.0]))) == [3.0, 6.0]


def test_another_signature_is_compiled(folder, tmp_path, monkeypatch):
    compiled_and_result(monkeypatch, folder, tmp_path, doubled)
    monkeypatch.setattr(decorator, "_decorated", set())
    assert list(kernel(doubled)(np.array([1, 2]))) == [2, 4]


@pytest.mark.parametrize("at", [0, 1000, -1])
def test_a_spoilt_kernel_is_compiled_anew(folder, tmp_path, monkeypatch, at):
    data = bytearray((folder / BLOBS).read_bytes())
    data[at] ^= 1
    (folder / BLOBS).write_bytes(data)
    assert compiled_and_result(monkeypatch, folder, tmp_path, doubled) == (1, [2.0, 4.0])


def test_kernels_that_were_cut_off_or_removed_are_compiled_anew(folder, tmp_path, monkeypatch):
    whole = (folder / BLOBS).read_bytes()
    (folder / BLOBS).write_bytes(whole[:1000])
    assert compiled_and_result(monkeypatch, folder, tmp_path, doubled) == (1, [2.0, 4.0])
    (folder / BLOBS).unlink()
    ready = usable(folder)
    assert isinstance(ready, Ready)
    assert ready.blob(LINE) is None


@pytest.mark.parametrize("cut", [0, 10, 500])
def test_a_damaged_list_is_none(folder, cut):
    text = (folder / INDEX).read_bytes()
    (folder / INDEX).write_bytes(text[:cut])
    assert usable(folder) == "their list is damaged"
    (folder / INDEX).write_bytes(text.replace(b"float64", b"float32"))
    assert usable(folder) == "their list is damaged"


def test_a_list_of_another_format_is_none(folder, monkeypatch):
    monkeypatch.setattr(ready_files, "_FORMAT", 2)
    assert usable(folder) == "of format 1, this planfit reads 2"


@pytest.mark.parametrize("line", listed_lines())
def test_every_listed_kernel_is_one(line):
    name, signature = parse_line(line)
    assert line_of(name, signature) == line
    module, _, function = name.rpartition(".")
    __import__(module)
    assert hasattr(getattr(sys.modules[module], function), "py_func")


def test_types_that_no_line_tells_are_not_listed():
    from numba import types

    array = types.Array(types.float32, 2, "A", readonly=True)
    assert line_of("f", (array, types.Tuple([types.int8, array]))) == (
        "f float32[2,A,ro] (int8 float32[2,A,ro])"
    )
    assert line_of("f", (types.unicode_type,)) == ""
    with pytest.raises(ValueError, match="expected the type of an argument, found 'text'"):
        parse_line("f text")


def test_kernels_made_in_a_folder_are_for_the_level_and_compute_the_same(tmp_path):
    """Bit for bit where sums keep their order; where numba may change it (`fastmath`), to 15 digits."""
    ready = make_ready(tmp_path / "ready", [PLAIN, FAST])
    assert set(ready.places) == {PLAIN, FAST}
    has_level = set(LEVEL_FEATURES) <= set(what_is_here().features)
    assert (ready.made.cpu == LEVEL) == (ON_X86 and has_level)
    assert isinstance(usable(tmp_path / "ready"), Ready)
    code = """
import sys
from pathlib import Path
import numpy as np
from numba.core import event
import planfit
from planfit.compiled import decorator
decorator.READY = Path(sys.argv[1])
with event.install_recorder("numba:compile") as recorder:
    from planfit.lsq.moment_kernels import weigh_all
    from planfit.matching.pair_kernels import take_within_budget
    rng = np.random.default_rng(0)
    pairs = rng.integers(0, 50, (500, 2))
    taken = take_within_budget(pairs, 3, np.zeros(50, dtype=np.int64))
    losses = [np.stack(weigh_all(rng.exponential(size=1001), kind, 0.7)) for kind in range(5)]
np.savez(sys.argv[2], taken=taken, losses=losses, compiled=len(recorder.buffer))
"""
    made = []
    for name in ("ready", "nothing"):
        path = tmp_path / f"{name}.npz"
        words = [sys.executable, "-c", code, str(tmp_path / name), str(path)]
        done = subprocess.run(words, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        made.append(np.load(path, allow_pickle=False))
    assert made[0]["compiled"] == 0
    np.testing.assert_array_equal(made[0]["taken"], made[1]["taken"])
    np.testing.assert_allclose(made[0]["losses"], made[1]["losses"], rtol=1e-15)


@pytest.mark.slow
def test_kernels_are_made_anew_where_all_are_ready(tmp_path):
    """One that calls another, which it would find ready."""
    lines = [line for line in listed_lines() if line.startswith(CALLING)]
    make_ready(tmp_path / "ready", lines)
    code = """
import sys
from pathlib import Path
import planfit
from planfit.compiled import decorator, making
decorator.READY = Path(sys.argv[1])
making.compile_share(Path(sys.argv[2]), sys.argv[3:])
"""
    words = [sys.executable, "-c", code, str(tmp_path / "ready"), str(tmp_path / "again"), *lines]
    caches = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "numba")}
    done = subprocess.run(words, capture_output=True, text=True, env=caches)
    assert done.returncode == 0, done.stderr
    again = read_ready(tmp_path / "again")
    assert isinstance(again, Ready)
    assert set(again.places) == set(lines)


def test_what_cannot_be_compiled_or_written_is_told_in_a_line(tmp_path):
    with pytest.raises(OutputError, match="expected a kernel, found no nothing in planfit"):
        make_ready(tmp_path, ["planfit.errors.nothing int64"])
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="cannot be written"):
        make_ready(tmp_path / "file" / "ready", [PLAIN])
