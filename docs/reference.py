"""Write the pages of docs/ that say what the code says, options, commands and formats of scans, and the texts
of `planfit COMMAND --help`.

`python docs/reference.py` writes them; a test fails where they are not as they would be written.
"""

import dataclasses
import inspect
import re
import textwrap
import types
import typing
from pathlib import Path
from typing import Any, Literal

from command_flags import Flag, Group, group_of, one_line, shortest_words
from planfit.cli.arguments import PlanFlags
from planfit.cli.commands import COMMANDS, EXIT_CODES, Command, KnownFlag
from planfit.cli.parser import parse
from planfit.cli.speech import FLAGS as EVERYWHERE_FLAGS
from planfit.evaluation import EvaluateOptions
from planfit.pipeline.options import PRESETS, RefineOptions
from planfit.scan import ScanOptions
from planfit.scan.formats import READERS, format_of
from planfit.synth import SynthOptions

DOCS = Path(__file__).parent
NOTE = (
    "<!-- Written by `python docs/reference.py`; change the docstrings of the options instead. -->"
)
COMPUTED = {"workers": "as many as the machine has processors"}
"""Defaults that are found when a command runs."""
WORDS = {int: "INT", float: "FLOAT", str: "STR", Path: "PATH"}

SHARED = {
    ScanOptions: "[how a scan is read](#reading-a-scan)",
    PlanFlags: "[how a plan is read](#reading-a-plan)",
    RefineOptions: "every [option](options.md)",
    EvaluateOptions: "[what is measured](#metrics-of-evaluate)",
    SynthOptions: "[the synthetic scan](#synthetic-scans)",
}
"""Groups of flags that several commands have, and where they are listed."""
SECTIONS: dict[str, tuple[str, type]] = {
    "Reading a scan": ("", ScanOptions),
    "Reading a plan": ("", PlanFlags),
    "Metrics of evaluate": ("", EvaluateOptions),
    "Synthetic scans": ("", SynthOptions),
}


def takes(hint: Any) -> str:
    """What is written behind a flag: `FLOAT`, `{a,b}`, `[STR ...]`."""
    if hint is bool:
        return ""
    if hint in WORDS:
        return WORDS[hint]
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if origin is typing.Literal:
        return "{" + ",".join(str(value) for value in inner) + "}"
    if origin is tuple and inner[-1] is Ellipsis:
        return f"[{takes(inner[0])} ...]"
    if origin is tuple:
        return " ".join(takes(one) for one in inner)
    if origin in (typing.Union, types.UnionType):
        # Readers of the page need not be told that nothing is a value: it is the default.
        return "|".join(takes(one) for one in inner if one is not type(None))
    raise TypeError(
        f"{hint}: expected a kind of value that the reference can name; add it to takes"
    )


def shown(value: Any) -> str:
    """A default, in words or as code."""
    if value is None or value in ((), ""):
        return "none"
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, tuple):
        return "`" + " ".join(f"{one}" for one in value) + "`"
    return f"`{value}`"


def item(flag: Flag, presets: dict[str, Any] | None = None) -> str:
    """One line of a list: the flag, what it means, its default, and what presets have in its place."""
    value = "" if flag.is_positional else flag.metavar or takes(flag.type)
    head = ", ".join(f"`{one}`" for one in flag.names) + (f" `{value}`" if value else "")
    if flag.default is dataclasses.MISSING:
        said = "" if flag.is_positional else "Must be given."
    elif flag.is_computed and flag.path[-1] in COMPUTED:
        said = f"Default: {COMPUTED[flag.path[-1]]}."
    else:
        said = f"Default: {shown(flag.default)}."
    for name, options in (presets or {}).items():
        other = options
        for step in flag.path:
            other = getattr(other, step)
        if other != flag.default:
            said = f"{said[:-1]}; `{name}`: {shown(other)}."
    return f"- {head}<br>{_escaped(flag.words)}{' ' if flag.words else ''}*{said}*" if said else (
        f"- {head}<br>{_escaped(flag.words)}"
    )  # fmt: skip


