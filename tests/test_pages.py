"""The commands, flags, warnings and code that the pages show are those of planfit."""

import re
import shlex
import types
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import planfit
import reference
from planfit.cli.commands import topics
from planfit.cli.speech import NAMES
from planfit.errors import OptionError
from planfit.floorplan import PlanOptions
from planfit.scan import ScanOptions
from planfit.scan.source import FolderSource
from planfit.scan.usable_frames import scan_from_recording
from scan_samples import make_sample, matrix_text, png, put

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
OTHERS = {"--help", "--help-all", "--version", "--seeds", "--tables", *NAMES}
"""Flags that every command has, and those of benchmarks."""
PAGES = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]


def shown_commands(text: str) -> list[str]:
    """Lines of code that begin with planfit, and `planfit ...` within sentences."""
    lines = re.findall(r"^ {4}(?:\S*/)?(planfit .*)$", text, re.MULTILINE)
    fenced = re.findall(r"^```[a-z]*\n(.*?)```", text, re.DOTALL | re.MULTILINE)
    lines += [line for code in fenced for line in code.splitlines() if line.startswith("planfit ")]
    plain = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    inline = re.findall(r"`(planfit [^`]+)`", plain)
    return lines + [" ".join(one.split()) for one in inline]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_shown_parse(page: Path) -> None:
    for line in shown_commands(page.read_text()):
        words = shlex.split(re.split(r" [|>] ", line)[0], comments=True)[1:]
        if words[0] in ("COMMAND", "--help", "--version"):
            continue
        if words[0] == "help":
            assert set(words[1:]) <= {*topics(), "TOPIC"}, f"{page.name}: {line}"
            continue
        types_by_name = reference.command_types()
        n_words = 2 if " ".join(words[:2]) in types_by_name else 1
        name, rest = " ".join(words[:n_words]), words[n_words:]
        if any(other.startswith(f"{name} ") for other in types_by_name) and not rest:
            continue  # a command with commands of its own, named
        assert name in types_by_name, f"{page.name}: {line}"
        if rest and rest != ["--help"] and rest != ["..."]:
            try:
                reference.parsed(name, _with_needed(name, rest))
            except (SystemExit, OptionError):
                pytest.fail(f"{page.name}: does not parse: {line}")


def _with_needed(name: str, rest: list[str]) -> list[str]:
    """Sentences may leave out what another sentence has said: `planfit plan FILE -o ...`."""
    rest = [{"METRES_PER_UNIT": "4", "SHELL": "bash"}.get(word, word) for word in rest]
    if name in ("refine", "align") and "-o" not in rest:
        rest = [*rest, "-o", "OUT"]
    return rest


@cache
def known_flags() -> set[str]:
    """Of all commands."""
    return set().union(*(reference.all_flags(name) for name in reference.command_types()))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_flags_named_exist(page: Path) -> None:
    known = known_flags()
    for flag in re.findall(r"`(--[a-z][\w.-]*\w)[^`]*`", page.read_text()):
        is_group = any(one.startswith(f"{flag}.") for one in known)
        assert is_group or flag in known | OTHERS, f"{page.name}: {flag}"


def warnings_explained() -> list[str]:
    """Words in the tables of warnings."""
    page = (DOCS / "getting-started.md").read_text()
    tables = page[page.index("## What the warnings mean") :]
    return re.findall(r"^\| `([^`]+)` \|", tables, re.MULTILINE)


def test_warnings_explained_are_words_of_planfit() -> None:
    sources = "\n".join(path.read_text() for path in sorted((ROOT / "src").rglob("*.py")))
    whole = re.sub(r'"\s*\n\s*f?"', "", sources)
    said = warnings_explained()
    assert len(said) > 20
    for words in said:
        assert words in whole, f"getting-started.md explains {words!r}, which planfit never says"


def test_every_warning_is_explained() -> None:
    said = warnings_explained()
    source = (ROOT / "src/planfit/pipeline/diagnostics.py").read_text()
    kinds = {kind.lower() for kind in re.findall(r"Kind\.([A-Z_]+)", source)}
    rows = re.findall(
        r"^\| `(\w+)` .*\| (.*) \|$", (DOCS / "findings.md").read_text(), re.MULTILINE
    )
    told = [sentence for kind, sentence in rows if kind in kinds - {"more_steps_changed"}]
    assert len(told) >= 8
    for sentence in told:
        assert any(words in sentence for words in said), f"not explained: {sentence}"


