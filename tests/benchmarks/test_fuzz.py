"""The fuzzer finds what it is for: readers that raise, hang, die or give numbers that are none."""

import gc
import os
import signal
import time
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fuzz import command, reading
from fuzz.command import mutant, read_outcomes, run_batch, summary
from fuzz.mutations import BINARY, TEXT, change_json
from fuzz.reading import Outcome
from fuzz.samples import Sample

from planfit.errors import ScanError

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are forked")
POSES = b"".join(b"%d 0 0 0 0 0 0 1\n" % i for i in range(6))
SAMPLE = Sample("poses", "poses", "poses.txt", {"poses.txt": POSES, "other.bin": bytes(range(256))})


def dies(path: Path) -> str:
    os.kill(os.getpid(), signal.SIGKILL)
    return ""


def hangs(path: Path) -> str:
    time.sleep(60)
    return ""


def eats(path: Path) -> str:
    return str(np.ones(int(2.2 * 2**30), np.uint8)[0])[:0]


def raises(path: Path) -> str:
    raise KeyError("what a parser came across")


def refuses(path: Path) -> str:
    raise ScanError("poses.txt: expected poses, found none")


def mumbles(path: Path) -> str:
    raise ScanError  # says nothing


def warns(path: Path) -> str:
    warnings.warn("invalid value", RuntimeWarning, stacklevel=1)
    return ""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("reader", "kind"),
    [
        (dies, "crash"),
        (hangs, "hang"),
        (eats, "memory"),
        (raises, "traceback"),
        (refuses, "refused"),
        (mumbles, "many lines"),
        (warns, "warned"),
        (lambda _: "poses", "non-finite"),
        (lambda _: "", "read"),
    ],
)
def test_each_kind_of_outcome_is_told(reader, kind, monkeypatch) -> None:
    monkeypatch.setitem(reading.READERS, "poses", reader)
    monkeypatch.setattr(command, "MAX_SECONDS", 0.3 if reader is hangs else 20.0)
    outcomes = run_batch(SAMPLE, range(2, 4), seed=0)
    assert (outcomes[0].kind, outcomes[0].number) == (kind, 2)
    # What ends the process ends its batch: the next begins behind it.
    assert len(outcomes) == (1 if kind in ("crash", "hang") else 2)


class OfAnotherProcess:
    """Like the decoder of a video: freed in a forked process, it waits for threads that stayed behind."""

    def __init__(self) -> None:
        self.itself, self.owner = self, os.getpid()

    def __del__(self) -> None:
        if os.getpid() != self.owner:
            time.sleep(60)


def test_what_the_warm_up_leaves_is_not_freed_in_a_forked_process(monkeypatch) -> None:
    # A video's decoder was, in whichever mutant the collector happened to run: a hang that no reader had.
    def leaves_garbage(path: Path) -> str:
        gc.collect()  # as much allocation brings about
        OfAnotherProcess()
        return ""

    monkeypatch.setitem(reading.READERS, "poses", leaves_garbage)
    monkeypatch.setattr(command, "MAX_SECONDS", 0.3)
    command.warm_up(SAMPLE)
    assert [each.kind for each in run_batch(SAMPLE, range(1, 3), seed=0)] == ["read", "read"]
    gc.unfreeze()


def test_a_hang_is_believed_where_a_new_interpreter_hangs_too(monkeypatch, tmp_path) -> None:
    hung = Outcome("scan-tum", 1, "hang", 100.0, "more than 20 s")
    assert command.in_new_interpreter(hung, seed=1).kind in reading.GOOD
    monkeypatch.setattr(command, "MAX_SECONDS", 0.02)  # no interpreter starts in so short a time
    assert command.in_new_interpreter(hung, seed=1) == hung


def test_real_mutants_are_read_or_refused() -> None:
    outcomes = run_batch(SAMPLE, range(40), seed=0)
    assert outcomes[0].kind == "read"
    assert {each.kind for each in outcomes} == {"read", "refused"}


def test_a_mutant_is_made_from_seed_sample_and_number_alone() -> None:
    assert mutant(SAMPLE, 7, 1) == mutant(SAMPLE, 7, 1)
    others = [mutant(SAMPLE, 7, 2), mutant(SAMPLE, 8, 1), mutant(replace(SAMPLE, name="x"), 7, 1)]
    assert mutant(SAMPLE, 7, 1) not in others
    assert mutant(SAMPLE, 0, 1) == {}


@pytest.mark.parametrize(
    "mutation", dict.fromkeys([*BINARY, *TEXT, change_json]), ids=lambda m: m.__name__
)
@pytest.mark.parametrize("data", [b"", b"x", POSES, bytes(4000), b'{"a": [1, {"b": null}]}'])
def test_mutations_take_any_file_and_mostly_change_it(mutation, data) -> None:
    made = [mutation(data, np.random.default_rng(i)) for i in range(20)]
    assert data in (b"", b"x", bytes(4000)) or sum(each != data for each in made) > 10


def test_outcomes_are_kept_and_a_torn_line_is_none(tmp_path: Path) -> None:
    path = tmp_path / "outcomes.jsonl"
    some = [
        Outcome("a", 0, "read", 0.1),
        Outcome("a", 1, "traceback", 0.2, "KeyError at x.py:3: 'b'"),
    ]
    path.write_text("".join(f"{each.as_line()}\n" for each in some) + some[0].as_line()[:20])
    assert read_outcomes(path) == some
    table = summary(some)
    assert "| all | 2 | 1 | 0 | 0 | 1 |" in table
    assert "1 x traceback: KeyError at x.py:3; a:1" in table
