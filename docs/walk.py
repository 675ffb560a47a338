"""Run the commands that docs/first-ten-minutes.md shows, and write what they print below them.

`python docs/walk.py` writes the page anew; a test fails where planfit prints other words than the page shows.
"""

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

PAGE = Path(__file__).parent / "first-ten-minutes.md"
COMMAND = re.compile(
    r"^    \$ (planfit .*?) +# .*\n(?:    (?!\$ ).*\n|\n(?=    (?!\$ )))*", re.MULTILINE
)
"""A command of planfit, the seconds of CPU time that it took, and what it printed."""


def walked(page: str, folder: Path) -> str:
    """The page with what its commands print when they are run one after the other in an empty folder."""

    def run(shown: re.Match[str]) -> str:
        before_s = _cpu_s()
        done = subprocess.run(
            [sys.executable, "-m", *shown[1].split()],
            capture_output=True,
            text=True,
            cwd=folder,
            env={**os.environ, "COLUMNS": "100"},
        )
        told = [line for line in done.stderr.splitlines() if line.startswith("planfit: ")]
        lines = [*done.stdout.strip("\n").splitlines(), *told]
        code = f", exit code {done.returncode}" if done.returncode else ""
        head = f"    $ {shown[1]}  # {_cpu_s() - before_s:.0f} s{code}\n"
        return head + "".join(f"    {line.rstrip()}".rstrip() + "\n" for line in lines)

    return COMMAND.sub(run, page)


def _cpu_s() -> float:
    """Of processes that have ended: what a machine with other work beside it tells as well."""
    times = os.times()
    return times.children_user + times.children_system


def words_of(page: str) -> str:
    """What a page says whatever the machine: numbers are #, and stages are those of some run."""
    told = re.sub(r"\d+\.\d s: [a-z ,.\d\n]*?other \d+\.\d", "# s: stages", page)
    return " ".join(re.sub(r"-?\d+(\.\d+)?", "#", told).split())


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        PAGE.write_text(walked(PAGE.read_text("utf-8"), Path(temporary)), encoding="utf-8")
    print(f"written: {PAGE}")
