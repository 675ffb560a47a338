"""Progress on one line that is written over: for those who call planfit from a terminal or a notebook."""

import shutil
import sys
from types import TracebackType


class ProgressLine:
    """Says how far each stage is, and leaves no line behind; use as a context, and give it to a `Runtime`.

    Terminals and notebooks write over a line from its beginning; where neither shows it, nothing is said.
    """

    def __init__(self) -> None:
        self.is_shown = sys.stderr.isatty() or "ipykernel" in sys.modules

    def __call__(self, stage: str, done: int, total: int) -> None:
        """As `planfit.runtime.Progress` is called."""
        self._write(f"planfit: {stage}{f' {done}/{total}' if total else ''}")

    def __enter__(self) -> "ProgressLine":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._write("")

    def _write(self, words: str) -> None:
        if self.is_shown:
            width = shutil.get_terminal_size().columns - 1
            sys.stderr.write(f"\r{words[:width]:<{width}}\r")
            sys.stderr.flush()
