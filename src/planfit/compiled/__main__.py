"""`python -m planfit.compiled FOLDER < LINES`: compile kernels; started by `making.make_ready`."""

import sys
from pathlib import Path

from planfit.compiled.making import compile_share

if __name__ == "__main__":
    compile_share(Path(sys.argv[1]), sys.stdin.read().splitlines())