def _escaped(words: str) -> str:
    """Plain text as Markdown: what stands in backticks is left alone, names of pages become links."""
    parts = words.split("`")
    for i in range(0, len(parts), 2):
        parts[i] = re.sub(r"([*_])", r"\\\1", parts[i]).replace("<", "&lt;")
    return re.sub(r"`planfit help ([\w-]+)`", r"[`planfit help \1`](\1.md)", "`".join(parts))


def group_lines(group: Group, level: int, presets: dict[str, Any] | None = None) -> list[str]:
    """A group and those inside it, each under a heading of its own but the first."""
    lines = [item(flag, presets) for flag in group.flags]
    for inner in group.groups:
        words = inner.words or one_line(inner.type.__doc__ or "")
        if inner.choices:
            words = (
                f"{inner.words} One of these words, behind all other flags, and behind it its own flags; "
                f"without, `{inner.default_choice}`."
            ).strip()
        lines += ["", f"{'#' * level} {inner.prefix.removesuffix('.')}", ""]
        lines += [_escaped(words), ""]
        for word, choice in inner.choices:
            lines += [
                f"{'#' * (level + 1)} {word}",
                "",
                _escaped(one_line(choice.type.__doc__ or "")),
            ]
            lines += ["", *group_lines(choice, level + 2), ""]
        lines += group_lines(inner, min(level + 1, 5), presets)
    return lines


def tidy(lines: list[str]) -> str:
    """A page, never two empty lines in a row."""
    return re.sub(r"\n{3,}", "\n\n", "\n".join(lines)).rstrip() + "\n"


def options_page() -> str:
    """docs/options.md."""
    presets = {name: make() for name, make in PRESETS.items() if name != "default"}
    others = ", ".join(f"`{name}`" for name in presets)
    head = f"""{NOTE}

# Options

Everything that can be chosen about `planfit refine` and `planfit align`, with its default. The same names
work in three places:

    planfit refine SCAN -o OUT --adjust.walls.weight 2

as a flag, in a TOML file given with `--config` (`-` and `_` are alike; an unknown name is an error),

```toml
[adjust.walls]
weight = 2
```

and in Python, as dataclasses:

```python
from planfit import RefineOptions

options = RefineOptions().with_("adjust.walls.weight", 2)
```

A misspelt name is answered with the nearest, a value of another kind is refused where it is given.

Flags overrule the file, the file overrules `--preset`. Where the preset {others} has another value than the
default, it is said. `OUT/run.json` and the report hold the values of a run. Options of a term whose weight
is 0, or that is not chosen, do nothing.

What observations of each term are like (sigmas, robust losses, how many points count as one) is no option:
`planfit.adjust.terms.observation_models` has these numbers and where they come from.

## General
"""
    group = group_of(RefineOptions, RefineOptions())
    lines = [head, *group_lines(group, 2, presets)]
    return tidy(lines)


def command_types() -> dict[str, type]:
    """The dataclass of each command, in the order of `planfit --help`."""
    return {command.name: command.load()[0] for command in COMMANDS}


def parsed(name: str, words: list[str]) -> Any:
    """Arguments of a command, as the command line takes them.

    Raises:
        SystemExit: they do not parse; so `OptionError` of commands that parse their own words.
    """
    cls = command_types()[name]
    own = getattr(cls, "from_words", None)
    return own(words) if own else parse(cls, name, words)


def command_group(name: str) -> Group:
    """What a command takes; groups that several commands have are only named."""
    return group_of(command_types()[name], shared=tuple(SHARED))


def all_flags(name: str) -> dict[str, KnownFlag]:
    """Every flag of a command, with its aliases, shared groups included, and the words that choose one of
    several kinds."""
    found: dict[str, KnownFlag] = {}
    group = group_of(command_types()[name])
    for flag in group.all_flags():
        if not flag.is_positional:
            found |= dict.fromkeys(flag.names, _known(flag))
    return found | {word: KnownFlag("word") for word in group.all_choices()}


