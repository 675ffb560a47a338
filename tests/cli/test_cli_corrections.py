"""Corrections by hand on the command line: used, recorded and told, or refused in one line."""

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from pathlib import Path

import numpy as np
import pytest

from planfit.cli import run
from planfit.cli.run_record import read_record
from planfit.cli.view import ViewArguments, open_session
from planfit.corrections import read_corrections
from planfit.errors import FloorplanError, ScanError
from planfit.floorplan import PlanOptions, read_floorplan
from planfit.viewer import ViewServer

PATIENCE_S = 120.0
"""How long a page may take to come or to go before a test gives up: a hang, on any machine."""


def refine(scan: Path, out: Path, *flags: str) -> int:
    return run(["refine", str(scan), "-o", str(out), "--report.no-has-view", *flags])


@pytest.fixture(scope="module")
def corrected(small_scan: Path, brief: list[str], tmp_path_factory) -> tuple[Path, Path]:
    """A run with a correction of each kind, and their file."""
    folder = tmp_path_factory.mktemp("corrected")
    path, out = folder / "hand.toml", folder / "out"
    faces = read_floorplan(small_scan / "floorplan.npy").ends
    short = np.argsort(np.linalg.norm(faces[:, 1] - faces[:, 0], axis=1))
    # Short ones: the others bound the rooms.
    lines = ["[[add_loop]]", "frames = [1, 58]", "note = 'seen on site'"]
    lines += ["[[delete_loop]]", "frames = [[0, 5], [50, 55]]"]
    lines += ["[[exclude_frames]]", "frames = [[20, 22]]"]
    lines += ["[[erase_wall]]", f"ends = {faces[short[0]].tolist()}"]
    lines += ["[[exclude_wall]]", f"ends = {faces[short[1]].tolist()}"]
    lines += ["[[draw_wall]]", "ends = [[0.5, 0.4], [0.9, 0.4]]"]
    path.write_text("\n".join(lines))
    assert refine(small_scan, out, "--corrections", str(path), *brief[:2]) in (0, 1)
    return path, out


def test_all_that_was_used_is_recorded_and_told(corrected, small_scan: Path) -> None:
    path, out = corrected
    record = json.loads((out / "run.json").read_text())
    told = record["corrections"]
    assert told["file"] == str(path)
    assert told["left_out"] == []
    assert [each["kind"] for each in told["used"]] == [
        "add_loop", "delete_loop", "exclude_frames", "exclude_wall", "erase_wall", "draw_wall",
    ]  # fmt: skip
    assert told["used"][0]["note"] == "seen on site"
    assert told["used"][0]["residual_m"] < 0.1
    assert record["keyframes"] == record["frames"] - 3
    n_faces = len(read_floorplan(small_scan / "floorplan.npy"))
    assert record["plan_faces"] == n_faces
    assert "6 corrections by hand: 1 loop added" in (out / "report.html").read_text()
    # The text of the record repeats the run.
    again = path.with_name("again.toml")
    again.write_text(told["toml"])
    assert [each.words for each in read_corrections(again)] == [
        each.words for each in read_corrections(path)
    ]


def test_a_corrected_run_is_judged_on_its_corrected_plan(corrected, small_scan: Path) -> None:
    """Though it has as many faces as the plan as read, they are other ones."""
    plan = read_record(corrected[1]).floorplan(PlanOptions())
    assert plan is not None
    read = read_floorplan(small_scan / "floorplan.npy")
    assert len(plan) == len(read)
    np.testing.assert_allclose(plan.ends[-1], [[0.5, 0.4], [0.9, 0.4]])
    assert plan.is_unused is not None
    assert plan.is_unused.sum() == 1


