"""Flags of the commands, from the lists that docs/reference.py writes: reading them from the options would
take seconds, which neither a misspelt word nor the Tab key may cost.
"""

import re
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from planfit.cli.gone_options import refuse_gone_flag
from planfit.cli.speech import NAMES
from planfit.errors import OptionError, did_you_mean

_HELP = ("-h", "--help", "--help-all")


@cache
def flags_of(command: str) -> dict[str, tuple[str, ...]]:
    """Every flag of a command, aliases and `--no-` forms too; behind each the words that it takes, if these
    are some that can be listed."""
    text = flags_path(command).read_text(encoding="utf-8")
    words = [line.split() for line in text.splitlines()]
    return {name: tuple(values) for name, *values in words}


def flags_path(command: str) -> Path:
    """The list of a command's flags: one a line, behind it the words that it takes."""
    return Path(__file__).parent / "help" / f"{command}.flags"


def looks_like_flag(word: str) -> bool:
    """Whether a word is meant as a flag: numbers below 0 are not."""
    return re.match(r"--?[A-Za-z]", word) is not None


def plain_name(word: str) -> str:
    """The name of a flag, without a value that is written to it, and as the lists have it."""
    return word.split("=", 1)[0].replace("_", "-")


def check_flags(command: str, words: Sequence[str], usage: str) -> None:
    """Raise `OptionError` at the first word that looks like a flag and is none, naming the nearest one; or
    the command's usage, where that has a word of this name.
    """
    known = flags_of(command)
    for word in words:
        name = plain_name(word)
        if (
            not looks_like_flag(word)
            or name in known
            or name in _HELP
            or name.startswith("--tyro-")
        ):
            continue
        if name.removeprefix("--").upper() in re.split(r"[ \[\]]+", usage):
            raise OptionError(
                f"{name}: expected 'planfit {command} {usage}', found an option in place of a word; "
                f"leave {name} out"
            )
        refuse_gone_flag(name)
        meant = did_you_mean(name, known)
        raise OptionError(
            f"{name}: expected an option of 'planfit {command}', found an unknown one; "
            f"{f'{meant} ' if meant else ''}'planfit {command} --help-all' lists every one"
        )


def completions(words: Sequence[str], commands: Sequence[str]) -> list[str]:
    """What may take the place of the last of the words behind `planfit`; nothing where a file may.

    Args:
        words: the words so far; the last is the one to complete, which may be empty.
        commands: all there are.
    """
    *before, last = words or [""]
    if not before:
        found = [*commands, "--help", "--version"]
    elif before[0] not in commands:
        found = []
    else:
        flags = flags_of(before[0])
        found = [*(flags.get(before[-1]) or ())]
        if not found and last.startswith("-"):
            found = [*flags, *_HELP, *NAMES]
    return sorted({word for word in found if word.startswith(last)})