def _known(flag: Flag) -> KnownFlag:
    """What it takes."""
    if flag.type is bool:
        return KnownFlag("switch")
    if flag.type in (Path, Path | None):
        return KnownFlag("file")
    if flag.path[-1] == "preset":
        return KnownFlag("one", tuple(PRESETS))
    kind = "several" if flag.is_repeated else "one"
    kinds = (flag.type, *typing.get_args(flag.type))
    literals = [one for one in kinds if typing.get_origin(one) is Literal]
    return KnownFlag(kind, tuple(str(v) for one in literals for v in typing.get_args(one)))


def flags_text(name: str) -> str:
    """The list of a command's flags, for completion, batches and "did you mean"."""
    flags = sorted(all_flags(name).items())
    return "".join(f"{' '.join((one, flag.kind, *flag.choices))}\n" for one, flag in flags)


def _own(values: Any) -> str:
    """Where the defaults of a shared group are others in one command, which."""
    mine = group_of(type(values), values).all_flags()
    usual = group_of(type(values), type(values)()).all_flags()
    others = [
        f"`{one.name.removeprefix('--')}` {shown(one.default)}"
        for one, other in zip(mine, usual, strict=True)
        if one.default != other.default
    ]
    return f" (other defaults here: {', '.join(others)})" if others else ""


def commands_page() -> str:
    """docs/command-line.md."""
    lines = [
        NOTE, "", "# Command line", "",
        "`planfit --help` lists the commands, `planfit COMMAND --help` the flags of one that matter, "
        "`planfit COMMAND --help-all` every one, `planfit help TOPIC` shows a page of this "
        "documentation, `planfit --version` tells the version.", "",
        f"Exit codes: {EXIT_CODES}. Messages of bad input are one line on stderr: the file, what was "
        "expected, what was found, the next step.", "",
        "`--config` names a TOML file of [options](options.md); flags overrule it.", "",
        "Every command also takes:", "",
        *(f"- `{flag}`<br>{_escaped(words)}" for flag, words in EVERYWHERE_FLAGS.items()),
        "", "The Tab key completes commands, options and values: `eval \"$(planfit completion bash)\"` in "
        "`~/.bashrc`, the same with `zsh` in `~/.zshrc` (behind `compinit`), `planfit completion fish | "
        "source` in `~/.config/fish/config.fish`. A misspelt command or option is answered with the nearest.",
    ]  # fmt: skip
    for name, cls in command_types().items():
        group = command_group(name)
        lines += ["", f"## planfit {name}", "", one_line(cls.__doc__ or ""), ""]
        usage = " ".join(["planfit", name, *shortest_words(group.flags)])
        lines += [f"    {usage}", "", *group_lines(group, 3)]
        if group.shared:
            also = [
                SHARED[kind] + (f", each name behind `--{prefix}`" if prefix else "") + _own(values)
                for prefix, kind, values in group.shared
            ]
            lines += ["", f"Also: {'; '.join(also)}."]
    for title, (prefix, cls) in SECTIONS.items():
        users = [
            f"`{name}`"
            for name in command_types()
            if any(kind is cls for _, kind, _ in command_group(name).shared)
        ]
        group = group_of(cls, cls(), prefix)
        lines += ["", f"## {title}", "", f"Flags of {', '.join(users)}.", ""]
        lines += group_lines(group, 3)
    return tidy(lines)


def help_text(command: Command) -> str:
    """What `planfit COMMAND --help` prints: what must be given, and the flags that matter."""
    cls = command.load()[0]
    flags = {flag.name.removeprefix("--"): flag for flag in group_of(cls).all_flags()}
    unknown = set(command.flags) - set(flags)
    if unknown:
        raise ValueError(f"{command.name}: expected flags that it has, found {', '.join(unknown)}")
    needed = [f for f in flags.values() if f.default is dataclasses.MISSING]
    chosen = [flags[name] for name in command.flags]
    words = textwrap.wrap(one_line(cls.__doc__ or ""), 79)
    lines = [f"usage: planfit {command.name} {command.usage}", "", *words, ""]
    for flag in needed:
        lines += _help_entry(flag)
    lines += [""] if needed else []
    for flag in chosen:
        lines += _help_entry(flag)
    n_others = len(flags) - len({id(flag) for flag in (*needed, *chosen)})
    if n_others:
        lines += [
            "",
            f"{n_others} more: planfit {command.name} --help-all, or docs/command-line.md",
        ]
    return "\n".join(lines).strip() + "\n"