def test_the_page_is_served_until_it_is_ended(corrected) -> None:
    """By the command itself, without a browser; Ctrl-C ends it, and says where corrections are."""
    command = [
        sys.executable,
        "-m",
        "planfit",
        "view",
        str(corrected[1]),
        "--no-browser",
        "--workers=1",
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        address = process.stdout.readline().strip()
        assert process.stdout.readline().startswith("corrections are kept in")
        try:
            with urllib.request.urlopen(f"{address}state", timeout=PATIENCE_S) as answer:
                assert json.load(answer)["frames"] == 60
            process.send_signal(signal.SIGINT)
            told = process.communicate(timeout=PATIENCE_S)[0]
        finally:
            process.kill()  # else a page that goes on is waited for without end
    assert process.returncode == 0
    assert told.strip().startswith("ended; corrections are in")


def test_a_run_is_opened_as_it_was_read(corrected, small_scan: Path, tmp_path: Path) -> None:
    session = open_session(ViewArguments(corrected[1], workers=1))
    assert len(session.scan) == 60
    assert session.floorplan is not None
    session.add("add_loop", {"frames": [3, 57]})
    assert (corrected[1] / "corrections.toml").exists()
    with pytest.raises(ScanError, match="expected the record of a run, found nothing"):
        open_session(ViewArguments(tmp_path))
    other = tmp_path / "other.npy"
    faces = np.load(small_scan / "floorplan.npy")
    np.save(other, faces[:-1])
    with pytest.raises(FloorplanError, match="expected the plan as the run read it"):
        open_session(ViewArguments(corrected[1], plan=other))


@pytest.fixture
def opened_again(corrected, tmp_path: Path, monkeypatch) -> tuple[Path, list[dict]]:
    """A copy of the run, and what each solve of its page gives to `refine_into`."""
    folder, given = tmp_path / "out", []
    without = shutil.ignore_patterns("cache", "corrections.toml")
    shutil.copytree(corrected[1], folder, ignore=without)
    monkeypatch.setattr(
        "planfit.cli.view.refine_into",
        lambda _folder, inputs, _workers, **more: given.append({**more, "inputs": inputs}),
    )
    return folder, given


def test_corrections_of_another_file_go_on(opened_again, corrected) -> None:
    """A page that began with none of them would solve without what the run was made with."""
    folder, given = opened_again
    session = open_session(ViewArguments(folder, workers=1))
    rows = session.state()["corrections"]
    assert len(rows) == 6
    assert all(row["is_solved"] for row in rows)
    session.start_solve()
    session.wait()
    assert len(given[0]["by_hand"].corrections) == 6
    assert given[0]["inputs"].report.has_view is False
    assert not session.path.exists()
    session.add("add_loop", {"frames": [3, 57]})
    assert len(read_corrections(session.path)) == 7
    # Once the page has its own file, that alone counts; taken out by hand, none is left.
    session.path.write_text("planfit_corrections = 1\n")
    assert open_session(ViewArguments(folder, workers=1)).state()["corrections"] == []


def test_places_count_for_more_than_the_number_of_an_alignment(opened_again) -> None:
    """They leave one alignment: there is no second one to take."""
    folder, given = opened_again
    record = json.loads((folder / "run.json").read_text())
    record["options"]["align"]["candidate"] = 2
    (folder / "run.json").write_text(json.dumps(record))
    session = open_session(ViewArguments(folder, workers=1))
    session.start_solve()
    session.wait()
    session.add("place", {"scan": [1.0, 1.0, 1.0], "plan": [1.0, 1.0]})
    session.start_solve()
    session.wait()
    assert [each["inputs"].options.align.candidate for each in given] == [2, 1]


def test_no_browser_and_a_taken_port_are_told(corrected, monkeypatch, capsys) -> None:
    is_asked = threading.Event()

    def ended(*_: object, **__: object) -> None:
        assert is_asked.wait(10)
        time.sleep(0.2)  # until it is told
        raise KeyboardInterrupt

    monkeypatch.setattr("webbrowser.get", lambda: None)
    monkeypatch.setattr("webbrowser.open", lambda _: bool(is_asked.set()))
    monkeypatch.setattr(ViewServer, "serve_forever", ended)
    assert run(["view", str(corrected[1])]) == 0
    said = capsys.readouterr().out
    assert said.startswith("http://127.0.0.1:")
    assert "no browser was found to open it: open the address above in one" in said
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert run(["view", str(corrected[1]), "--port", str(port)]) == 2
    assert f"--port: expected a free port, found one in use at {port}" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform == "win32", reason="a browser that is a shell script")
@pytest.mark.parametrize("is_of_terminal", [False, True])
def test_no_browser_keeps_the_page_from_being_served(
    corrected, tmp_path: Path, is_of_terminal: bool
) -> None:
    """One that is waited for until it is closed; one that takes the terminal is not opened."""
    script, opened = tmp_path / ("w3m" if is_of_terminal else "browser"), tmp_path / "opened"
    script.write_text(f'#!/bin/sh\necho "$1" > {opened}\nexec sleep 20 > /dev/null 2>&1\n')
    script.chmod(0o755)
    hidden = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")
    env = {name: value for name, value in os.environ.items() if name not in hidden}
    # On PATH there is nothing else, as Python takes the first of several.
    env |= (
        {"PATH": str(tmp_path) + ":/bin", "TERM": "xterm"}
        if is_of_terminal
        else {"BROWSER": str(script)}
    )
    command = [sys.executable, "-m", "planfit", "view", str(corrected[1]), "--workers=1"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=env) as process:
        assert process.stdout is not None
        address = process.stdout.readline().strip()
        try:
            with urllib.request.urlopen(f"{address}state", timeout=PATIENCE_S) as answer:
                assert json.load(answer)["frames"] == 60
            told = ""
            if is_of_terminal:
                late = threading.Timer(PATIENCE_S, process.kill)
                late.start()
                while "no browser was found" not in told and (line := process.stdout.readline()):
                    told += line
                late.cancel()
            else:
                end = time.monotonic() + PATIENCE_S
                while not (opened.exists() and opened.read_text().strip() == address):
                    assert time.monotonic() < end
                    time.sleep(0.05)
            process.send_signal(signal.SIGINT)
            told += process.communicate(timeout=PATIENCE_S)[0]
        finally:
            process.kill()
    assert process.returncode == 0
    assert ("no browser was found" in told) == is_of_terminal
    assert opened.exists() != is_of_terminal


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[[add_lop]]", "did you mean 'add_loop'"),
        ("[[add_loop]]\nframes = [1, 99]", "add_loop 1: expected frames from 0 to 59, found 99"),
        ("[[erase_wall]]\nends = [[50, 50], [51, 50]]", "expected a face from [50.0, 50.0]"),
        (
            "[[place]]\nscan = [0, 0, 0]\nplan = [900, 900]",
            "expected points on the plan, which spans",
        ),
        (
            "[[add_loop]]\nframes = [1, 58]\n[[delete_loop]]\nframes = [1, 58]",
            "found 1 contradicted: add_loop 1: frames 1 and 58 see the same: a delete_loop says the opposite",
        ),
    ],
)
def test_bad_corrections_are_refused_in_one_line(
    small_scan: Path, brief: list[str], tmp_path: Path, capsys, text: str, words: str
) -> None:
    path, out = tmp_path / "hand.toml", tmp_path / "out"
    path.write_text(text)
    # Places are refused once loops are closed.
    assert refine(small_scan, out, "--corrections", str(path), *brief[:2]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    (line,) = [one for one in said if one.startswith("planfit:")]
    assert str(path) in line
    assert words in line
    assert not (out / "run.json").exists()
