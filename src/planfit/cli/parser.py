"""From words to arguments, by tyro. What it refuses is told in one line: what was expected, what was found,
the next step."""

import contextlib
import dataclasses
import io
import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import tyro

from planfit.cli.commands import COMMANDS_BY_NAME, KnownFlag, looks_like_flag, plain_name
from planfit.cli.gone_options import refuse_gone
from planfit.errors import OptionError, did_you_mean
from planfit.runtime import options_of, require_content

_WRITTEN = ("-o", "--out")
_KINDS = {"FLOAT": "a number", "INT": "a whole number", "PATH": "a path", "STR": "text"}
"""What tyro calls kinds of values, in words."""
Options = TypeVar("Options")


def parse(arguments_type: Any, prog: str, argv: Sequence[str]) -> Any:
    """Arguments of a command; those of --preset and of the TOML file of --config come before the flags.

    Raises:
        SystemExit: help was asked for, and printed.
        OptionError: the words are not what the command takes; or the file of options is missing, or has an
            option that is unknown or cannot work.
    """
    _check_paths(_Line(prog, argv))
    default = _configured(arguments_type, argv)
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said), _refused_by(_Line(prog, argv)):
            return tyro.cli(
                arguments_type,
                prog=prog,
                args=list(argv),
                default=tyro.MISSING_NONPROP if default is None else default,
                use_underscores=False,
            )
    except SystemExit as stop:
        if not stop.code:  # help was printed
            raise
    # Without the rules that frame it.
    words = " ".join(word for word in said.getvalue().split() if any(map(str.isalnum, word)))
    raise OptionError(f"{_Line(prog, argv).name}: expected other words, found these: {words}")


@dataclass(frozen=True)
class _Line:
    """A command line that is refused."""

    prog: str
    words: Sequence[str]

    @property
    def name(self) -> str:
        """The command's, without the program's."""
        return self.prog.removeprefix("planfit ")

    @property
    def usage(self) -> str:
        """What it takes."""
        command = COMMANDS_BY_NAME.get(self.name)
        return f"'{self.prog} {command.usage}'" if command else "what its help shows"

    @property
    def flags(self) -> dict[str, KnownFlag]:
        """All that there are, of one of planfit's own commands."""
        command = COMMANDS_BY_NAME.get(self.name)
        return command.known_flags() if command else {}

    def refused(self, event: Any) -> str:
        """What is wrong by an event of tyro's; empty where it is of a kind that is not known here."""
        match type(event).__name__:
            case "BadValue" | "InvalidChoice" | "InstantiationFailure" if (
                event.argument is not None
            ):
                return self._value(event.argument.lowered, event.argument.field.default, event)
            case "MissingArgs":
                return self._missing([each.arg for each in event.missing_arguments], event)
            case "UnrecognizedArgs":
                return self._extra(event.tokens[0])
        return ""

    def _value(self, argument: Any, default: Any, event: Any) -> str:
        """A flag whose value cannot be, or is missing."""
        given = [plain_name(word) for word in reversed(self.words)]
        name = next((one for one in given if one in argument.name_or_flags), "values")
        expected, choices = _wanted(argument.metavar)
        found = _words_behind(name, self.words)
        if isinstance(argument.nargs, int):
            # Too few of one are none, whatever an earlier mention of the flag took.
            is_missing = argument.nargs == 1 and type(event).__name__ == "BadValue"
            found = [] if is_missing else found[: argument.nargs]
            if argument.nargs > 1:
                expected = (
                    f"{argument.nargs} values, {_wanted(argument.metavar.split()[0])[0]} each"
                )
        # Of several values tyro names the one that cannot be.
        told = getattr(event, "value", "") or getattr(event, "message", "")
        found = [word for word in found if word in told] or found
        step = did_you_mean(found[0], choices) if found and choices else _example(name, default)
        shown = repr(" ".join(found)) if found else "nothing behind it"
        more = f"'{self.prog} --help-all' tells what it means"
        return f"{name}: expected {expected}, found {shown}; {step or more}"

    def _missing(self, missing: Sequence[Any], event: Any) -> str:
        """What must be given and is not."""
        names = [(arg.lowered.name_or_flags[0], arg.is_positional()) for arg in missing]
        places = [name.upper().replace("_", "-") for name, is_place in names if is_place]
        flags = [name for name, is_place in names if not is_place]
        step = f"'{self.prog} --help' tells more"
        if "-o" in flags and event.unrecognized_tokens:
            step = f"did you mean '-o {event.unrecognized_tokens[0]}'?"
        elif places and len(self.words) > len(missing):
            step = f"put {' '.join(places)} first: some options take all words behind them"
        found = " and ".join(f"no {name}" for name in [*places, *flags])
        return f"{self.name}: expected {self.usage}, found {found}; {step}"

    def _extra(self, word: str) -> str:
        """A word that nothing takes."""
        words = list(self.words)
        before = words[words.index(word) - 1] if word in words[1:] else ""
        kinds = [name for name, flag in self.flags.items() if flag.kind == "word"]
        if looks_like_flag(word) or (":" in word and kinds):
            step = did_you_mean(word, kinds) or "put all other options before that word"
            return (
                f"{word}: expected options of one kind behind the word that chooses it, one of "
                f"{', '.join(kinds)}, found it elsewhere; {step}"
            )
        path = _one_path(words)
        if path:
            step = f"write a path that has blanks in quotes: {path!r}"
        elif looks_like_flag(before):
            step = f"{before} takes no more words"
        elif "-o" in self.flags and not {"-o", "--out"} & {*words}:
            step = f"did you mean '-o {word}'?"
        else:
            step = f"'{self.prog} --help' tells more"
        return f"{self.name}: expected {self.usage}, found {word!r} besides; {step}"


