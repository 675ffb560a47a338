"""What messages name is there: topics of `planfit help`, options, commands."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import reference
from command_flags import group_of
from planfit.cli import run
from planfit.cli.commands import COMMANDS, COMMANDS_BY_NAME, topics
from planfit.cli.completion import completions
from planfit.cli.speech import NAMES

SOURCE = Path(__file__).parents[2] / "src" / "planfit"
OF_OTHERS = {
    # Chromium's, which prints the report; pip's; Slurm's; the parser's.
    "--headless", "--no-pdf-header-footer", "--print-to-pdf", "--disable-gpu", "--no-sandbox",
    "--user-data-dir", "--no-first-run", "--disable-background-networking", "--disable-extensions",
    "--force-reinstall", "--upgrade", "--array", "--tyro",
}  # fmt: skip


@cache
def messages() -> list[tuple[str, str]]:
    """Strings of the sources that are no docstrings, by module; what is filled in is {}."""
    found = []
    for path in sorted(SOURCE.rglob("*.py")):
        for words in _strings(ast.parse(path.read_text("utf-8"))):
            found.append((str(path.relative_to(SOURCE)), words))
    return found


def _strings(node: ast.AST) -> Iterator[str]:
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
        return
    if isinstance(node, ast.JoinedStr):
        parts = (v.value if isinstance(v, ast.Constant) else "{}" for v in node.values)
        yield "".join(map(str, parts))
    elif isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    for child in ast.iter_child_nodes(node):
        yield from _strings(child)


def test_topics_that_messages_name_are_there() -> None:
    named = {
        topic for _, words in messages() for topic in re.findall(r"planfit help ([a-z-]+)", words)
    }
    assert len(named) >= 4
    assert named <= set(topics())


def test_no_message_sends_to_a_file_that_an_installation_lacks() -> None:
    of_others = ("the app's docs/format.md",)  # of Stray Scanner
    for module, words in messages():
        if not words.startswith(of_others):
            assert not re.search(r"docs/\S*\.md", words), f"{module}: {words}"
    for command in COMMANDS:
        for flag in group_of(command.load()[0]).all_flags():
            assert "docs/" not in flag.words, f"{command.name} {flag.name}: {flag.words}"
            named = re.findall(r"planfit help ([a-z-]+)", flag.words)
            assert set(named) <= set(topics())


def test_options_that_messages_name_are_there() -> None:
    known = set().union(*(reference.all_flags(name) for name in reference.command_types()))
    known |= {*NAMES, "--help", "--help-all", "--version", *OF_OTHERS}
    groups = {flag.rpartition(".")[0] for flag in known if "." in flag}
    n = 0
    for module, words in messages():
        if re.search("var\\(--|</svg>", words):
            continue  # names of CSS
        for flag in re.findall(r"(?<![\w-])(--[a-z][a-z0-9_.-]*[a-z0-9])(?![\w{])", words):
            assert flag in known or flag in groups, f"{module}: {flag} in {words!r}"
            n += 1
    assert n > 100


def test_help_shows_a_page_and_the_help_of_a_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["help", "scan-formats"]) == 0
    assert capsys.readouterr().out == topics()["scan-formats"].read_text("utf-8")
    assert run(["help", "refine"]) == 0
    assert capsys.readouterr().out == COMMANDS_BY_NAME["refine"].help_path.read_text("utf-8")
    assert run(["help"]) == 0
    said = capsys.readouterr().out
    assert all(topic in said for topic in topics())
    assert run(["help", "scan-format"]) == 2
    assert "did you mean 'scan-formats'?" in capsys.readouterr().err
    assert completions(["help", "scan"]) == ["scan-formats"]
