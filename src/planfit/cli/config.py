"""Options from TOML and run.json: the same names as on the command line, unknown ones are errors."""

import tomllib
from pathlib import Path
from typing import Any, TypeVar

from planfit.cli.gone_options import refuse_gone
from planfit.errors import OptionError, ScanError
from planfit.export.option_files import FILES_OF_SCAN
from planfit.runtime import options_of
from planfit.scan import ScanOptions

Options = TypeVar("Options")


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


def scan_options_of(record: dict[str, Any], where: str) -> ScanOptions:
    """How the run of a record read its scan.

    Raises:
        ScanError: the record is of another version; the message begins with `where`.
    """
    values = dict(record.get("scan_options") or {})
    for name in FILES_OF_SCAN:
        if values.get(name):
            values[name] = Path(values[name])
    try:
        return ScanOptions(**values)
    except TypeError as error:
        raise ScanError(
            f"{where}expected scan_options of this version of planfit, found others ({error}); "
            "run planfit refine again"
        ) from error
