"""Options from TOML files: the same names as on the command line, unknown ones are errors."""

import dataclasses
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

import tyro

from planfit.cli.commands import looks_like_flag, plain_name
from planfit.cli.gone_options import refuse_gone
from planfit.errors import OptionError
from planfit.runtime import options_of

Options = TypeVar("Options")


def configured(arguments_type: Any, argv: Sequence[str]) -> Any:
    """Arguments whose options are those of --preset and of the file of --config, for flags to overrule; None
    where neither is given.

    Raises:
        OptionError: there is no such preset; or the file is missing, or has an option that is unknown or
            cannot work.
    """
    is_plain = dataclasses.is_dataclass(arguments_type)  # else a choice of subcommands
    fields = dataclasses.fields(arguments_type) if is_plain else ()
    preset_name, config = (words_behind(name, argv)[:1] for name in ("--preset", "--config"))
    if not (preset_name or config) or "config" not in {field.name for field in fields}:
        return None
    from planfit.pipeline.presets import preset  # commands without presets need no pipeline

    options = preset(preset_name[0] if preset_name else "default")
    if config:
        options = read_options(Path(config[0]), options)
    required = {
        field.name: tyro.MISSING
        for field in fields
        if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
    }
    return arguments_type(**required, options=options)


def words_behind(flag: str, argv: Sequence[str]) -> list[str]:
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
