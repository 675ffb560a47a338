"""Mistakes on the command line: each is one line in plain words, of one form, for every command."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
import tyro

from command_flags import Flag, group_of
from planfit.cli import run
from planfit.cli.commands import COMMANDS, COMMANDS_BY_NAME, overview
from planfit.cli.parser import parse
from planfit.errors import OptionError

ENOUGH = {
    "refine": ["refine", "SCAN", "-o", "OUT"],
    "view": ["view", "FOLDER"],
    "batch": ["batch", "JOBS", "-o", "OUT"],
    "align": ["align", "SCAN", "PLAN", "-o", "OUT"],
    "calibrate": ["calibrate", "SCAN", "-o", "OUT"],
    "inspect": ["inspect", "SCAN"],
    "plan": ["plan", "PLAN"],
    "evaluate": ["evaluate", "FOLDER"],
    "compare": ["compare", "A", "B"],
    "export": ["export", "SOURCE", "--to", "tum", "-o", "OUT"],
    "demo": ["demo"],
    "synth": ["synth", "OUT"],
    "doctor": ["doctor"],
    "completion": ["completion", "bash"],
}
"""Words that parse, for each command."""
HEAVY = [command.name for command in COMMANDS if not command.is_light]


def test_every_command_is_here() -> None:
    assert list(ENOUGH) == [command.name for command in COMMANDS]


def refusal(words: Sequence[str], capsys: pytest.CaptureFixture[str]) -> str:
    """The line that refuses words."""
    assert run(words) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    (line,) = shown.err.splitlines()
    assert line.startswith("planfit: ")
    return line


@pytest.mark.parametrize(
    ("words", "facts"),
    [
        ("refine", ["refine", "-o"]),
        ("refine -o OUT", ["refine", "no SCAN"]),
        ("refine SCAN -o", ["-o: expected a path", "nothing"]),
        ("refine SCAN -o OUT --plan --overwrite", ["--plan: expected [NUMBER=]FILE", "nothing"]),
        ("refine SCAN -o OUT --candidate two", ["--candidate: expected a whole number", "'two'"]),
        ("refine SCAN -o OUT --tag_size_m x", ["--tag-size-m: expected a number", "'x'"]),
        (
            "refine SCAN -o OUT --adjust.cost robusst",
            ["--adjust.cost: ", "robust, paper", "'robusst'", "did you mean 'robust'?"],
        ),
        ("refine SCAN -o OUT --survey-axes mop", ["--survey-axes", "did you mean 'map'?"]),
        (
            "refine SCAN -o OUT --overwrite=yes",
            ["--overwrite: ", "'yes'", "give --overwrite alone"],
        ),
        ("align SCAN", ["align: ", "no PLAN and no -o"]),
        ("align SCAN PLAN OUT", ["align: ", "no -o", "did you mean '-o OUT'?"]),
        ("align --pin 1,2,3=4,5 SCAN PLAN -o OUT", ["no SCAN and no PLAN", "put SCAN PLAN first"]),
        ("plan PLAN --mirror yes", ["plan: ", "'yes'", "--mirror takes no more words"]),
        ("plan PLAN --wal-mask x", ["--wal-mask: ", "did you mean '--wall-mask'?", "--help-all"]),
        ("plan PLAN --drop 1 x", ["--drop: ", "x'"]),
        ("align SCAN --plan PLAN -o OUT", ["--plan: ", "SCAN PLAN -o OUT", "leave --plan out"]),
        ("plan PLAN --unit metre", ["--unit: ", "auto, m, cm", "'metre'", "--help-all"]),
        ("compare A B C", ["compare: ", "'C'", "did you mean '-o C'?"]),
        (
            "synth OUT --building.room-size-m 3",
            ["--building.room-size-m: expected 2 values", "'3'", "3.2 4.8"],
        ),
        ("synth OUT depth-noise:none", ["depth-noise:none: ", "'depth-noise:no-depth-noise'?"]),
        ("synth OUT depth-noise:no-depth-noise --seed 3", ["--seed: ", "before that word"]),
        (
            "synth OUT depth-noise:no-depth-noise --depth-noise.sigma-m 3",
            ["--depth-noise.sigma-m: ", "depth-noise:time-of-flight-noise"],
        ),
        ("evaluate FOLDER TRUTH", ["evaluate: ", "'TRUTH'", "planfit evaluate --help"]),
        ("demo OUT", ["demo: ", "'OUT'", "did you mean '-o OUT'?"]),
        ("doctor --json=yes", ["--json: ", "'yes'", "give --json alone"]),
        ("doctor --folder --json", ["doctor: ", "--folder", "expected one argument"]),
        ("completion ksh", ["completion: ", "bash, zsh or fish", "did you mean 'zsh'?"]),
        ("refin SCAN", ["refin: ", "did you mean 'refine'?"]),
        ("--plan PLAN refine", ["--plan: ", "write the command first"]),
        ("plan PLAN --verbose=1", ["--verbose: ", "'1'", "give --verbose alone"]),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_is_said(words: str, facts: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    line = refusal(words.split(), capsys)
    for fact in facts:
        assert fact in line


@pytest.mark.parametrize("name", ENOUGH)
def test_common_mistakes_of_every_command(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = ENOUGH[name]
    if name not in ("refine", "compare"):  # of which one takes more, and one fewer
        assert "more" in refusal([*words, "more"], capsys)
    if len(words) > 1:
        assert f"{name}: expected " in refusal([name], capsys)
    if name in HEAVY:
        said = refusal([*words, "--workrs", "2"], capsys)
        assert "did you mean '--workers'?" in said or name in ("plan", "synth")
    for flag in ["-o"] if "-o" in words else []:
        without = [word for word in words if word not in (flag, "OUT")]
        assert f"no {flag}" in refusal(without, capsys)
        assert f"{flag}: expected a path" in refusal([*without, flag], capsys)


def test_a_path_with_blanks_is_to_be_quoted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("my flat.png").touch()
    said = refusal(["plan", "my", "flat.png"], capsys)
    assert said.endswith("write a path that has blanks in quotes: 'my flat.png'")


def mistakes(flag: Flag) -> Iterator[list[str]]:
    """Words that cannot be right for a flag."""
    if flag.type is bool:
        yield [f"{flag.name}=yes"]
        return
    if "..." not in str(flag.type) and not flag.is_repeated:
        yield [flag.name]
    if isinstance(flag.default, int | float):
        yield [flag.name, "nonsense"]


@pytest.mark.parametrize("name", ["plan", "export", "batch"])
def test_every_flag_has_its_mistakes_told(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    n = 0
    for flag in group_of(COMMANDS_BY_NAME[name].load()[0]).all_flags():
        of_choice = "depth_noise" in flag.path  # which are options behind a word
        for mistake in [] if flag.is_positional or of_choice else mistakes(flag):
            words = [*ENOUGH[name][1:], *mistake]
            assert run([name, *words]) == 2
            line = capsys.readouterr().err
            assert re.fullmatch(f"planfit: {flag.name}: expected .*, found .*; .*\n", line)
            n += 1
    assert n > 3


def test_without_the_reasons_of_the_parser_its_words_are_repeated(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delattr(tyro, "_errors")
    kind = COMMANDS_BY_NAME["plan"].load()[0]
    with pytest.raises(OptionError, match=r"^plan: expected .*metre.*--unit") as refused:
        parse(kind, "planfit plan", ["PLAN", "--unit", "metre"])
    assert "│" not in str(refused.value)


def test_help_is_at_most_80_columns_wide() -> None:
    texts = [overview(), *(command.help_path.read_text("utf-8") for command in COMMANDS)]
    assert max(len(line) for text in texts for line in text.splitlines()) <= 80
