"""The folder of a run: who owns it, who may write now, and what a process that dies leaves behind."""

import json
import os
import shutil
import sys

import pytest

from planfit.errors import OutputError
from planfit.runtime.run_folder import RunFolder, finished_record

INPUTS = {"scan": "scan", "scan_fingerprint": "1", "plan": "plan.png"}
OLD = ("run.json", "overlay.png", "covariances.npz", "poses/a.txt", "poses/b.txt")
FIRST = dict.fromkeys(OLD, "old")
SECOND = dict.fromkeys(
    ("run.json", "overlay.png", "report.html", "poses/a.txt", "poses/c.txt"), "new"
)
OWN = {".planfit.json", ".planfit.lock"}


def write_run(folder, files, inputs=INPUTS, overwrite=False):
    with RunFolder.claimed(folder, inputs, overwrite) as run, run.writing() as staging:
        write_files(staging, files)


def write_files(staging, files):
    for name, text in files.items():
        (staging / name).parent.mkdir(exist_ok=True)
        (staging / name).write_text(text)


def write_in_parts(folder, files):
    """All but the report, then the report and a folder that is there already."""
    rest = {"report.html": files["report.html"], "poses/c.txt": files["poses/c.txt"]}
    first = {name: text for name, text in files.items() if name not in rest}
    with RunFolder.claimed(folder, INPUTS, overwrite=False) as run:
        with run.writing(to_come=["report.html"]) as staging:
            write_files(staging, first)
        with run.writing(has_begun=True) as staging:
            shutil.copytree(folder / "poses", staging / "poses")
            write_files(staging, rest)


def contents(folder):
    """Text of all files but those that tell of the folder itself."""
    return {
        str(path.relative_to(folder)): path.read_text()
        for path in folder.rglob("*")
        if path.is_file() and path.name not in OWN
    }


def test_a_run_replaces_all_of_the_run_before(tmp_path):
    out = tmp_path / "out"
    write_run(out, FIRST)
    assert contents(out) == FIRST
    (out / "notes.txt").write_text("mine")
    write_run(out, SECOND)
    assert contents(out) == SECOND | {"notes.txt": "mine"}


def test_the_first_part_of_results_stays_where_the_second_fails(tmp_path):
    out = tmp_path / "out"
    write_run(out, {**FIRST, "run.json": '{"of": "old"}', "report.html": "old"})
    first = {"run.json": '{"of": "new"}', "poses/a.txt": "new"}
    stopped = pytest.raises(KeyboardInterrupt)
    with stopped, RunFolder.claimed(out, INPUTS, overwrite=False) as run:
        with run.writing(to_come=["report.html"]) as staging:
            write_files(staging, first)
        assert contents(out) == first
        with run.writing(has_begun=True) as staging:
            write_files(staging, {"report.html": "half"})
            raise KeyboardInterrupt
    assert contents(out) == first
    assert finished_record(out) is None
    with RunFolder.claimed(out, INPUTS, overwrite=False):
        pass
    assert finished_record(out) is None
    whole = SECOND | {"run.json": '{"of": "new"}'}
    write_in_parts(out, whole)
    assert contents(out) == whole
    assert finished_record(out) == {"of": "new"}


def killed_at(step, folder, files, write=write_run):
    """A process that dies before its `step`-th change in the folder; whether it came so far.

    Audit events come before each open for writing, rename, removal and new folder: before one is after the
    one before it.
    """
    child = os.fork()
    if child:
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) != 0
    left = step

    def count(event, arguments):
        nonlocal left
        changes = event in ("os.rename", "os.remove", "os.mkdir", "os.rmdir") or (
            event == "open"
            and isinstance(arguments[2], int)
            and arguments[2] & (os.O_WRONLY | os.O_RDWR)
        )
        if changes:
            left -= 1
            if left < 0:
                os._exit(9)

    sys.addaudithook(count)
    try:
        write(folder, files)
    finally:
        os._exit(0)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are forked")
