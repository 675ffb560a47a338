"""One job, in this process: what is done is found, what has changed is done again, what fails is kept."""

import os
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest
from batch_results import write_results

from planfit.batch.jobs import Job, Option, inputs_of, stamp_of
from planfit.batch.ledger import End, key_of
from planfit.batch.process import Errand, perform
from planfit.errors import ScanError


@pytest.fixture
def errand(ledger, tmp_path):
    scan = tmp_path / "scan"
    (scan / "color").mkdir(parents=True)
    (scan / "color" / "0.png").write_bytes(b"0")
    (tmp_path / "plan.pdf").write_bytes(b"1")
    (tmp_path / "poses.txt").write_bytes(b"2")
    options = (Option("--unit", ("m",)), Option("--poses", (str(tmp_path / "poses.txt"),), True))
    job = Job("a", str(scan), (f"0={tmp_path / 'plan.pdf'}",), options)
    return Errand(job, str(ledger.out), "token")


class Refinement:
    """Counts its calls."""

    def __init__(self):
        self.calls = []

    def __call__(self, words, inputs):
        self.calls.append(words)
        out = words[words.index("--out") + 1]
        write_results(Path(out), {"scan": words[0], **inputs}, "--overwrite" in words)


def test_what_is_done_is_not_done_again(errand):
    refine = Refinement()
    first = perform(errand, refine)
    again = perform(replace(errand, token="other"), refine)
    assert (first.end, first.token) == (End.DONE, "token")
    assert len(refine.calls) == 1
    assert again.seconds == first.seconds  # of the run, not of the look
    assert errand.ledger.state("a").token == "other"
    assert errand.ledger.is_done("a", first.key)
    scan, *words = refine.calls[0]
    assert scan == errand.job.scan
    assert words[words.index("--unit") + 1] == "m"
    assert words[words.index("--plan") + 1].startswith("0=")


CHANGES = {
    "a file of the scan": lambda _, t: (t / "scan/color/0.png").write_bytes(b"longer"),
    "a time": lambda _, t: os.utime(t / "scan/color/0.png", ns=(1, 1)),
    "a file more": lambda _, t: (t / "scan/color/1.png").write_bytes(b""),
    "another name": lambda _, t: (t / "scan/color/0.png").rename(t / "scan/color/1.png"),
    "the plan": lambda _, t: (t / "plan.pdf").write_bytes(b"longer"),
    "a file of an option": lambda _, t: (t / "poses.txt").write_bytes(b"longer"),
    "an option": lambda e, _: replace(e.job, options=e.job.options[1:]),
    "a value": lambda e, _: replace(e.job, options=(Option("--unit", ("cm",)), e.job.options[1])),
    "no plan": lambda e, _: replace(e.job, plans=()),
    "another scan": lambda e, t: replace(e.job, scan=str(t / "scan/color")),
}


@pytest.mark.parametrize("change", CHANGES)
def test_what_has_changed_is_done_again(errand, tmp_path, change):
    refine = Refinement()
    before = perform(errand, refine)
    changed = CHANGES[change](errand, tmp_path)
    errand = replace(errand, job=changed) if isinstance(changed, Job) else errand
    after = perform(errand, refine)
    assert len(refine.calls) == 2
    assert after.key != before.key
    assert key_of(errand.ledger.record("a")) == after.key


def test_name_and_memory_change_nothing(errand):
    other = replace(errand.job, name="b", memory_gb=3.0)
    assert inputs_of(other).key == inputs_of(errand.job).key


def test_another_version_does_it_again(errand, monkeypatch):
    before = inputs_of(errand.job).key
    monkeypatch.setattr("planfit.batch.jobs.__version__", "99")
    assert inputs_of(errand.job).key != before


def test_results_are_what_counts_not_what_is_remembered(errand):
    refine = Refinement()
    state = perform(errand, refine)
    (errand.ledger.own / "a.json").unlink()
    assert perform(errand, refine).end is End.DONE
    assert len(refine.calls) == 1
    (errand.ledger.folder("a") / "report.html").unlink()
    assert not errand.ledger.is_done("a", state.key)
    perform(errand, refine)
    assert len(refine.calls) == 2


@pytest.mark.parametrize(
    ("error", "end", "reason"),
    [
        (ScanError("this scan is none"), End.REFUSED, "this scan is none"),
        (RuntimeError("a\nb"), End.CRASHED, "RuntimeError: a"),
        (MemoryError(), End.CRASHED, "MemoryError"),
        (OSError(28, "No space left on device", "x"), End.CRASHED, "x: No space left on device"),
    ],
)
def test_failures_are_told_apart(errand, error, end, reason, capsys):
    def refine(words, inputs):
        raise error

    state = perform(errand, refine)
    assert (state.end, state.reason) == (end, reason)
    assert errand.ledger.state("a") == state
    assert ("Traceback" in capsys.readouterr().err) == (end is End.CRASHED)


def test_results_of_a_failed_change_are_not_taken_for_it(errand, tmp_path):
    perform(errand, Refinement())
    (tmp_path / "plan.pdf").unlink()
    state = perform(errand, Refinement())
    assert state.end is End.REFUSED
    assert "plan.pdf: expected a file or folder, found nothing" in state.reason


def test_a_folder_of_somebody_else_is_not_overwritten(errand):
    folder = errand.ledger.folder("a")
    write_results(folder, {"scan": "another"})
    state = perform(errand, Refinement())
    assert state.end is End.REFUSED
    assert "expected an empty folder" in state.reason
    assert perform(replace(errand, overwrite=True), Refinement()).end is End.DONE


def test_an_errand_goes_through_a_pipe(errand):
    assert Errand.of_plain(errand.plain()) == errand


def test_stamps_of_archives_and_of_nothing(tmp_path):
    with zipfile.ZipFile(tmp_path / "s.zip", "w") as archive:
        archive.writestr("office/a", "b")
    assert stamp_of(str(tmp_path / "s.zip" / "office")) == stamp_of(str(tmp_path / "s.zip"))
    with pytest.raises(ScanError, match="none: expected a file or folder, found nothing"):
        stamp_of(str(tmp_path / "none"))
