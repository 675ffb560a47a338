"""`planfit help TOPIC`: the pages of the documentation in a terminal, which wheels carry."""

import sys
import textwrap
from pathlib import Path

from planfit.cli.commands import COMMANDS_BY_NAME, WIDTH, overview
from planfit.errors import OptionError, did_you_mean

_FOLDERS = (Path(__file__).parents[1] / "pages", Path(__file__).parents[3] / "docs")
"""Of a wheel (hatch_build.py), and of the sources."""


def topics() -> dict[str, Path]:
    """The pages by what `planfit help` calls them."""
    folder = next((each for each in _FOLDERS if each.is_dir()), _FOLDERS[0])
    return {path.stem: path for path in sorted(folder.glob("*.md"))}


def show_help(words: list[str]) -> None:
    """Print the overview and the topics, or the page of a topic, or the help of a command.

    Raises:
        OptionError: there is no such topic.
    """
    known = topics()
    if not words:
        listed = textwrap.wrap(", ".join(known), WIDTH - 1, break_on_hyphens=False)
        print("\n".join([overview(), "topics of 'planfit help TOPIC':", *listed]))
        return
    name = " ".join(words)
    path = COMMANDS_BY_NAME[name].help_path if name in COMMANDS_BY_NAME else known.get(name)
    if path is None:
        step = did_you_mean(name, [*known, *COMMANDS_BY_NAME]) or "'planfit help' lists all"
        raise OptionError(f"help: expected a topic or a command, found {name!r}; {step}")
    text = path.read_text(encoding="utf-8")
    if sys.stdout.isatty():
        import pydoc  # takes longer than all else here

        pydoc.pager(text)
    else:
        print(text, end="")
