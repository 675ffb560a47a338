"""Annotations are checked at every call while the tests run: shapes by jaxtyping, types by beartype."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from beartype import BeartypeConf, FrozenDict, beartype
from jaxtyping import install_import_hook

SOURCES = Path(__file__).parents[1] / "src"

_check = beartype(
    conf=BeartypeConf(
        # What NumPy gives for a number is as good as a number, and an int may stand for a float (PEP 484).
        hint_overrides=FrozenDict(
            {
                bool: bool | np.bool_,
                int: int | np.integer,
                float: float | int | np.floating | np.integer,
            }
        )
    )
)


def typechecked(function: Callable[..., Any]) -> Callable[..., Any]:
    """Check a function; options and plans check themselves, and tell users more."""
    is_options = re.search(r"(Options|Arguments|Floorplan)\.__init__$", function.__qualname__)
    return function if is_options else _check(function)


def modules_to_check() -> list[str]:
    """All modules but packages and those with kernels: numba cannot compile a wrapped function."""
    found = []
    for path in sorted((SOURCES / "planfit").rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if path.name != "__init__.py" and "import kernel" not in text and "numba" not in text:
            found.append(".".join(path.relative_to(SOURCES).with_suffix("").parts))
    return found


def install() -> None:
    """Check whatever is imported from here on."""
    install_import_hook(modules_to_check(), "shape_checks.typechecked")
