"""What the documents say is so: links lead somewhere, the examples run, the versions agree."""

import json
import re
import runpy
from pathlib import Path

import pytest

import planfit
from command_flags import group_of
from planfit.cli.refine import RefineArguments

ROOT = Path(__file__).parents[1]
PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for link in re.findall(r"\]\(([^)#]+)", page.read_text()):
        if not link.startswith("http"):
            assert (page.parent / link).exists(), f"{page.name} links to {link}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_modules_named_in_pages_exist(page: Path) -> None:
    for name in re.findall(r"`([a-z_]+/[a-z_/]+\.py)`", page.read_text()):
        assert (ROOT / "src" / "planfit" / name).exists() or (ROOT / name).exists(), name


def test_site_leads_to_every_page() -> None:
    nav = (ROOT / "mkdocs.yml").read_text().split("\nnav:\n")[1]
    listed = re.findall(r": (\S+\.md)$", nav, re.MULTILINE)
    pages = {str(path.relative_to(ROOT / "docs")) for path in (ROOT / "docs").rglob("*.md")}
    assert len(listed) == len(set(listed))
    assert set(listed) == pages, "add the page to nav in mkdocs.yml"


EXAMPLES = {
    "01_refine_synthetic": r"after: position error 0\.0\d\d m",
    "02_align_to_plan": r"sure: True.*hypothesis 1: .*hypothesis 2: ",
    "03_read_plans": r"plan\.dxf: .*plan\.json: .*plan\.npy: .*plan\.png: .*looks towards",
    "04_options": r"before: .*after, default: .*after, without walls: ",
    "05_evaluate_poses": r"position error.*NSD.*MME.*check wall points",
    "06_own_term": r"with the term: heights 0\.00\d",
    "07_pose_graph": r"2500 poses, 4949 measurements\ncost 1\.39\d+e\+07 before, 7252\.\d+ after",
    "08_from_arrays": r"error on the plan: 0\.0\d\d m RMS\nof the surveyed frames: 0\.00\d m",
}
"""What the output of each example must hold."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "example", sorted((ROOT / "examples").glob("*.py")), ids=lambda path: path.stem
)
def test_examples_run(example: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # In this process: seven interpreters would take longer to import planfit than to run the examples.
    runpy.run_path(str(example), run_name="__main__")
    shown = capsys.readouterr()
    assert shown.err == ""
    assert re.search(EXAMPLES[example.stem], shown.out, re.DOTALL), shown.out


@pytest.mark.slow
def test_the_notebook_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    cells = json.loads((ROOT / "examples" / "first_scan.ipynb").read_text("utf-8"))["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for cell in code:
        exec(compile(cell, "first_scan.ipynb", "exec"), names)
    before, after = re.findall(r"(?:before|after) (0\.\d+) m", capsys.readouterr().out)
    assert float(after) < 0.2 * float(before)
    assert (tmp_path / "refined" / "report.html").is_file()
    # No outputs and no counts: a notebook that was run shows changes where nobody made any.
    assert all(not c.get("outputs") and c.get("execution_count") is None for c in cells)


def test_examples_are_numbered_and_short() -> None:
    examples = sorted((ROOT / "examples").glob("*.py"))
    numbers = [int(path.name[:2]) for path in examples]
    assert numbers == list(range(1, len(examples) + 1))
    assert max(len(path.read_text().splitlines()) for path in examples) < 60


def test_readme_example_has_at_most_eight_lines() -> None:
    code = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)[0]
    assert len([line for line in code.splitlines() if line.strip()]) <= 8
    compile(code, "README.md", "exec")
    for name in re.findall(r"planfit\.(\w+)", code):
        assert hasattr(planfit, name)


def test_the_options_that_one_may_need_first_are_options_of_refine() -> None:
    page = (ROOT / "docs" / "getting-started.md").read_text()
    section = page.split("## Ten options one may need first")[1].split("\n## ")[0]
    rows = [line.split("|")[1] for line in section.splitlines() if line.startswith("| `--")]
    assert len(rows) == 10
    known = {flag.name for flag in group_of(RefineArguments).all_flags()}
    assert {name for row in rows for name in re.findall(r"--[a-z-]+", row)} <= known


def test_changelog_knows_the_version() -> None:
    top = re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert top is not None
    assert top[1] == planfit.__version__


def test_citation_knows_the_version() -> None:
    told = re.search(r"^version: (\S+)", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    assert told is not None
    assert told[1] == planfit.__version__


def test_targets_of_make_are_told_of_in_the_pages() -> None:
    makefile = (ROOT / "Makefile").read_text()
    targets = " ".join(re.findall(r"^\.PHONY: (.*)$", makefile, re.MULTILINE)).split()
    assert all(re.search(rf"^{target}:", makefile, re.MULTILINE) for target in targets)
    told = "\n".join(page.read_text() for page in PAGES)
    for target in set(targets) - {"clean", "format"}:
        assert f"make {target}" in told, target
