"""`planfit batch` under kill -9: is anything lost, done twice, or other than in an undisturbed run?

    python benchmarks/batch_kills.py FOLDER [--jobs 6] [--kills 20] [--seed 0]

FOLDER gets small synthetic scans, one undisturbed batch, and batches in which, at random times, a process
taken at random among the batch and its jobs is killed. A killed batch is called again. When all is done
before there were enough kills, the next batch begins in a folder of its own. Told in the end:

- lost: jobs of a batch without complete results, or with others than the undisturbed run (every file but
  reports, logs and caches; of run.json all but times and paths);
- done twice: complete results that were written once more by the same batch;
- how long, at most, a job's process went on after its batch was killed: it ends when it next comes out of
  compiled code. Until then it holds the lock of its job.
"""

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from batch_scans import write_jobs

POLL_S = 0.05
ORPHAN_S = 60.0
NOT_COMPARED = {"report.html", ".planfit.json", ".planfit.lock"}
"""Hold times and paths."""


@dataclass
class Tally:
    """What happened."""

    kills: int = 0
    of_the_batch: int = 0
    batches: int = 0
    orphan_s: float = 0.0
    twice: list[str] = field(default_factory=list)
    different: list[str] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--jobs", type=int, default=6)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--longest-wait-s",
        type=float,
        default=15.0,
        help="of a batch that works, for the next kill",
    )
    arguments = parser.parse_args()
    rng = random.Random(arguments.seed)
    jobs = write_jobs(arguments.folder, arguments.jobs)
    names = [f"job {i}" for i in range(arguments.jobs)]
    undisturbed = arguments.folder / "undisturbed"
    start(jobs, undisturbed).wait()
    tally = Tally()
    while tally.kills < arguments.kills:
        tally.batches += 1
        out = arguments.folder / f"disturbed {tally.batches}"
        shutil.rmtree(out, ignore_errors=True)
        disturb(jobs, out, names, arguments, rng, tally)
        tally.lost += [f"{out.name}/{n}" for n in names if not (out / n / "run.json").exists()]
        tally.different += differences(undisturbed, out, names)
    print(
        f"{tally.kills} kills, {tally.of_the_batch} of them of the batch itself, in {tally.batches} batches "
        f"of {len(names)} jobs: {len(tally.lost)} lost {tally.lost}, {len(tally.twice)} done twice "
        f"{tally.twice}, {len(tally.different)} files other than undisturbed {tally.different}, "
        f"jobs of a killed batch ended within {tally.orphan_s:.1f} s"
    )
    return 1 if tally.lost or tally.twice or tally.different or tally.orphan_s > ORPHAN_S else 0


def start(jobs: Path, out: Path) -> "subprocess.Popen[bytes]":
    """The batch, on two workers."""
    words = [sys.executable, "-m", "planfit", "batch", str(jobs), "-o", str(out), "--workers", "2"]
    return subprocess.Popen(words, stdout=subprocess.DEVNULL)


def disturb(
    jobs: Path,
    out: Path,
    names: list[str],
    arguments: argparse.Namespace,
    rng: random.Random,
    tally: Tally,
) -> None:
    """One batch to its end, killed and called again."""
    finished: dict[str, int] = {}
    while True:
        batch, due = start(jobs, out), None
        while batch.poll() is None:
            time.sleep(POLL_S)
            note_finished(out, names, finished, tally)
            children = children_of(batch.pid)
            if due is None and children:  # imports alone take seconds: nothing is to be lost there
                due = time.monotonic() + rng.uniform(0, arguments.longest_wait_s)
            if tally.kills >= arguments.kills or due is None or time.monotonic() < due:
                continue
            due = time.monotonic() + rng.uniform(0, arguments.longest_wait_s)
            victim = rng.choice([batch.pid, *children])
            tally.kills += 1
            print(
                f"kill {tally.kills}: {'batch' if victim == batch.pid else 'job'}, {len(finished)} done",
                flush=True,
            )
            os.kill(victim, signal.SIGKILL)
            if victim == batch.pid:
                tally.of_the_batch += 1
                batch.wait()
                tally.orphan_s = max(tally.orphan_s, seconds_until_gone(children))
        note_finished(out, names, finished, tally)
        if batch.returncode != -signal.SIGKILL and len(finished) == len(names):
            return
        # A job that was killed on both tries is called crashed; the next call tries it again.


def note_finished(out: Path, names: list[str], finished: dict[str, int], tally: Tally) -> None:
    """Keep which file each complete run.json is: another one later means that it was done twice."""
    for name in names:
        path = out / name / "run.json"
        if (out / name / ".ready").exists() or not path.exists():
            continue
        try:
            mark = path.stat().st_mtime_ns
        except FileNotFoundError:
            continue
        if finished.setdefault(name, mark) != mark:
            tally.twice.append(f"{out.name}/{name}")
            finished[name] = mark


def children_of(pid: int) -> list[int]:
    try:
        found = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    except OSError:  # it has just ended
        return []
    return [int(child) for child in found]


def seconds_until_gone(pids: list[int]) -> float:
    begin = time.monotonic()
    while any(is_alive(pid) for pid in pids) and time.monotonic() - begin <= ORPHAN_S:
        time.sleep(POLL_S)
    return time.monotonic() - begin


def is_alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except FileNotFoundError:
        return False


def differences(expected: Path, found: Path, names: list[str]) -> list[str]:
    """Files of the jobs that are missing, too many or other."""
    different = []
    for name in names:
        one, other = files_of(expected / name), files_of(found / name)
        for file in sorted(one | other):
            both = [folder / name / file for folder in (expected, found)]
            if not all(path.exists() for path in both) or content(both[0]) != content(both[1]):
                different.append(f"{found.name}/{name}/{file}")
    return different


def files_of(folder: Path) -> set[str]:
    return {
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if path.is_file()
        and path.name not in NOT_COMPARED
        and "cache" not in path.relative_to(folder).parts
    }


def content(path: Path) -> Any:
    """Of archives the arrays, as their members hold times; of run.json what does not tell of this run."""
    if path.suffix == ".npz":
        with np.load(path) as arrays:
            return {name: arrays[name].tobytes() for name in arrays.files}
    if path.name == "run.json":
        record = json.loads(path.read_text())
        del record["seconds_by_stage"]
        return record
    return path.read_bytes()


if __name__ == "__main__":
    sys.exit(main())
