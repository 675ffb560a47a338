"""`planfit batch` through the command line's own entry point, on real files."""

import csv
import json
import re
from pathlib import Path

import pytest

import reference
from planfit.batch.jobs import OWN_COLUMNS, Job, read_jobs
from planfit.batch.page import JobRow, Result
from planfit.cli import run
from planfit.cli.batch import columns, exit_code, parse_shard

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_a_batch_from_files_to_the_page_and_again(small_scan, tmp_path, capsys):
    folder = tmp_path / "die Häuser"
    folder.mkdir()
    (folder / "scan ü").symlink_to(small_scan)
    jobs = folder / "jobs.csv"
    text = (
        "name;scan;plan;adjust.walls.weight;preset\r\nBüro 1;scan ü;scan ü/floorplan.npy;0.9;\r\n"
    )
    jobs.write_bytes((text + "fehlt;none;;;\r\n").encode("utf-8-sig"))
    out = tmp_path / "out"
    command = ["batch", str(jobs), "-o", str(out), "--workers", "2"]
    assert run(command) == 2
    said = capsys.readouterr().out
    assert "2 scans: 1 refined, 1 refused" in said
    record = json.loads((out / "Büro 1" / "run.json").read_text())
    assert record["options"]["adjust"]["walls"]["weight"] == 0.9
    assert record["inputs"]["plan"] == str(small_scan.resolve() / "floorplan.npy")
    assert Path(record["inputs"]["scan"]) == small_scan.resolve()
    with (out / "jobs.csv").open(encoding="utf-8", newline="") as file:
        done, missing = csv.DictReader(file)
    predicted = float(done["predicted_error_m"])
    assert predicted == pytest.approx(record["verdict"]["predicted_error_rms_m"], abs=1e-4)
    assert 0.1 < float(done["peak_memory_gb"]) < 4
    assert "none: expected a file or folder, found nothing" in missing["reason"]
    written = (out / "Büro 1" / "run.json").stat().st_mtime_ns

    jobs.write_bytes(text.encode("utf-8-sig"))
    assert run(command) == 0
    assert "1 of 1 scans are done already" in capsys.readouterr().out
    assert (out / "Büro 1" / "run.json").stat().st_mtime_ns == written


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("name,scan,unit\na,b,mx\n", "line 2: --unit: expected one of auto, m, .*, found 'mx'"),
        (
            "name,scan,adjust.walls.weight\na,b,thick\n",
            "line 2: --adjust.walls.weight: expected a number, found 'thick'",
        ),
        ("name,scan,preset\na,b,best\n", "line 2: .*best"),
        ("name,scan,tolerance-m\na,b,-1\n", "line 2: .*-1"),
        ("name,scan,adjust.wall.weight\na,b,1\n", "did you mean adjust.walls.weight"),
        ("name,scan,workers\na,b,1\n", "found the column 'workers'"),
        ("name,scan,out\na,b,c\n", "found the column 'out'"),
        ("", "expected a line a job"),
    ],
)
def test_what_no_job_can_do_is_said_before_anything_begins(tmp_path, capsys, line, said):
    jobs = tmp_path / "jobs.csv"
    jobs.write_text(line)
    assert run(["batch", str(jobs), "-o", str(tmp_path / "out")]) == 2
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == 1
    assert re.search(said, errors[0]), errors[0]
    assert not list((tmp_path / "out").glob("a*"))


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (["--workers", "0"], "--workers: expected 1 or more"),
        (["--memory-gb", "-1"], "--memory-gb: expected a number above 0"),
        (["--shard", "0/4"], "--shard: expected I/N with I from 1 to N"),
        (["--shard", "half"], "--shard: expected I/N"),
    ],
)
def test_bad_flags(tmp_path, capsys, flags, said):
    (tmp_path / "jobs.csv").write_text("name,scan\na,b\n")
    assert run(["batch", str(tmp_path / "jobs.csv"), "-o", str(tmp_path / "out"), *flags]) == 2
    assert said in capsys.readouterr().err


