"""Options as TOML text and as plain values, for the report and the record of a run."""

import dataclasses
import math
from enum import Enum
from typing import Any

from planfit.findings import Finding, finding_record
from planfit.scan import ScanOptions

FILES_OF_SCAN = ("poses", "calibration")
"""Fields of `ScanOptions` that are paths."""


def to_toml(options: Any) -> str:
    """Options dataclass as TOML text."""
    return "\n".join(_toml_lines(plain(options), ())) + "\n"


def plain(value: Any) -> Any:
    """Dataclasses, enumerations and tuples as dictionaries, names and lists."""
    if isinstance(value, Finding):
        return finding_record(value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = dataclasses.fields(value)
        return {field.name: plain(getattr(value, field.name)) for field in fields}
    if isinstance(value, Enum):
        return value.name.lower()
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    return value


def finite(value: float | None) -> float | None:
    """A number for JSON, which has no NaN and no infinity; None in their place."""
    return None if value is None or not math.isfinite(value) else float(value)


def finite_plain(value: Any) -> dict[str, Any]:
    """A dataclass as `plain` has it, of whose own numbers those that are not finite are None."""
    fields = plain(value).items()
    return {name: finite(one) if isinstance(one, float) else one for name, one in fields}


def scan_options_record(options: ScanOptions) -> dict[str, Any]:
    """How a scan was read as plain values; relative paths of files would lead nowhere later."""
    values = dataclasses.asdict(options)
    for name in FILES_OF_SCAN:
        values[name] = str(values[name].resolve()) if values[name] else None
    return values


def _toml_lines(values: dict[str, Any], path: tuple[str, ...]) -> list[str]:
    lines = [f"[{'.'.join(path)}]"] if path else []
    lines += [f"{k} = {_toml(v)}" for k, v in values.items() if not isinstance(v, dict)]
    for name, value in values.items():
        if isinstance(value, dict):
            lines += ["", *_toml_lines(value, (*path, name))]
    return lines


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, list):
        return "[" + ", ".join(_toml(item) for item in value) + "]"
    return repr(value)
