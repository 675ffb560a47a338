"""Add what a planfit command calls to the list of kernels that are compiled ahead.

    python benchmarks/kernel_signatures.py COMMAND WORD ...
    python benchmarks/kernel_signatures.py demo -o /tmp/demo

Writes `src/planfit/compiled/signatures.txt`. A line whose kernel is gone, or takes other types now, goes by
hand: `planfit doctor --compile` fails at it.
"""

import sys
import threading
from typing import Any

from numba.core.dispatcher import Dispatcher

from planfit.cli import run
from planfit.compiled.signatures import LISTED, line_of, listed_lines

called: dict[str, None] = {}
"""Lines of kernels that were asked for by Python, not by other kernels while they were compiled."""
_state = threading.local()
_compile = Dispatcher.compile


def recorded(self: Any, signature: Any) -> Any:
    """In the place of `Dispatcher.compile`, which every new signature comes through, cached or not."""
    is_outermost = not getattr(_state, "is_inside", False)
    if is_outermost:
        function = self.py_func
        name = f"{function.__module__}.{function.__qualname__}"
        line = line_of(name, signature)
        if not line:
            print(f"{name}: no line tells {signature}", file=sys.stderr)
        elif name.startswith("planfit."):
            called[line] = None
    _state.is_inside = True
    try:
        return _compile(self, signature)
    finally:
        _state.is_inside = not is_outermost


def main() -> int:
    Dispatcher.compile = recorded
    code = run(sys.argv[1:])
    known = listed_lines()
    lines = sorted({*known, *called})
    notes = [line for line in LISTED.read_text(encoding="utf-8").splitlines() if line[:1] == "#"]
    LISTED.write_text("\n".join([*notes, *lines, ""]), encoding="utf-8")
    print(f"{len(called)} called, {len(lines) - len(known)} of them new: {LISTED}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