def _check_paths(line: _Line) -> None:
    """Raise `OptionError` at a word that is no file to read: a pipe, for whose writer a reader would wait, a
    device, or nothing, which a variable of the shell leaves that is not set."""
    flag = ""
    for word in line.words:
        value = word
        if looks_like_flag(word):
            flag, value = plain_name(word), word.partition("=")[2]
            if "=" not in word:
                continue
        known = line.flags.get(flag)
        if value == "" and (flag in ("", "--plan") or (known is not None and known.kind == "file")):
            raise OptionError(
                f"{flag or line.name}: expected a path, found an empty word; is a variable of the shell not "
                "set?"
            )
        if flag not in _WRITTEN:  # what is written may go to a device
            require_content(Path(value), OptionError, "a file or a folder")


def _refused_by(line: _Line) -> contextlib.AbstractContextManager[None]:
    """While the context lasts, what tyro refuses raises `OptionError`.

    The hook names argument and reason, in a module that tyro does not promise to keep. Where it is gone or
    other, tyro prints its own words, which `parse` repeats.
    """
    hook = getattr(getattr(tyro, "_errors", None), "on_parse_error", None)
    if hook is None:
        return contextlib.nullcontext()

    def refuse(event: Any) -> None:
        with contextlib.suppress(AttributeError):
            words = line.refused(event)
            if words:
                raise OptionError(words)

    return hook(refuse)


def _wanted(metavar: str) -> tuple[str, list[str]]:
    """What a value must be, by the parser's word for it, and the values where these can be listed."""
    metavar = re.sub(r"\{None\}\||None,", "", metavar)
    listed = re.fullmatch(r"\{(.*)\}", metavar)
    if listed:
        choices = listed[1].split(",")
        return f"one of {', '.join(choices)}", choices
    return " ".join(_KINDS.get(word, word) for word in metavar.split()), []


def _example(name: str, default: Any) -> str:
    """The next step where the default shows how a value is written."""
    if isinstance(default, tuple) and default:
        default = " ".join(map(str, default))
    is_shown = isinstance(default, str | int | float) and default != ""
    return f"write it as {name} {default}" if is_shown else ""


def _one_path(words: Sequence[str]) -> str:
    """A path that is there, whose blanks have made several words of it."""
    for begin in range(len(words)):
        for end in range(begin + 2, len(words) + 1):
            path = " ".join(words[begin:end])
            if len(path) < 1000 and Path(path).exists():
                return path
    return ""


def _configured(arguments_type: Any, argv: Sequence[str]) -> Any:
    """Arguments whose options are those of --preset and of the file of --config, for flags to overrule; None
    where neither is given.

    Raises:
        OptionError: there is no such preset; or the file is missing, or has an option that is unknown or
            cannot work.
    """
    is_plain = dataclasses.is_dataclass(arguments_type)  # else a choice of subcommands
    fields = dataclasses.fields(arguments_type) if is_plain else ()
    preset_name, config = (_words_behind(name, argv)[:1] for name in ("--preset", "--config"))
    if not (preset_name or config) or "config" not in {field.name for field in fields}:
        return None
    from planfit.pipeline.options import preset  # commands without presets need no pipeline

    options = preset(preset_name[0] if preset_name else "default")
    if config:
        options = read_options(Path(config[0]), options)
    required = {
        field.name: tyro.MISSING
        for field in fields
        if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
    }
    return arguments_type(**required, options=options)


def _words_behind(flag: str, argv: Sequence[str]) -> list[str]:
    """The words that a flag takes, of all its mentions: up to the next flag."""
    found: list[str] = []
    is_own = False
    for word in argv:
        if looks_like_flag(word):
            is_own = plain_name(word) == flag
            found += [word.partition("=")[2]] if is_own and "=" in word else []
        elif is_own:
            found.append(word)
    return found


def read_options(path: Path, defaults: Options) -> Options:
    """Options dataclass with the values of a TOML file in place of its defaults.

    Raises:
        OptionError: the file is missing or not TOML, a name is unknown, or a value of another kind.
    """
    try:
        values = tomllib.loads(path.read_text())
    except OSError as error:
        raise OptionError(f"{path}: expected a TOML file of options, {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise OptionError(f"{path}: expected TOML, found {error}") from error
    refuse_gone(values, f"{path}: ")
    return options_of(values, defaults, f"{path}: ")
