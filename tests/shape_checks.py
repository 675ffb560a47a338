"""Annotations are checked while the tests run: shapes by jaxtyping, types by beartype.

Of each function the first `MOST_CALLS` calls of a test are: small ones that are called for every edge of a
picture took four fifths of the time of their tests.
"""

import functools
import re
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np
from beartype import BeartypeConf, FrozenDict, beartype
from jaxtyping import install_import_hook

SOURCES = Path(__file__).parents[1] / "src"
MOST_CALLS = 40
_calls: Counter[str] = Counter()
_let_go: list[Any] = []
"""Functions that were called so often in this test."""
unchecked: list[Callable[..., Any]] = []
"""Functions whose check may not be made yet: it is made at the first call, since those of all functions that
are imported take seven seconds of each process, and most are never called. `make_checks` makes the rest."""

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
    if re.search(r"(Options|Arguments|Floorplan)\.__init__$", function.__qualname__):
        return function
    if "<locals>" in function.__qualname__:
        return function
    name = f"{function.__module__}.{function.__qualname__}"
    checked: Callable[..., Any] | None = None

    @functools.wraps(function)
    def counted(*args: Any, **kwargs: Any) -> Any:
        nonlocal checked
        if checked is None:
            checked = _check(function)
        _calls[name] += 1
        if _calls[name] == 2 * MOST_CALLS:  # its arguments, and again with what it returns
            _let_go_of(function)
        return checked(*args, **kwargs)

    unchecked.append(function)
    return counted


def _let_go_of(function: Callable[..., Any]) -> None:
    """Of one that can be found by its name; what jaxtyping made of it looks for this mark at every call."""
    found: Any = sys.modules[function.__module__]
    for name in function.__qualname__.split("."):
        found = getattr(found, name, None)
    if isinstance(found, FunctionType):  # not where another decorator lies around it
        found.__no_type_check__ = True
        _let_go.append(found)


def make_checks() -> None:
    """Of the functions that were imported: an annotation that cannot be checked raises."""
    while unchecked:
        _check(unchecked.pop())


def begin_test() -> None:
    """Check all functions again."""
    _calls.clear()
    while _let_go:
        del _let_go.pop().__no_type_check__


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
