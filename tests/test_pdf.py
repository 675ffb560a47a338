"""The report as PDF: printed by Chromium where there is one, else said so in a line."""

import re
import subprocess
from importlib import resources

import pytest

from browser_probe import BROWSER
from planfit.cli.main import run as planfit_run
from planfit.errors import OutputError
from planfit.export import pdf
from planfit.export.pdf import print_page

PAGE = (
    "<!DOCTYPE html><html><head><meta charset=utf-8><title>t</title></head>"
    "<body><h1>Walls of the plan</h1></body></html>"
)


@pytest.fixture
def run(tmp_path):
    """A folder as far as its report is asked for."""
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "report.html").write_text(PAGE)
    return tmp_path / "run"


@pytest.mark.skipif(BROWSER is None, reason="no Chromium to print with")
def test_the_report_is_printed(run, tmp_path, capsys):
    pypdfium2 = pytest.importorskip("pypdfium2")
    target = tmp_path / "with space" / "report.pdf"
    assert planfit_run(["export", str(run), "--to", "pdf", "-o", str(target)]) == 0
    assert "written" in capsys.readouterr().out
    document = pypdfium2.PdfDocument(target)
    text = "".join(page.get_textpage().get_text_bounded() for page in document)
    assert text.strip() == "Walls of the plan"  # and neither its address nor the date
    assert [path.name for path in target.parent.iterdir()] == ["report.pdf"]


@pytest.mark.skipif(BROWSER is None, reason="no Chromium to print with")
def test_tables_stay_whole_and_long_ones_keep_their_head(tmp_path):
    pypdfium2 = pytest.importorskip("pypdfium2")

    def table(name, n_rows):
        rows = "".join(
            f'<tr class="as-built-new"><td>{name}{k:03d}</td><td>x</td></tr>' for k in range(n_rows)
        )
        return (
            f'<h2>Of {name}</h2><p>Some words.</p><div class="walls"><table><thead><tr><th>Head{name}</th>'
            f"<th>y</th></tr></thead><tbody>{rows}</tbody></table></div>"
        )

    style = resources.files("planfit.report.html").joinpath("style.css").read_text("utf-8")
    body = f'<div style="height: 180mm">full</div>{table("short", 20)}{table("long", 120)}'
    page = tmp_path / "page.html"
    page.write_text(f"<!DOCTYPE html><meta charset=utf-8><style>{style}</style><body>{body}</body>")
    print_page(page, tmp_path / "page.pdf")
    document = pypdfium2.PdfDocument(tmp_path / "page.pdf")
    texts = [sheet.get_textpage().get_text_bounded() for sheet in document]
    (whole,) = (text for text in texts if "short000" in text)
    assert "short019" in whole
    assert "Of short" in whole
    parts = [text for text in texts if re.search(r"long\d", text)]
    assert len(parts) > 1
    assert all("Headlong" in text for text in parts)


def test_a_machine_without_chromium_is_told_so(run, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("PATH", str(tmp_path))
    target = tmp_path / "report.pdf"
    assert planfit_run(["export", str(run), "--to", "pdf", "-o", str(target)]) != 0
    said = " ".join(capsys.readouterr().err.split())
    assert "PDF: expected Chromium on PATH (chromium, chromium-browser" in said
    assert "print it there" in said
    assert not target.exists()


@pytest.mark.parametrize(
    ("name", "words"),
    [("report.ps", "expected a file of .pdf, found .ps"), ("report.pdf", "with its report.html")],
)
def test_other_names_and_folders_without_a_report_are_refused(tmp_path, capsys, name, words):
    (tmp_path / "empty").mkdir()
    arguments = ["export", str(tmp_path / "empty"), "--to", "pdf", "-o", str(tmp_path / name)]
    assert planfit_run(arguments) != 0
    assert words in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / name).exists()


def browser_that(folder, does):
    path = folder / "chromium"
    path.write_text(f"#!/bin/sh\n{does}\n")
    path.chmod(0o755)
    return str(path)


@pytest.mark.parametrize(
    ("does", "words"),
    [
        ("echo first >&2; echo no display >&2; exit 3", r"'no display' \(exit code 3\)"),
        ("exit 0", r"'nothing' \(exit code 0\)"),
        (
            'for a; do case $a in --print-to-pdf=*) printf "%%PDF-1.4 cut" > "${a#*=}";; esac; done',
            "exit code 0",
        ),
        ("exec sleep 30", "within 1 s"),
    ],
)
def test_a_browser_that_does_not_print_is_told(run, tmp_path, monkeypatch, does, words):
    monkeypatch.setattr(pdf, "find_browser", lambda: browser_that(tmp_path, does))
    monkeypatch.setattr(pdf, "MAX_PRINT_S", 1.0)
    with pytest.raises(OutputError, match=words):
        print_page(run / "report.html", tmp_path / "report.pdf")


def test_a_program_that_cannot_be_started_is_told(run, tmp_path, monkeypatch):
    def refused(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(subprocess, "run", refused)
    monkeypatch.setattr(pdf, "find_browser", lambda: "/bin/chromium")
    with pytest.raises(OutputError, match=r"/bin/chromium: expected a program that prints"):
        print_page(run / "report.html", tmp_path / "report.pdf")