def example_module(page: str, number: int) -> types.ModuleType:
    """A Python module that a page of docs/ shows in full."""
    code = re.findall(r"```python\n(.*?)```", (DOCS / page).read_text(), re.DOTALL)
    module = types.ModuleType(f"example_{number}")
    exec(compile(code[number], page, "exec"), module.__dict__)
    return module


def test_layouts_of_the_page_read_and_write(tmp_path: Path) -> None:
    sample = make_sample()
    n, camera = len(sample.poses), sample.camera
    lens = f"{camera.fx:.9f} {camera.fy:.9f} {camera.cx} {camera.cy}\n"
    files, rows = tmp_path / "files", tmp_path / "rows"
    for i in range(n):
        put(files / f"image_{i}.png", png(sample.color[i]))
        put(files / f"depth_{i}.png", png(sample.depth_mm[i]))
        put(files / f"pose_{i}.txt", matrix_text(sample.poses[i]))
        put(rows / "color" / f"{i}.png", png(sample.color[i]))
        put(rows / "depth" / f"{i}.png", png(sample.depth_mm[i]))
    put(rows / "poses.txt", matrix_text(sample.poses.reshape(-1, 16)))
    for number, folder in enumerate((files, rows)):
        put(folder / "camera.txt", lens)
        layout = example_module("own-layout.md", number).LAYOUT
        assert layout.recognise(FolderSource(folder))
        assert not layout.recognise(FolderSource(tmp_path))
        scan = scan_from_recording(layout.read(FolderSource(folder), ScanOptions()), ScanOptions())
        assert_allclose(scan.world_from_cams, sample.poses, atol=1e-6)
        assert_allclose(scan.cameras[0].fx, camera.fx)
        depth = np.nan_to_num(scan.files.depth(2))
        assert_allclose(depth, sample.depth_mm[2] / 1000, atol=1e-6)
        np.testing.assert_array_equal(scan.files.color(1), sample.color[1])
        out = tmp_path / f"out{number}"
        out.mkdir()
        scan.files.write_poses(out, scan.world_from_cams)
        assert sorted(path.name for path in out.iterdir()) == (
            ["poses.txt"] if number else [f"pose_{i}.txt" for i in range(n)]
        )
        written = np.concatenate([np.loadtxt(path) for path in sorted(out.iterdir())])
        assert_allclose(written.reshape(-1, 4, 4), sample.poses, atol=1e-6)
    (files / "pose_1.txt").unlink()
    (files / "image_2.png").unlink()
    layout = example_module("own-layout.md", 0).LAYOUT
    scan = scan_from_recording(layout.read(FolderSource(files), ScanOptions()), ScanOptions())
    assert len(scan) == n - 1
    assert scan.skipped == ("frame 1: pose_1.txt is missing",)
    assert [scan.lacking[k] for k in range(3)] == ["", "colour", ""]
    assert any("frame 2: image_2.png is missing" in each for each in scan.warnings)
    put(rows / "poses.txt", "1 2 3\n")
    layout = example_module("own-layout.md", 1).LAYOUT
    with pytest.raises(planfit.errors.ScanError, match="expected 16 numbers a line, found 3"):
        layout.read(FolderSource(rows), ScanOptions())


def test_plan_reader_of_the_page_reads(tmp_path: Path) -> None:
    reader = example_module("extending.md", 0)
    path = tmp_path / "plan.txt"
    # Two faces of a wall 0.2 m thick.
    path.write_text("0 0 4000 0\n0 200 4000 200\n")
    plan = reader.read_lines(path, PlanOptions(unit="mm"))
    assert_allclose(plan.ends, [[[0, 0], [4, 0]], [[0, 0.2], [4, 0.2]]])
    assert_allclose(plan.normals, [[0, -1], [0, 1]], atol=1e-9)
    assert plan.is_oriented.all()
    assert plan.source.unit_from == "--unit"
    path.write_text("1 2 3\n")
    with pytest.raises(planfit.errors.FloorplanError, match="found 3 numbers a line"):
        reader.read_lines(path, PlanOptions())
