"""Results on disk, the page made of them, and two variants compared on the command line."""

from dataclasses import replace
from pathlib import Path

import pytest

from paper_tables.command import run
from paper_tables.page import make_page
from paper_tables.results import Measured, Results, read_results
from planfit.errors import OutputError

SCANS = ("redwood-like 1", "redwood-like 2")


def measured(scan: str, variant: str, **metrics: float) -> Measured:
    return Measured("redwood-like", scan, variant, metrics)


def results(*rows: Measured) -> Results:
    return Results("1.0", "2 cores", rows)


def two_presets() -> Results:
    values = {"paper/all": (0.04, 0.08), "default/all": (0.01, 0.02)}
    rows = [
        measured(scan, variant, ate=ate[k], mme=-4.0 - k)
        for variant, ate in values.items()
        for k, scan in enumerate(SCANS)
    ]
    return results(*rows)


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "results.json"
    written = results(
        measured("a", "paper/all", ate=0.1), Measured("x", "b", "y", {}, ("warning",), "refused")
    )
    written.write(path)
    assert read_results(path) == written
    assert [p.name for p in path.parent.iterdir()] == ["results.json"]


def test_true_poses_stand_beside_the_presets() -> None:
    truth = [measured(scan, "default/true poses", mme=-4.0 - k) for k, scan in enumerate(SCANS)]
    page = make_page(replace(two_presets(), measured=(*two_presets().measured, *truth)))
    assert "| MME | -4.500 | -4.500 | -4.500 |" in page
    assert "| ATE, cm | - | 6.000 | 1.500 |" in page
    assert "| true poses | -4.50 ± 0.71 |" in page
    assert "| MME | - | -4.500 |" in make_page(two_presets())
    # A scan that one preset refused is left out of all columns.
    refused = [m for m in two_presets().measured if (m.variant, m.scan) != ("paper/all", SCANS[1])]
    page = make_page(results(*refused, *truth))
    assert "| MME | -4.000 | -4.000 | -4.000 |" in page


def test_the_papers_own_descent_is_a_section_of_its_own() -> None:
    assert "Not measured here" in make_page(two_presets())
    rows = [
        Measured("descent", "small", variant, {"ate": ate, "step_ms": ms})
        for variant, ate, ms in (
            ("paper/all", 0.03, 20.0),
            ("paper/all, gradient descent", 0.07, 5.0),
            ("default/all", 0.01, 9.0),
        )
    ]
    page = make_page(replace(two_presets(), measured=(*two_presets().measured, *rows)))
    assert "2 scans in 1 sets" in page  # it is none of the scans of the tables
    assert "## Descent" not in page
    section = page.split("## The paper's own descent")[1].split("\n## ")[0]
    (ours,) = [x for x in section.splitlines() if x.startswith("| paper: all, gradient descent |")]
    assert "7.00" in ours
    assert "5.00" in ours
    assert "gradient descent" not in page.split("## The paper's own descent")[0]


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"planfit": "1", "conditions": "", "measured": [1]}']
)
def test_another_file_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "other.json"
    path.write_text(text)
    with pytest.raises(OutputError, match="expected results of 'benchmarks/paper_tables paper'"):
        read_results(path)


def test_cells_are_mean_and_standard_deviation_beside_the_papers_number() -> None:
    lines = make_page(two_presets()).splitlines()
    (paper,) = [x for x in lines if x.startswith("| paper: all |") and "(-4.02)" in x and "±" in x][
        :1
    ]
    assert "-4.50 ± 0.71 (-4.02)" in paper
    assert "6.00 ± 2.83" in paper  # ATE in cm
    (default,) = [x for x in lines if x.startswith("| default: all |")][:1]
    assert "1.50 ± 0.71" in default
    assert "(" not in default


def test_presets_are_compared_scan_by_scan() -> None:
    lines = make_page(two_presets()).splitlines()
    (row,) = [x for x in lines if x.startswith("| ATE, cm |") and "of 2" in x]
    assert row == "| ATE, cm | - | 6.000 | 1.500 | -4.500 | 2.121 | 2 of 2 |"


@pytest.mark.parametrize(("with_walls", "holds"), [((1.0, 1.1), "yes"), ((1.0, 4.0), "no")])
def test_directions_of_the_paper(with_walls: tuple[float, float], holds: str) -> None:
    rows = [measured(scan, "paper/geometric", nsd=2.0 + k) for k, scan in enumerate(SCANS)]
    rows += [
        measured(scan, "paper/geometric + walls", nsd=nsd)
        for scan, nsd in zip(SCANS, with_walls, strict=True)
    ]
    (line,) = [
        x
        for x in make_page(results(*rows)).splitlines()
        if x.startswith("| the walls term brings walls to the plan")
    ]
    assert line.endswith(f"| {holds} |")


def test_runs_that_refused_are_told() -> None:
    refused = Measured("redwood-like", SCANS[0], "paper/all", {}, failed="no wall was seen")
    page = make_page(results(refused, measured(SCANS[1], "paper/all", ate=0.1)))
    assert "paper/all on redwood-like 1: no wall was seen" in page
    assert "1 runs refused" in page


def test_page_and_compare_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, page = tmp_path / "results.json", tmp_path / "results.md"
    two_presets().write(path)
    assert run(["page", str(path), "-o", str(page)]) == 0
    assert page.read_text(encoding="utf-8") == make_page(two_presets())
    capsys.readouterr()
    assert run(["compare", f"{path}:paper/all", str(path)]) == 0
    (row,) = [x for x in capsys.readouterr().out.splitlines() if x.strip().startswith("ate")]
    assert row.split() == ["ate", "0.06", "0.015", "-0.045", "0.0212", "-3.0", "2", "of", "2"]


def test_compare_names_what_is_missing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, other = tmp_path / "results.json", tmp_path / "other.json"
    two_presets().write(path)
    assert run(["compare", str(path), f"{path}:default/nothing"]) == 2
    assert "expected metrics of default/nothing, found those of default/all, paper/all" in (
        capsys.readouterr().err
    )
    elsewhere = [replace(m, scan=f"other {m.scan}") for m in two_presets().measured]
    results(*elsewhere).write(other)
    assert run(["compare", str(path), str(other)]) == 2
    assert "run both on the same scans and seeds" in capsys.readouterr().err
    assert run(["compare", str(path), str(tmp_path / "none.json")]) == 2
    assert "cannot be read" in capsys.readouterr().err
