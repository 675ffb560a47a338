"""How the program begins and ends: help without imports, names on demand, closed pipes, Ctrl-C."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import planfit
from planfit.cli import main as main_function
from planfit.cli.commands import COMMANDS
from planfit.cli.main import EXIT_CLOSED_PIPE, EXIT_INTERRUPTED, in_one_line

COMMAND = "from planfit.cli import main; main()"
HEAVY = {"numpy", "scipy", "numba", "cv2", "tyro", "rich", "planfit.pipeline"}


@pytest.mark.parametrize(
    "words", [["--version"], ["--help"], *([c.name, "--help"] for c in COMMANDS)], ids=" ".join
)
def test_help_and_version_import_nothing_heavy(words: list[str]) -> None:
    code = f"""
import sys
from planfit.cli import run
assert run({words}) == 0
print("imported:", *({HEAVY} & set(sys.modules)))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "imported:"


@pytest.mark.parametrize("name", [name for name in planfit.__all__ if name != "__version__"])
def test_every_name_of_the_package_is_there(name: str) -> None:
    assert getattr(planfit, name).__name__.removeprefix("planfit.") == name
    assert name in dir(planfit)


def test_unknown_name_of_the_package_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'planfit' has no attribute 'refined'"):
        planfit.refined  # noqa: B018


def test_module_is_run_as_the_command() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "planfit", "--version"], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == planfit.__version__


def run_into_closed_pipe(words: list[str]) -> tuple[int, str]:
    """Exit code and stderr of a command whose stdout nobody reads."""
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(
        [sys.executable, "-c", COMMAND, *words], stdout=writing, stderr=subprocess.PIPE, text=True
    )
    os.close(writing)
    return done.returncode, done.stderr


@pytest.mark.skipif(os.name == "nt", reason="pipes of Windows close in another way")
@pytest.mark.parametrize(
    "words", [["--help"], ["refine", "--help"], ["refine", "--help-all"]], ids=" ".join
)
def test_closed_pipe_is_silent(words: list[str]) -> None:
    assert run_into_closed_pipe(words) == (EXIT_CLOSED_PIPE, "")


@pytest.mark.skipif(os.name == "nt", reason="pipes of Windows close in another way")
def test_closed_pipe_of_a_table_is_silent(small_scan: Path) -> None:
    words = ["plan", str(small_scan / "floorplan.npy")]
    assert run_into_closed_pipe(words) == (EXIT_CLOSED_PIPE, "")


def test_errors_are_told_though_the_pipe_is_closed() -> None:
    code, said = run_into_closed_pipe(["plan", "nothing"])
    assert (code, said.startswith("planfit: nothing: ")) == (2, True)


@pytest.mark.skipif(os.name == "nt", reason="no SIGINT can be sent to another process")
def test_interrupt_while_importing_is_one_line() -> None:
    # A module that the commands import waits, so that the interrupt surely falls into the imports.
    code = f"""
import sys
class Waits:
    def find_spec(self, name, *_):
        if name == "scipy":
            print("importing", flush=True)
            import time
            time.sleep(60)
sys.meta_path.insert(0, Waits())
{COMMAND}
"""
    process = subprocess.Popen(
        [sys.executable, "-c", code, "refine", "scan", "-o", "out"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stdout.readline() == "importing\n"
    time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=50)
    assert (process.returncode, said) == (EXIT_INTERRUPTED, "planfit: stopped; nothing was begun\n")


def test_interrupt_of_a_command_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    def action() -> int:
        raise KeyboardInterrupt

    assert in_one_line(action, "much is kept") == EXIT_INTERRUPTED
    assert capsys.readouterr().err == "planfit: stopped; much is kept\n"


def test_main_exits_with_the_code_of_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main_function(["nothing"])
    assert stop.value.code == 2
    said = capsys.readouterr().err
    assert "nothing: expected a command of planfit, found none of this name; known: refine" in said
