"""The pages written from the options are as they would be written, and true of the real parsers."""

import dataclasses
import re
from enum import Enum
from operator import attrgetter
from typing import Any

import pytest

import reference
from flags import Flag, group_of
from planfit import cli

COMMANDS = reference.command_types()


@pytest.mark.parametrize("name", sorted(reference.PAGES))
def test_committed_page_is_as_it_would_be_written(name: str) -> None:
    assert (reference.DOCS / name).read_text() == reference.PAGES[name](), (
        f"docs/{name} is not up to date; run: python docs/reference.py"
    )


def test_every_command_of_the_help_is_in_the_reference() -> None:
    told = [line.split()[0] for line in cli.HELP.splitlines() if line.startswith("  ")]
    assert told == list(dict.fromkeys(name.split()[0] for name in COMMANDS))


@pytest.mark.parametrize("name", COMMANDS)
def test_every_flag_has_a_sentence(name: str) -> None:
    for flag in group_of(COMMANDS[name]).all_flags():
        assert flag.words.endswith("."), f"{flag.name} of {name} has no docstring"


@pytest.mark.parametrize("name", COMMANDS)
def test_parser_takes_every_flag_and_has_the_defaults_told(name: str) -> None:
    group = group_of(COMMANDS[name])
    needed, given, expected = [], [], {}
    for flag in group.all_flags():
        if flag.is_positional:
            needed.append(flag.path[-1])
        elif flag.default is dataclasses.MISSING:
            choice = reference.takes(flag.type).strip("{}").split(",")[0]
            needed += [(flag.aliases or (flag.name,))[0], choice]
        elif _words(flag) and "depth_noise" not in flag.path:  # behind its word; tested below
            given += _words(flag)
            expected[".".join(flag.path)] = flag.default
    plain = cli._parse(COMMANDS[name], name, needed)
    full = cli._parse(COMMANDS[name], name, [*needed, *given])
    assert full == plain
    assert {path: attrgetter(path)(full) for path in expected} == expected


@pytest.mark.parametrize("name", COMMANDS)
def test_help_lists_no_flag_that_the_reference_lacks(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "300")
    with pytest.raises(SystemExit):
        cli.run([*name.split(), "--help"])
    listed = set()
    for line in capsys.readouterr().out.splitlines():
        words = [word.rstrip(".,;") for word in line.strip("│ ").split()]
        if words and words[0].startswith("-"):
            listed |= {word for word in words if re.fullmatch(r"--?[a-z][\w.-]*", word)}
    assert listed - {"-h", "--help"} - reference.all_flags(name) == set()
    assert listed


def test_union_of_kinds_is_chosen_by_the_words_told() -> None:
    group = group_of(COMMANDS["synth"])
    (choices,) = [g for one in group.groups for g in one.groups if g.choices]
    for word, inner in choices.choices:
        given = [part for flag in inner.flags for part in _words(flag)]
        parsed = cli._parse(COMMANDS["synth"], "synth", ["out", word, *given])
        assert parsed.options.depth_noise == inner.type()


def test_option_that_a_preset_changes_says_so() -> None:
    page = reference.options_page()
    line = next(one for one in page.splitlines() if "`--align.method`" in one)
    assert "Default: `search`; `paper`: `paper`." in line


def _words(flag: Flag) -> list[str]:
    """A flag with its default; nothing where the default cannot be said."""
    value: Any = flag.default
    if value is None:
        return []
    if flag.type is bool:
        own = flag.path[-1].replace("_", "-")
        return [f"--{flag.prefix}{'' if value else 'no-'}{own}"]
    if isinstance(value, tuple):
        return [flag.name, *(str(one) for one in value)]
    return [flag.name, value.name if isinstance(value, Enum) else str(value)]
