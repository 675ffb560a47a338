"""Misspelt words, completion in three shells, and how much a command says: -q, -v, --log."""

import os
import re
import shutil
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

import planfit
import reference
from planfit.cli import run
from planfit.cli.commands import COMMANDS, COMMANDS_BY_NAME
from planfit.cli.completion import SCRIPTS, completions
from planfit.cli.speech import NAMES
from planfit.errors import did_you_mean

NAMES_OF_COMMANDS = [command.name for command in COMMANDS]


@pytest.mark.parametrize("name", NAMES_OF_COMMANDS)
def test_listed_flags_are_those_of_the_parser_and_leave_the_common_ones_free(name: str) -> None:
    known = COMMANDS_BY_NAME[name].known_flags()
    assert known == reference.all_flags(name), "run: python docs/reference.py"
    assert set(NAMES).isdisjoint(known)


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["refin", "scan"], "'refine'"),
        (["alignn"], "'align'"),
        (["refine", "scan", "-o", "out", "--plon", "x"], "'--plan'"),
        (["refine", "scan", "-o", "out", "--adjust.wals.weight=2"], "'--adjust.walls.weight'"),
        (["refine", "scan", "-o", "out", "--walls.weight", "2"], "'--adjust.walls.weight'"),
        (["plan", "x.dxf", "--mirrored"], "'--mirror'"),
        (["doctor", "--jsn"], "'--json'"),
        (["completion", "bsh"], "'bash'"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_misspelt_words_are_answered_with_what_was_meant(
    words: list[str], meant: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"did you mean {meant}?" in line


def test_words_like_nothing_known_get_no_advice() -> None:
    assert did_you_mean("--zzzz", COMMANDS_BY_NAME["refine"].known_flags()) == ""


def test_values_are_not_taken_for_flags(capsys: pytest.CaptureFixture[str]) -> None:
    # A value below 0, an underscore as tyro takes it, a flag with its value in one word.
    assert run(["synth", "/dev/null/x", "--seed", "-1", "--walk.n_frames=3"]) == 2
    assert "unknown" not in capsys.readouterr().err


def test_completions() -> None:
    assert completions(["ref"]) == ["refine"]
    assert set(NAMES_OF_COMMANDS) < set(completions([""]))
    assert completions(["refine", "--preset", ""]) == ["default", "paper"]
    assert completions(["export", "x", "--to", "k"]) == ["kitti"]
    assert "--adjust.walls.weight" in completions(["refine", "--adjust.w"])
    assert "--log" in completions(["plan", "--l"])
    assert completions(["synth", "out", "depth-noise:no"]) == ["depth-noise:no-depth-noise"]
    assert completions(["refine", "sca"]) == []  # a file, which the shell knows


_ASK = {
    "bash": "COMP_WORDS=({words}); COMP_CWORD={last}; _planfit; printf '%s\\n' \"${{COMPREPLY[@]}}\"",
    "zsh": (
        "compadd() {{ shift; print -l -- $@; }}; _files() {{ print files; }}; "
        "words=({words}); CURRENT={next}; _planfit"
    ),
    "fish": "complete -C '{line}'",
}
"""What asks each shell for completions, where nobody presses a key."""


def ask(shell: str, line: str, folder: Path) -> list[str]:
    program = folder / "planfit"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m planfit "$@"\n')
    program.chmod(0o755)
    words = line.split(" ")
    quoted = " ".join(f"'{word}'" for word in words)
    question = _ASK[shell].format(
        words=quoted, last=len(words) - 1, next=len(words), line=line
    )  # fmt: skip
    before = "compdef() { :; }\n" if shell == "zsh" else ""
    plain = {"bash": ["--norc"], "zsh": ["-f"], "fish": ["--no-config"]}[shell]
    done = subprocess.run(
        [shell, *plain, "-c", f"{before}{SCRIPTS[shell]}\n{question}"],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PATH": f"{folder}:{os.environ['PATH']}", "HOME": str(folder)},
    )
    return done.stdout.splitlines()


@pytest.mark.parametrize("shell", SCRIPTS)
def test_shells_complete(shell: str, tmp_path: Path) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed here")
    assert ask(shell, "planfit ref", tmp_path) == ["refine"]
    assert ask(shell, "planfit refine --preset ", tmp_path) == ["default", "paper"]
    assert "--adjust.walls.weight" in ask(shell, "planfit refine --adjust.w", tmp_path)
    if shell == "zsh":
        assert ask(shell, "planfit refine some", tmp_path) == ["files"]


@pytest.fixture
def plan_file(small_scan: Path) -> str:
    return str(small_scan / "floorplan.npy")


def test_quiet_says_nothing_but_errors(plan_file: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["plan", plan_file, "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")
    assert run(["-q", "plan", "nothing.npy"]) == 2
    shown = capsys.readouterr()
    assert (shown.out, len(shown.err.splitlines())) == ("", 1)
    assert run(["plan", plan_file]) == 0
    assert "faces" in capsys.readouterr().out  # the next command speaks again


@pytest.mark.parametrize("flag", [[], ["-v"]], ids=["", "-v"])
def test_warnings_of_libraries_are_for_those_who_ask(
    flag: list[str],
    plan_file: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def warn(*_: object) -> None:
        warnings.warn("overflow in a library", RuntimeWarning, stacklevel=1)

    monkeypatch.setattr("planfit.cli.plan.summarise", warn)
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        assert run(["plan", plan_file, *flag]) == 0
    assert ("overflow in a library" in capsys.readouterr().err) == bool(flag)


def test_verbose_tells_where_an_error_comes_from(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["plan", "nothing.npy", "-v"]) == 2
    assert "Traceback" in capsys.readouterr().err


def test_log_holds_all_that_is_said(
    plan_file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "planfit.log"
    assert run(["plan", plan_file, "--log", str(log)]) == 0
    said = capsys.readouterr().out
    assert run(["plan", "nothing.npy", f"--log={log}"]) == 2
    error = capsys.readouterr().err
    assert "Traceback" not in error
    text = log.read_text()
    assert f" planfit {planfit.__version__}: planfit plan {plan_file} --log {log}\n" in text
    for line in said.split("\n") + error.split("\n"):
        assert line.strip() in text
    assert text.count("ended after") == 2
    assert "Traceback" in text


def test_log_of_a_run_has_its_stages(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, words = tmp_path / "log", ["synth", str(tmp_path / "scan"), "--walk.n-frames", "2"]
    small = ["--camera.width-px", "32", "--camera.height-px", "24", "--building.n-rooms", "1"]
    assert run([*words, *small, "--log", str(log)]) == 0
    assert re.search(r"^\d\d:\d\d:\d\d render: \d+\.\d\d s$", log.read_text(), re.MULTILINE)
    shown = capsys.readouterr()
    assert "render: " not in shown.err
    assert run(["synth", str(tmp_path / "other"), *words[2:], *small, "-v"]) == 0
    assert "render: " in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["plan", "x", "--log"], "--log: expected a file behind it"),
        (["plan", "x", "-q", "-v"], "--quiet: expected it without --verbose"),
        (["plan", "x", "--log", "/"], "planfit: /: Is a directory"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_what_cannot_be_said_so_is_refused(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(words) == 2
    assert said in capsys.readouterr().err