def test_every_option_of_refine_can_be_a_column():
    flags = set(reference.all_flags("refine")) - {
        "-o",
        "--out",
        "--overwrite",
        "--no-overwrite",
        "--workers",
        "--cache",
        "--plan",
    }
    known = {f"--{name}" for name in columns()}
    switches = {f"--{name}" for name, column in columns().items() if column.has_no}
    off = {re.sub(r"^--(.*\.)?", lambda m: f"--{m[1] or ''}no-", name) for name in switches}
    assert known | off == flags
    assert not known & {f"--{name}" for name in OWN_COLUMNS}
    files = {name for name, column in columns().items() if column.is_file}
    of_plan = {"wall-mask", "plan-edits"}
    of_survey = {"control-points", "check-points", "marks"}
    assert files == {"poses", "calibration", "config", "corrections"} | of_plan | of_survey


@pytest.mark.parametrize("n", [1, 3, 8])
def test_shards_are_all_of_the_list_once(n):
    jobs = list(range(13))
    parts = [
        jobs[first::step] for first, step in (parse_shard(f"{i}/{n}") for i in range(1, n + 1))
    ]
    assert sorted(job for part in parts for job in part) == jobs
    assert max(map(len, parts)) - min(map(len, parts)) <= 1


@pytest.mark.parametrize(
    ("results", "code"),
    [
        ([Result.REFINED], 0),
        ([Result.REFINED, Result.RESERVATIONS], 1),
        ([Result.NO_BETTER, Result.REFINED], 1),
        ([Result.RESERVATIONS, Result.REFUSED], 2),
        ([Result.CRASHED], 2),
        ([Result.OPEN], 2),
    ],
)
def test_the_exit_code_is_that_of_the_worst(results, code):
    assert exit_code([JobRow(Job("a", "b"), result, "") for result in results]) == code


def test_the_lists_that_are_shown_parse(tmp_path):
    page = (ROOT / "docs" / "batch.md").read_text()
    (shown,) = re.findall(r"```csv\n(.*?)```", page, re.DOTALL)
    assert shown == (ROOT / "examples" / "batch" / "jobs.csv").read_text()
    names = [job.name for _, job in read_jobs(ROOT / "examples" / "batch" / "jobs.csv", columns())]
    (toml,) = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    (tmp_path / "jobs.toml").write_text(toml)
    (job,) = [job for _, job in read_jobs(tmp_path / "jobs.toml", columns())]
    assert job.name in names
    assert len(job.plans) == 2


def test_a_cluster_needs_its_library(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    (tmp_path / "jobs.csv").write_text("name,scan\na,b\n")
    command = ["batch", str(tmp_path / "jobs.csv"), "-o", str(tmp_path / "out")]
    assert run([*command, "--scheduler", "tcp://h:1"]) == 2
    assert "planfit[cluster]" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("workers", "jobs", "threads"), [(8, 1, 8), (8, 8, 1), (3, 9, 2), (99, 99, 1)]
)
def test_the_processors_are_shared_out_among_what_runs(
    tmp_path, monkeypatch, workers, jobs, threads
):
    monkeypatch.setattr("os.cpu_count", lambda: 8)
    seen = {}

    class Pool:
        def __init__(self, launcher, workers, allowed_bytes, on_start):
            seen.update(threads=launcher.threads, workers=workers, allowed=allowed_bytes)

        def run(self, tasks):
            return iter(())

    monkeypatch.setattr("planfit.cli.batch.LocalPool", Pool)
    lines = [f"j{i},{tmp_path}\n" for i in range(jobs)]
    (tmp_path / "jobs.csv").write_text("name,scan\n" + "".join(lines))
    command = ["batch", str(tmp_path / "jobs.csv"), "-o", str(tmp_path / "out"), "--memory-gb", "3"]
    assert run([*command, "--workers", str(workers)]) == 2
    assert seen == {"threads": threads, "workers": min(workers, jobs), "allowed": 3 * 10**9}