@pytest.mark.parametrize("before", [None, FIRST], ids=["first run", "over another run"])
def test_whenever_a_process_dies_the_next_run_ends_as_if_it_had_not(tmp_path, before):
    out, deaths = tmp_path / "out", 0
    while True:
        shutil.rmtree(out, ignore_errors=True)
        if before:
            write_run(out, before)
        if not killed_at(deaths, out, SECOND):
            break
        deaths += 1
        left = contents(out)
        is_moving = (out / ".ready").exists()
        if (
            not is_moving
        ):  # else: they hold already, and the next who takes the folder puts them in place
            results = {name: text for name, text in left.items() if not name.startswith(".")}
            assert results in ({}, before, SECOND)
        write_run(out, SECOND)
        assert contents(out) == SECOND
        assert not list(out.glob(".ready")) + list(out.glob(".writing")) + list(out.glob("*.part"))
    assert deaths > 15


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are forked")
def test_whenever_a_process_dies_between_two_parts_no_run_is_called_finished_that_is_not(tmp_path):
    out, deaths = tmp_path / "out", 0
    second = SECOND | {"run.json": '{"of": "new"}'}
    while True:
        shutil.rmtree(out, ignore_errors=True)
        write_run(out, FIRST | {"run.json": '{"of": "old"}'})
        if not killed_at(deaths, out, second, write_in_parts):
            break
        deaths += 1
        record = finished_record(out)  # puts what is ready in place
        if record is not None:
            whole = second if record["of"] == "new" else FIRST | {"run.json": '{"of": "old"}'}
            left = {name: text for name, text in contents(out).items() if name[0] != "."}
            assert left == whole
        write_in_parts(out, second)
        assert contents(out) == second
        assert finished_record(out) == {"of": "new"}
    assert deaths > 30


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are forked")
def test_results_that_were_being_moved_in_are_put_in_place_by_the_next(tmp_path):
    out, deaths, finished = tmp_path / "out", 0, 0
    while True:
        shutil.rmtree(out, ignore_errors=True)
        write_run(out, FIRST)
        if not killed_at(deaths, out, SECOND):
            break
        deaths += 1
        was_ready = (out / ".ready").exists()
        with RunFolder.claimed(out, INPUTS, overwrite=False):
            pass  # stopped before it has results of its own
        assert contents(out) == (SECOND if was_ready else contents(out))
        assert contents(out) in (FIRST, SECOND)
        finished += was_ready
    assert finished > 3


def test_two_runs_cannot_write_to_one_folder(tmp_path):
    out = tmp_path / "out"
    in_use = pytest.raises(OutputError, match=f"in use by process {os.getpid()} on ")
    with RunFolder.claimed(out, INPUTS, overwrite=False), in_use:
        write_run(out, FIRST)
    write_run(out, FIRST)
    assert contents(out) == FIRST


def test_an_error_leaves_the_old_results_and_nothing_new(tmp_path):
    out = tmp_path / "out"
    write_run(out, FIRST)
    with pytest.raises(OutputError, match="cannot be written"):
        write_run(out, {"overlay.png": "half", ".": "no file"})
    assert contents(out) == FIRST


def test_another_scan_needs_overwrite_and_other_files_are_never_touched(tmp_path):
    out, other = tmp_path / "out", {**INPUTS, "scan": "another"}
    write_run(out, FIRST)
    with pytest.raises(OutputError, match=r"results of another run \(scan with plan.png\)"):
        write_run(out, SECOND, other)
    write_run(out, SECOND, other, overwrite=True)
    assert contents(out) == SECOND
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "photo.jpg").write_text("mine")
    with pytest.raises(OutputError, match="found other files"):
        write_run(tmp_path / "mine", FIRST, overwrite=True)
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["photo.jpg"]


def test_a_folder_of_an_earlier_version_is_known_by_its_record(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "run.json").write_text(json.dumps({"inputs": INPUTS}))
    write_run(out, SECOND)
    assert contents(out) == SECOND


def test_names_that_lead_out_of_the_folder_are_not_followed(tmp_path):
    out = tmp_path / "out"
    write_run(out, FIRST)
    (tmp_path / "precious").write_text("mine")
    owner = json.loads((out / ".planfit.json").read_text())
    (out / ".planfit.json").write_text(
        json.dumps(owner | {"results": ["../precious", 7, "overlay.png"]})
    )
    write_run(out, SECOND)
    assert (tmp_path / "precious").read_text() == "mine"
