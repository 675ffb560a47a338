"""Scans with a file spoiled, and what the command line says of them."""

import shutil
from pathlib import Path

import pytest

from planfit.cli import run
from scan_samples import WRITERS, Sample, put, record3d_files, write_zip


def spoken(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, list[str], str]:
    """Exit code, lines that begin with `planfit:`, and all notes as one line."""
    code = run([str(word) for word in words])
    said = capsys.readouterr()
    assert "Traceback" not in said.err
    errors = [line for line in said.err.splitlines() if line.startswith("planfit: ")]
    if code == 2:
        assert said.err.splitlines()[-1:] == errors, said.err
    return code, errors, " ".join(line for line in said.out.splitlines() if "note:" in line)


def refused(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    """The line of a command that ends with exit code 2, without `planfit: `."""
    code, errors, _ = spoken(capsys, *words)
    assert code == 2
    assert len(errors[0]) < 2500
    return errors[0].removeprefix("planfit: ")


def files_of(kind: str, sample: Sample, folder: Path) -> dict[str, bytes]:
    if kind == "record3d":
        return record3d_files(sample)
    WRITERS[kind](folder / "scan", sample)
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def write_all(kind: str, files: dict[str, bytes], folder: Path) -> Path:
    shutil.rmtree(folder, ignore_errors=True)
    if kind == "record3d":
        folder.mkdir()
        write_zip(folder / "scan.r3d", files)
        return folder / "scan.r3d"
    for name, data in files.items():
        put(folder / name, data)
    return folder / "scan"
