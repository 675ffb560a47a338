"""Mistakes on the command line: each is one line in plain words, of one form, for every command."""

import re
from collections.abc import Iterator, Sequence
from enum import Enum
from pathlib import Path

import pytest

from planfit.cli import run
from planfit.cli.commands import COMMANDS, overview
from planfit.cli.flag_values import word_counts
from planfit.cli.flags import Flag, Group, group_of
from planfit.cli.usage import wrong_words

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
    """The line that refuses words; its form is that of all errors."""
    assert run(words) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    (line,) = shown.err.splitlines()
    assert re.fullmatch(r"planfit: .+: expected .+, found .+; .+", line)
    return line


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            "refine",
            "refine: expected SCAN -o OUT, found no SCAN and no -o; 'planfit refine --help' tells more",
        ),
        (
            "refine -o OUT",
            "refine: expected SCAN -o OUT, found no SCAN; 'planfit refine --help' tells more",
        ),
        (
            "refine SCAN -o",
            "-o: expected a path behind it, found nothing; 'planfit refine --help-all' tells more",
        ),
        (
            "refine SCAN -o OUT --plan --overwrite",
            "--plan: expected [NUMBER=]FILE behind it, found the option --overwrite; "
            "'planfit refine --help-all' tells more",
        ),
        (
            "refine SCAN -o OUT --candidate two",
            "--candidate: expected a whole number, found 'two'; write it as --candidate 1",
        ),
        (
            "refine SCAN -o OUT --adjust.points.loss.kind cauchi",
            "--adjust.points.loss.kind: expected one of squared, huber, cauchy, geman_mcclure, norm, "
            "found 'cauchi'; did you mean 'cauchy'?",
        ),
        (
            "refine SCAN -o OUT --overwrite=yes",
            "--overwrite: expected no value behind it, found 'yes'; give --overwrite alone",
        ),
        (
            "align SCAN",
            "align: expected SCAN PLAN -o OUT, found no PLAN and no -o; 'planfit align --help' tells more",
        ),
        (
            "align SCAN PLAN OUT",
            "align: expected SCAN PLAN -o OUT, found 'OUT' besides; did you mean '-o OUT'?",
        ),
        (
            "align --pin 1,2,3=4,5 SCAN PLAN -o OUT",
            "align: expected SCAN PLAN -o OUT, found no SCAN and no PLAN; --pin took '1,2,3=4,5 SCAN PLAN'; "
            "put SCAN PLAN before it",
        ),
        ("plan PLAN --mirror yes", "plan: expected PLAN, found 'yes' besides; --mirror takes no value"),
        (
            "plan PLAN --wal-mask x",
            "--wal-mask: expected an option of 'planfit plan', found an unknown one; did you mean "
            "'--wall-mask'? 'planfit plan --help-all' lists every one",
        ),
        (
            "align SCAN --plan PLAN -o OUT",
            "--plan: expected 'planfit align SCAN PLAN -o OUT', found an option in place of a word; leave "
            "--plan out",
        ),
        (
            "plan PLAN --unit metre",
            "--unit: expected one of auto, m, cm, mm, in, ft, unknown, found 'metre'; "
            "'planfit plan --help-all' tells what they mean",
        ),
        (
            "compare A B C",
            "compare: expected A [B], found 'C' besides; did you mean '-o C'?",
        ),
        (
            "synth OUT --building.room-size-m 3",
            "--building.room-size-m: expected 2 values behind it, a number each, found 1; write it as "
            "--building.room-size-m 3.2 4.8",
        ),
        (
            "synth OUT depth-noise:none",
            "depth-noise:none: expected one of depth-noise:no-depth-noise, "
            "depth-noise:structured-light-noise, depth-noise:time-of-flight-noise, found none of them; "
            "did you mean 'depth-noise:no-depth-noise'?",
        ),
        (
            "synth OUT depth-noise:no-depth-noise --seed 3",
            "--seed: expected it before depth-noise:no-depth-noise, behind which only that one's own options "
            "stand, found it behind; put it first",
        ),
        (
            "synth OUT depth-noise:no-depth-noise --depth-noise.sigma-m 3",
            "--depth-noise.sigma-m: expected it behind depth-noise:",
        ),
        (
            "evaluate FOLDER TRUTH",
            "evaluate: expected FOLDER, found 'TRUTH' besides; 'planfit evaluate --help' tells more",
        ),
        ("demo OUT", "demo: expected options alone, found 'OUT' besides; did you mean '-o OUT'?"),
        (
            "doctor --json=yes",
            "--json: expected no value behind it, found 'yes'; give --json alone",
        ),
        (
            "doctor --folder --json",
            "--folder: expected a folder behind it, found --json; write it as --folder DIR",
        ),
        (
            "completion ksh",
            "completion: expected bash, zsh or fish, found ksh; did you mean 'zsh'?",
        ),
        (
            "refin SCAN",
            "refin: expected a command of planfit, found none of this name; did you mean 'refine'?",
        ),
        (
            "--plan PLAN refine",
            "--plan: expected a command of planfit, found none of this name; write the command first, as in "
            "'planfit refine SCAN -o OUT'",
        ),
        (
            "plan PLAN --verbose=1",
            "--verbose: expected no value behind it, found '1'; give --verbose alone",
        ),
    ],
    ids=lambda value: value if isinstance(value, str) and ": expected" not in value else "",
)  # fmt: skip
def test_what_is_said(words: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert refusal(words.split(), capsys).startswith(f"planfit: {said}")


@pytest.mark.parametrize("name", ENOUGH)
def test_common_mistakes_of_every_command(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = ENOUGH[name]
    if name not in ("refine", "compare"):  # of which one takes more, and one fewer
        assert "found 'more' besides" in refusal([*words, "more"], capsys) or name == "completion"
    if len(words) > 1:
        assert refusal([name], capsys).startswith(f"planfit: {name}: expected ")
    if name in HEAVY:
        said = refusal([*words, "--workrs", "2"], capsys)
        assert "did you mean '--workers'?" in said or name in ("plan", "synth")
    for flag in ["-o"] if "-o" in words else []:
        without = [word for word in words if word not in (flag, "OUT")]
        assert f"found no {flag};" in refusal(without, capsys)
        assert "behind it, found nothing;" in refusal([*without, flag], capsys)


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
    if word_counts(flag)[0] > 0:
        yield [flag.name]
        yield [flag.name, "--workers", "1"]
    is_free = "str" in str(flag.type) or "Path" in str(flag.type)
    if not is_free or isinstance(flag.default, Enum):
        yield [flag.name, "nonsense"]


@pytest.mark.parametrize("name", HEAVY)
def test_every_flag_of_every_command_has_its_mistakes_told(name: str) -> None:
    command = next(command for command in COMMANDS if command.name == name)
    group: Group = group_of(command.load()[0])
    n = 0
    for flag in group.all_flags():
        if flag.is_positional:
            continue
        for words in mistakes(flag):
            error = str(wrong_words(f"planfit {name}", group, [*ENOUGH[name][1:], *words], ""))
            assert error.startswith(f"{flag.name}: expected "), (words, error)
            assert ", found " in error, error
            assert "; " in error, error
            n += 1
    assert n > 5


def test_what_is_not_known_is_told_in_the_words_of_the_parser() -> None:
    box = "╭─ Title ─╮\n│ Two of a kind. │\n│ ───── │\n│ For full helptext, run x │\n╰────╯"
    error = wrong_words("benchmark", None, ["x"], box)
    assert str(error) == (
        "benchmark: expected other words, found these: Two of a kind.; see 'benchmark --help'"
    )


def test_help_is_at_most_80_columns_wide() -> None:
    texts = [overview(), *(command.help_path.read_text("utf-8") for command in COMMANDS)]
    assert max(len(line) for text in texts for line in text.splitlines()) <= 80