def _help_entry(flag: Flag) -> list[str]:
    """A flag, its sentence and its default, in two columns."""
    value = "" if flag.is_positional else flag.metavar or takes(flag.type)
    head = " ".join([", ".join([*flag.aliases, flag.name]), value]).strip()
    words = flag.words.replace("`", "")
    if flag.default is not dataclasses.MISSING and flag.type is not bool:
        usual = COMPUTED.get(flag.path[-1]) if flag.is_computed else shown(flag.default).strip("`")
        words += "" if usual == "none" else f" [{usual}]"
    elif flag.default is True:
        own = flag.path[-1].replace("_", "-")
        words += f" [on; --{flag.prefix}no-{own}]"
    text = textwrap.wrap(words, 79 - 24)
    if len(head) > 20:
        # Many choices take a second line.
        listed = head if len(head) < 78 else head.replace(",", ", ")
        heads = textwrap.wrap(listed, 77, subsequent_indent=" " * 6)
        return [*(f"  {line}" for line in heads), *(f"{'':24}{line}" for line in text)]
    return [f"  {head:<22}{text[0]}", *(f"{'':24}{line}" for line in text[1:])]


def scans_page() -> str:
    """docs/scan-formats.md: what each reader says of its format."""
    lines = [
        NOTE.replace("docstrings of the options", "readers' pages"), "", "# Scans", "",
        "A scan is a folder, a zip archive of one, a bag, a database, or a laser scanner's cloud. Of several "
        "scans in an archive one is named by its folder inside, `scans.zip/office`. The format is told by "
        "what lies in it; `--format` names one. `planfit inspect SCAN -o SCAN.png` tells what is found.", "",
        "All need colour, depth and a pose of each frame; facap and tum may be [depth alone]"
        "(depth-alone.md), and clouds need times and `--poses TRAJECTORY` instead. Frames that "
        "lack a pose are left out and named, those that lack an image follow the others. Poses of another "
        "tracker take the place of the scan's own with "
        "`--poses FILE` (TUM, KITTI, EuRoC, Open3D log), and its lens is that of a file with "
        "`--intrinsics FILE` (YAML of ROS or OpenCV, a camera of COLMAP, fx fy cx cy). Lenses are undone and "
        "colour is shrunk when a frame is read. Refined poses are written in the form of the scan.", "",
        "Some need a library more: video (stray, which is depth alone without) `planfit[video]`, bags "
        "`planfit[bag]`, record3d `planfit[record3d]`, clouds `planfit[laser]`.", "",
        "| format | told by |", "| --- | --- |",
    ]  # fmt: skip
    formats = {name: format_of(name) for name in READERS}
    lines += [f"| [{name}](#{name}) | {one.expects} |" for name, one in formats.items()]
    lines += [
        "", "## Where the layouts are known from", "",
        "A reader counts when it reads what others wrote. Tests read the real files where they have them "
        "(`tests/scan/test_real_files.py`), with made images where a copy left these out.", "",
        "| format | specification or real file | checked with it |", "| --- | --- | --- |",
    ]  # fmt: skip
    lines += [f"| {name} | {' | '.join(one.checked)} |" for name, one in formats.items()]
    for name, one in formats.items():
        lines += ["", f"## {name}", "", inspect.cleandoc(one.page)]
    return tidy(lines)


PAGES = {
    "options.md": options_page,
    "command-line.md": commands_page,
    "scan-formats.md": scans_page,
}


def texts() -> dict[Path, str]:
    """Every file that is written from the code, and what is in it."""
    pages = {DOCS / name: page() for name, page in PAGES.items()}
    helps = {command.help_path: help_text(command) for command in COMMANDS}
    return pages | helps | {command.flags_path: flags_text(command.name) for command in COMMANDS}


def main() -> None:
    """Write all pages."""
    for path, text in texts().items():
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
        print(f"written: {path}")


if __name__ == "__main__":
    main()
