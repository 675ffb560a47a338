"""`planfit doctor`: what works is said to, and what is broken is found, named, and ends with exit code 1."""

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import planfit
from planfit.cli import doctor, run
from planfit.compiled import decorator, making

ROOT = Path(__file__).parents[2]


def findings(shown: str) -> dict[str, dict[str, str]]:
    return {each["name"]: each for each in json.loads(shown)["findings"]}


def test_a_sound_installation_works(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "chunk").write_bytes(bytes(2_000_000))
    assert run(["doctor", "--json", "--cache", str(tmp_path)]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["works"] is True
    assert record["planfit"] == planfit.__version__
    found = {each["name"]: each["found"] for each in record["findings"]}
    assert found["cache"] == f"{tmp_path}: 1 files, 2.0 MB"
    assert re.fullmatch(r"\d+ mm off before, \S+ mm after, in \d+\.\d s", found["solver"])
    assert re.match(r"\d+\.\d+ GB in ", found["free for results"])


def test_every_dependency_and_every_extra_is_looked_at(capsys: pytest.CaptureFixture[str]) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = set(project["optional-dependencies"]) - {"bench", "docs", "dev"}
    assert set(doctor.EXTRAS) == extras
    assert run(["doctor"]) == 0
    shown = capsys.readouterr().out
    for name in ("numpy", "numba", "opencv", *extras):
        assert re.search(rf"^  {name}", shown, re.MULTILINE), name
    assert shown.endswith("all that planfit needs works\n")


def test_it_starts_without_libraries_and_names_those_that_are_broken() -> None:
    code = """
import sys
class Broken:
    def find_spec(self, name, *_):
        if name in ("numpy", "tyro", "rich"):
            raise ImportError("libfoo.so.3: cannot open shared object file")
sys.meta_path.insert(0, Broken())
from planfit.cli import main
main(["doctor"])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 1
    assert "planfit" not in done.stderr  # other libraries complain of numpy there
    assert "!!numpy" in done.stdout
    assert "tyro: cannot be imported (ImportError: libfoo.so.3" in done.stdout
    assert "pip install --force-reinstall tyro" in done.stdout
    assert "!!solver" in done.stdout


def test_a_solver_that_ends_elsewhere_is_found(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(doctor, "_solve_tiny_problem", lambda: (0.05, 0.1))
    assert run(["doctor", "--json"]) == 1
    assert "expected the true poses" in findings(capsys.readouterr().out)["solver"]["fault"]


def test_a_version_that_is_too_old_is_found(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(doctor, "requires", lambda _: ["numpy>=99", "scipy>=1"])
    assert run(["doctor", "--json"]) == 1
    found = findings(capsys.readouterr().out)
    assert "expected >=99" in found["numpy"]["fault"]
    assert found["scipy"]["fault"] == ""


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="no folder that nobody can write")
def test_a_folder_that_cannot_be_written_is_found(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["doctor", "--json", "--folder", "/proc/nothing/here"]) == 1
    assert "cannot be written" in findings(capsys.readouterr().out)["free for results"]["fault"]


@pytest.mark.parametrize("words", [["x"], ["--cache"], ["--folder"]], ids=" ".join)
def test_words_that_it_does_not_take(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["doctor", *words]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_compiled_kernels_are_made_and_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """None, then one, then a spoilt one: none of it is a fault, since numba compiles what is missing."""
    lines = ["planfit.matching.pair_kernels.take_within_budget int64[2,C] int64 int64[1,C]"]
    monkeypatch.setattr(decorator, "READY", tmp_path)
    monkeypatch.setattr(making, "listed_lines", lambda: lines)

    def told(*words: str) -> str:
        assert run(["doctor", "--json", *words]) == 0
        return findings(capsys.readouterr().out)["kernels"]["found"]

    assert told().startswith("none ready: none are here; each is compiled in front of a first run")
    assert re.fullmatch("1 ready, compiled ahead for [a-z0-9-]+", told("--compile"))
    (tmp_path / "kernels.bin").write_bytes(b"spoilt")
    assert "; 1 of them spoilt: each is compiled in front of a first run" in told("--no-compile")


def test_a_switch_of_doctor_takes_no_value(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["doctor", "--compile=yes"]) == 2
    assert "--compile: expected no value behind it, found 'yes'" in capsys.readouterr().err
