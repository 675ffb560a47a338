"""The pages written from the options are as they would be written, and true of the real parsers."""

import dataclasses
import re
import typing
from operator import attrgetter
from typing import Any

import pytest

import reference
from command_flags import Flag, group_of
from planfit.cli import run
from planfit.cli.commands import COMMANDS, Command, overview

TYPES = reference.command_types()


@pytest.mark.parametrize("name", sorted(reference.PAGES))
def test_committed_page_is_as_it_would_be_written(name: str) -> None:
    assert (reference.DOCS / name).read_text() == reference.PAGES[name](), (
        f"docs/{name} is not up to date; run: python docs/reference.py"
    )


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.name)
def test_help_is_short_and_as_it_would_be_written(
    command: Command, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run([command.name, "--help"]) == run([command.name, "anything", "-h"]) == 0
    text = command.help_path.read_text()
    assert capsys.readouterr().out == 2 * text
    assert text == reference.help_text(command), "not up to date; run: python docs/reference.py"
    lines = text.splitlines()
    assert len(lines) <= 45
    assert max(len(line) for line in lines) < 80


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.name)
def test_short_help_shows_flags_that_the_parser_has_with_their_defaults(command: Command) -> None:
    flags = {flag.name: flag for flag in group_of(TYPES[command.name]).all_flags()}
    text = command.help_path.read_text()
    entries = re.split(r"^  (?=\S)", text, flags=re.MULTILINE)[1:]
    shown = {}
    for entry in entries:
        words = re.findall(r"--[a-z][\w.-]*|^[A-Z]+", entry.split("\n")[0])
        name = next((word for word in words if word in flags), None)  # after its aliases
        assert name is not None, entry
        shown[name] = " ".join(entry.split("\n\n")[0].split())
    needed = {name for name, flag in flags.items() if flag.default is dataclasses.MISSING}
    assert set(shown) == needed | {f"--{name}" for name in command.flags}
    for name in needed:
        assert name in text.split("\n")[0] or (flags[name].aliases or ("--",))[0] in command.usage
    for name, entry in shown.items():
        told = re.search(r"\[([^\[]*)\]$", entry)
        usual = flags[name].default
        if told and not flags[name].is_computed and usual is not True:
            assert told[1] == str(usual), entry
        else:
            assert flags[name].is_computed or usual in (None, (), "", False, True) or name in needed


def test_refine_shows_ten_flags() -> None:
    (refine,) = [command for command in COMMANDS if command.name == "refine"]
    assert len(refine.flags) == 10


def test_help_all_is_named_where_flags_are_left_out() -> None:
    for command in COMMANDS:
        n_flags = len(list(group_of(TYPES[command.name]).all_flags()))
        text = command.help_path.read_text()
        entries = re.findall(r"^  \S", text, flags=re.MULTILINE)
        assert (n_flags == len(entries)) == ("--help-all" not in text)


def test_every_command_of_the_help_is_in_the_reference() -> None:
    told = re.findall(r"^  (\w+)", overview(), re.MULTILINE)
    assert told == list(TYPES)


@pytest.mark.parametrize("name", TYPES)
def test_every_flag_has_a_sentence(name: str) -> None:
    for flag in group_of(TYPES[name]).all_flags():
        assert flag.words.endswith("."), f"{flag.name} of {name} has no docstring"


@pytest.mark.parametrize("name", TYPES)
def test_parser_takes_every_flag_and_has_the_defaults_told(name: str) -> None:
    group = group_of(TYPES[name])
    needed, given, expected = [], [], {}
    for flag in group.all_flags():
        if flag.is_positional:
            choices = [one for one in typing.get_args(flag.type) if isinstance(one, str)]
            needed.append(choices[0] if choices else flag.path[-1])
        elif flag.default is dataclasses.MISSING:
            choice = reference.takes(flag.type).strip("{}").split(",")[0]
            needed += [(flag.aliases or (flag.name,))[0], choice]
        elif _words(flag) and "depth_noise" not in flag.path:  # behind its word; tested below
            given += _words(flag)
            expected[".".join(flag.path)] = flag.default
    plain = reference.parsed(name, needed)
    full = reference.parsed(name, [*needed, *given])
    assert full == plain
    assert {path: attrgetter(path)(full) for path in expected} == expected


@pytest.mark.parametrize("name", TYPES)
def test_help_all_lists_no_flag_that_the_reference_lacks(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "300")
    assert run([name, "--help-all"]) == 0
    listed = set()
    for line in capsys.readouterr().out.splitlines():
        words = [word.rstrip(".,;") for word in line.strip("│ ").split()]
        if words and words[0].startswith("-"):
            listed |= {word for word in words if re.fullmatch(r"--?[a-z][\w.-]*", word)}
    assert listed - {"-h", "--help"} - set(reference.all_flags(name)) == set()
    assert listed or not reference.all_flags(name)


def test_union_of_kinds_is_chosen_by_the_words_told() -> None:
    group = group_of(TYPES["synth"])
    (choices,) = [g for one in group.groups for g in one.groups if g.choices]
    for word, inner in choices.choices:
        given = [part for flag in inner.flags for part in _words(flag)]
        parsed = reference.parsed("synth", ["out", word, *given])
        assert parsed.options.depth_noise == inner.type()


def test_option_that_a_preset_changes_says_so() -> None:
    page = reference.options_page()
    line = next(one for one in page.splitlines() if "`--align.method`" in one)
    assert "Default: `search`; `paper`: `paper`." in line


def _words(flag: Flag) -> list[str]:
    """A flag with its default; nothing where the default cannot be said."""
    value: Any = flag.default
    if value is None or not flag.is_paired:
        return []
    if flag.type is bool:
        own = flag.path[-1].replace("_", "-")
        return [f"--{flag.prefix}{'' if value else 'no-'}{own}"]
    if flag.is_repeated:
        return [word for one in value for word in (flag.name, str(one))]
    if isinstance(value, tuple):
        return [flag.name, *(str(one) for one in value)]
    return [flag.name, str(value)]
