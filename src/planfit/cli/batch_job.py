"""The process of one job of a batch, `python -m planfit.cli.batch_job THREADS`; see `batch/process.py`."""

import signal
import sys

from planfit.batch.ledger import End
from planfit.batch.process import perform, read_errand

EXIT_DONE, EXIT_FAILED = 0, 1


def main() -> int:
    """Do the job that stands in the standard input, and say by the exit code whether it is done."""
    # Ctrl-C in a terminal reaches every process of it; who started this one decides.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    errand = read_errand(sys.stdin.buffer)

    def refine(words: list[str], inputs: dict[str, str]) -> None:
        # Takes seconds: only where there is something to be done.
        from planfit.cli.parser import parse
        from planfit.cli.refine import RefineArguments, refine_files

        arguments = parse(RefineArguments, "planfit refine", [*words, "--workers", sys.argv[1]])
        refine_files(arguments, inputs)

    state = perform(errand, refine)
    if state.reason:
        print(state.reason, file=sys.stderr)
    return EXIT_DONE if state.end is End.DONE else EXIT_FAILED


if __name__ == "__main__":
    sys.exit(main())
