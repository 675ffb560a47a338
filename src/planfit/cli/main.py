"""What the commands have in common: help at once, errors in one line, exit codes.

Nothing heavy is imported here: what a command needs is imported when the command is run.
"""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import NoReturn

from planfit import __version__
from planfit.cli.commands import COMMANDS_BY_NAME, Command, looks_like_flag, overview, show_help
from planfit.cli.completion import completions
from planfit.cli.speech import USUAL, Speech, speaking, split_speech
from planfit.errors import OptionError, PlanfitError, did_you_mean

EXIT_OK, EXIT_NOT_BETTER, EXIT_BAD_INPUT, EXIT_INTERRUPTED = 0, 1, 2, 130
EXIT_CLOSED_PIPE = 141
"""128 + SIGPIPE: what a shell tells of other tools whose reader went away."""
COMPLETE = "__complete"
"""Not for users: what the scripts of `planfit completion` ask for the words that may come next."""


def main(argv: Sequence[str] | None = None) -> NoReturn:
    """Run a command and exit with its code."""
    exit_with(lambda: run(sys.argv[1:] if argv is None else argv))


def exit_with(action: Callable[[], int]) -> NoReturn:
    """Exit with the code of an action; silently if whoever read the output went away, as `head` does."""
    try:
        code = action()
        sys.stdout.flush()
    except BrokenPipeError:
        # What is still buffered goes nowhere, or the interpreter complains of it at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = EXIT_CLOSED_PIPE
    sys.exit(code)


def run(argv: Sequence[str]) -> int:
    """Run a command and give its exit code; errors of the input become one line and exit code 2."""
    if argv and argv[0] == COMPLETE:
        print("\n".join(completions(argv[1:])))
        return EXIT_OK
    try:
        words, flags = split_speech(argv)
    except OptionError as error:
        USUAL.error(str(error))
        return EXIT_BAD_INPUT
    name, rest = (words[0], words[1:]) if words else ("--help", [])
    if name == "help" and "-h" not in rest and "--help" not in rest:
        return in_one_line(lambda: show_help(rest) or EXIT_OK, "nothing was begun")
    if name in ("-h", "--help", "help"):
        print(overview(), end="")
        return EXIT_OK
    if name in ("-V", "--version"):
        print(__version__)
        return EXIT_OK
    command = COMMANDS_BY_NAME.get(name)
    if command is None:
        step = did_you_mean(name, COMMANDS_BY_NAME) or f"known: {', '.join(COMMANDS_BY_NAME)}"
        if looks_like_flag(name):
            step = "write the command first, as in 'planfit refine SCAN -o OUT'"
        USUAL.error(f"{name}: expected a command of planfit, found none of this name; {step}")
        return EXIT_BAD_INPUT
    if not {"-h", "--help", *(["--help-all"] if command.is_light else [])}.isdisjoint(rest):
        print(command.help_path.read_text(encoding="utf-8"), end="")
        return EXIT_OK
    kept = (
        "finished stages are kept, the same command goes on from there"
        if command.keeps_stages
        else "nothing of it is kept"
    )

    def spoken() -> int:
        with speaking(flags, argv) as speech:
            return in_one_line(lambda: _run_command(command, rest, speech), kept, speech)

    return in_one_line(spoken, kept)  # for the log, which may not be writable


def in_one_line(action: Callable[[], int], kept: str, speech: Speech = USUAL) -> int:
    """The exit code of an action; errors of the input become one line on stderr, and so does Ctrl-C."""
    try:
        return action()
    except SystemExit as stop:  # the parser has told what was wrong, or printed its help
        return stop.code if isinstance(stop.code, int) else EXIT_BAD_INPUT
    except PlanfitError as error:
        speech.error(str(error))
        return EXIT_BAD_INPUT
    except BrokenPipeError:
        raise  # no fault of the input; see `exit_with`
    except OSError as error:
        what = f"{error.filename}: " if error.filename is not None else ""
        why = error.strerror or str(error)
        speech.error(f"{what}{why}; check the path, the rights and the disk")
        return EXIT_BAD_INPUT
    except KeyboardInterrupt:
        speech.error(f"stopped; {kept}")
        return EXIT_INTERRUPTED


def _run_command(command: Command, argv: list[str], speech: Speech) -> int:
    command.check_flags(argv)
    with _stopped_at_once():
        arguments_type, function = command.load()
        if command.is_light:
            return function(arguments_type.from_words(argv))
        from planfit.cli.console import speaking_as
        from planfit.cli.parser import parse

        words = ["--help" if word == "--help-all" else word for word in argv]
        arguments = parse(arguments_type, f"planfit {command.name}", words)
    with speaking_as(speech):
        return function(arguments)


@contextmanager
def _stopped_at_once() -> Iterator[None]:
    """Ctrl-C ends the program here and now, while nothing but imports has happened.

    As an exception it would pass through half-made modules, some of which, compiled ones above all, turn it
    into an ImportError of their own and a long traceback.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread may say what signals do
        return

    def stop(*_: object) -> NoReturn:
        os.write(2, b"planfit: stopped; nothing was begun\n")
        os._exit(EXIT_INTERRUPTED)

    before = signal.signal(signal.SIGINT, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
