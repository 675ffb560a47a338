"""A job's process that keeps locks, keys and run folders as the real one, with a refinement that only waits.

Its scan is a file of two words: `now`, or `wait` for a file SCAN.go; then `crash`, `refuse` or an outcome.
"""

import os
import sys
import time
from pathlib import Path

from batch_results import write_results

from planfit.batch.process import perform, read_errand
from planfit.errors import ScanError

errand = read_errand(sys.stdin.buffer)


def refine(words, inputs):
    when, what = Path(words[0]).read_text().split(maxsplit=1)
    own = errand.ledger.own
    (own / f"{errand.job.name}.{time.time_ns()}.begun").write_text(str(os.getpid()))
    while when == "wait" and not Path(f"{words[0]}.go").exists():
        time.sleep(0.02)
    if what == "crash":
        raise RuntimeError("a fault")
    if what == "refuse":
        raise ScanError("this scan is none")
    folder = Path(words[words.index("--out") + 1])
    write_results(folder, {"scan": words[0], **inputs}, "--overwrite" in words, outcome=what)
    (own / f"{errand.job.name}.{time.time_ns()}.finished").touch()


if __name__ == "__main__":
    perform(errand, refine)
