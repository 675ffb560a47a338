"""Mutants of every sample of every reader, each read in a process of its own batch, with limits of time and
memory; the outcomes go into a file of JSON lines, from which a later run goes on.

    python benchmarks/fuzz --minutes 2                  a short run
    python benchmarks/fuzz --mutants 100000 -o FILE     goes on until so many are in the file
    python benchmarks/fuzz --recheck --mutants 0 -o FILE    tries the findings of the file again
    python benchmarks/fuzz --show SAMPLE:NUMBER DIR     writes a mutant out, reads it, and shows the traceback

A mutant is made from the seed, the name of its sample and its number alone. The sample that took the least
time so far comes next, so that slow readers do not keep fast ones from being tried. Exit code 1 where
something was found.
"""

import argparse
import gc
import json
import os
import resource
import select
import signal
import subprocess
import sys
import tempfile
import time
import zlib
from collections import Counter, defaultdict
from pathlib import Path

import cv2
import numpy as np
from fuzz.mutations import mutated
from fuzz.reading import GOOD, READERS, Outcome, outcome_of
from fuzz.samples import Sample, all_samples

MAX_SECONDS = 20.0
BATCH = 100
"""Mutants that one process reads, unless it ends before: what a library spoils in itself ends with it."""
ADDRESS_SPACE = 3 * 2**30
"""Beyond what the process has: twice of what libraries ask for is never touched."""
KINDS = (*GOOD, "traceback", "many lines", "non-finite", "memory", "hang", "crash")


def mutant(sample: Sample, number: int, seed: int) -> dict[str, bytes | None]:
    """Files of a mutant that differ from the sample's; number 0 is the sample itself."""
    if number == 0:
        return {}
    rng = np.random.default_rng([seed, zlib.crc32(sample.name.encode()), number])
    return mutated(sample.files, rng)


def put(folder: Path, files: dict[str, bytes | None]) -> None:
    for name, data in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if data is None:
            path.unlink(missing_ok=True)
        else:
            path.write_bytes(data)


def read_batch(sample: Sample, numbers: range, seed: int, channel: int) -> None:
    """In a process of its own: read mutants one after the other, and tell each."""
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + ADDRESS_SPACE, used + ADDRESS_SPACE))
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)  # libraries written in C print what they think of a file
    os.dup2(silence, 2)
    room = "/dev/shm" if Path("/dev/shm").is_dir() else None
    with tempfile.TemporaryDirectory(prefix="planfit-fuzz-", dir=room) as scratch:
        folder = Path(scratch)
        put(folder, {**sample.files})
        for number in numbers:
            changed = mutant(sample, number, seed)
            put(folder, changed)
            os.write(channel, (outcome_of(sample, number, folder).as_line() + "\n").encode())
            put(folder, {name: sample.files[name] for name in changed})


def cpu_seconds(child: int) -> float:
    """What a process has used so far, of itself and of the system."""
    fields = Path(f"/proc/{child}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def is_over(child: int, used: float, begin: float) -> bool:
    """Whether a mutant took too long: by its own time, as a machine that others use as well may be slow; or
    by the clock, five times as long, as one that waits for ever uses none."""
    on_its_own = cpu_seconds(child) - used
    return on_its_own > MAX_SECONDS or time.perf_counter() - begin > 5 * MAX_SECONDS


def run_batch(sample: Sample, numbers: range, seed: int) -> list[Outcome]:
    """Outcomes of some mutants; a process that hangs or dies is the fault of the one it was at."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        try:
            read_batch(sample, numbers, seed, writing)
        finally:
            os._exit(0)
    os.close(writing)
    outcomes, rest = [], b""
    why, begin, used = "crash", time.perf_counter(), cpu_seconds(child)
    while len(outcomes) < len(numbers):
        ready, _, _ = select.select([reading], [], [], 1.0)
        if not ready and not is_over(child, used, begin):
            continue
        data = os.read(reading, 1 << 16) if ready else b""
        if not data:
            why = "crash" if ready else "hang"
            break
        *lines, rest = (rest + data).split(b"\n")
        outcomes += [Outcome(**json.loads(line)) for line in lines]
        begin, used = time.perf_counter(), cpu_seconds(child)
    if len(outcomes) < len(numbers):
        os.kill(child, signal.SIGKILL)
    status = os.waitpid(child, 0)[1]
    os.close(reading)
    if len(outcomes) < len(numbers):
        seconds = round(time.perf_counter() - begin, 3)
        where = f"more than {MAX_SECONDS:g} s" if why == "hang" else f"status {status}"
        outcomes.append(Outcome(sample.name, numbers[len(outcomes)], why, seconds, where))
    if outcomes[-1].kind == "hang":
        outcomes[-1] = in_new_interpreter(outcomes[-1], seed)
    return outcomes


def in_new_interpreter(hung: Outcome, seed: int) -> Outcome:
    """A mutant at which a forked process hung, read once more by a new interpreter, as a user's would be:
    locks and threads of libraries that did not come along in a fork are no fault of the reader."""
    one = ["--seed", str(seed), "--one", f"{hung.sample}:{hung.number}"]
    program = str(Path(__file__).with_name("__main__.py"))
    try:
        done = subprocess.run(
            [sys.executable, program, *one],
            capture_output=True,
            timeout=5 * MAX_SECONDS,
            check=True,
        )
    except subprocess.SubprocessError:
        return hung
    return Outcome(**json.loads(done.stdout.splitlines()[-1]))


def fuzz(samples: list[Sample], options: argparse.Namespace, out: Path) -> list[Outcome]:
    """Go on until so many mutants are in the file, or the time is over."""
    outcomes = read_outcomes(out)
    if options.recheck:
        outcomes = rechecked(samples, outcomes, options.seed)
        out.write_text("".join(f"{each.as_line()}\n" for each in outcomes))
    n_done: Counter[str] = Counter(each.sample for each in outcomes)
    seconds: Counter[str] = Counter()
    for each in outcomes:
        seconds[each.sample] += each.seconds
    end, warm = time.monotonic() + 60 * options.minutes, set[str]()
    with out.open("a") as file:
        while time.monotonic() < end and len(outcomes) < options.mutants:
            sample = min(samples, key=lambda s: (seconds[s.name], s.name))
            first, begin = n_done[sample.name], time.perf_counter()
            n = 10 if first == 0 else BATCH  # all once before any for long
            if sample.name not in warm:
                warm_up(sample)
                warm.add(sample.name)
            found = run_batch(sample, range(first, first + n), options.seed)
            file.writelines(f"{each.as_line()}\n" for each in found)
            file.flush()
            outcomes += found
            n_done[sample.name] += len(found)
            seconds[sample.name] += time.perf_counter() - begin
    return outcomes


def warm_up(sample: Sample) -> None:
    """Import what the reader of a sample imports, and load its compiled loops, before processes are forked:
    each would do so again, for seconds."""
    if sample.name.startswith("bad-"):
        return
    cv2.setNumThreads(0)  # a pool of threads does not survive a fork
    with tempfile.TemporaryDirectory(prefix="planfit-fuzz-") as scratch:
        put(Path(scratch), {**sample.files})
        outcome_of(sample, 0, Path(scratch))
    # A decoder of a video that is freed in a forked process waits for threads which stayed behind, for ever:
    # what is garbage goes now, and what is not is never looked at there.
    gc.collect()
    gc.freeze()


def rechecked(samples: list[Sample], outcomes: list[Outcome], seed: int) -> list[Outcome]:
    """The outcomes, each finding among them tried again in a process of its own."""
    named = {sample.name: sample for sample in samples}
    for sample in samples:
        if any(each.sample == sample.name and each.kind not in GOOD for each in outcomes):
            warm_up(sample)
    return [
        each
        if each.kind in GOOD or each.sample not in named
        else run_batch(named[each.sample], range(each.number, each.number + 1), seed)[0]
        for each in outcomes
    ]


def read_outcomes(path: Path) -> list[Outcome]:
    """Those of runs before; a line that a stopped run left half is none."""
    if not path.exists():
        return []
    whole = [line for line in path.read_text().splitlines() if line.endswith("}")]
    return [Outcome(**json.loads(line)) for line in whole]


def summary(outcomes: list[Outcome]) -> str:
    """A table by sample, and each distinct finding with how to see it again."""
    by_sample: dict[str, list[Outcome]] = defaultdict(list)
    for each in outcomes:
        by_sample[each.sample].append(each)
    head = f"| sample | mutants | {' | '.join(KINDS)} | slowest, s |"
    lines = [head, f"|{' --- |' * (len(KINDS) + 3)}"]
    for name, group in [*sorted(by_sample.items()), ("all", outcomes)]:
        count = Counter(each.kind for each in group)
        cells = " | ".join(str(count[kind]) for kind in KINDS)
        slowest = max((each.seconds for each in group), default=0.0)
        lines.append(f"| {name} | {len(group)} | {cells} | {slowest:.1f} |")
    findings: dict[str, list[Outcome]] = defaultdict(list)
    for each in outcomes:
        if each.kind not in GOOD:
            findings[f"{each.kind}: {each.where.split(': ')[0]}"].append(each)
    lines += ["", f"{len(findings)} distinct findings"]
    for words, group in sorted(findings.items(), key=lambda pair: -len(pair[1])):
        first = group[0]
        lines.append(f"- {len(group)} x {words}; {first.sample}:{first.number} ({first.where})")
    return "\n".join(lines)


def written(samples: list[Sample], name: str, folder: Path, seed: int) -> tuple[Sample, int]:
    """Write a mutant, named by its sample and its number, into a folder."""
    sample_name, number = name.rsplit(":", 1)
    sample = next(each for each in samples if each.name == sample_name)
    put(folder, {**sample.files})
    put(folder, mutant(sample, int(number), seed))
    return sample, int(number)


def show(samples: list[Sample], name: str, folder: Path, seed: int) -> None:
    """Write a mutant out and read it in this process, with its traceback."""
    sample, _ = written(samples, name, folder, seed)
    print(f"written: {folder / sample.entry}")
    print(READERS[sample.kind](folder / sample.entry) or "read")


def one_outcome(samples: list[Sample], name: str, folder: Path, seed: int) -> Outcome:
    """Read a mutant in this process."""
    sample, number = written(samples, name, folder, seed)
    return outcome_of(sample, number, folder)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("-o", "--out", type=Path, help="file of outcomes; without, a temporary one")
    parser.add_argument("--minutes", type=float, default=float("inf"))
    parser.add_argument("--mutants", type=int, default=10**9)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--recheck", action="store_true", help="try findings of the file again")
    parser.add_argument("--only", default="", help="samples whose names hold this")
    parser.add_argument("--show", nargs=2, metavar=("SAMPLE:NUMBER", "DIR"))
    parser.add_argument("--one", metavar="SAMPLE:NUMBER", help="print the outcome of one mutant")
    options = parser.parse_args()
    if (
        options.minutes == float("inf")
        and options.mutants == 10**9
        and not (options.show or options.one)
    ):
        parser.error("expected --minutes or --mutants, found neither")
    with tempfile.TemporaryDirectory(prefix="planfit-fuzz-") as scratch:
        samples = [s for s in all_samples(Path(scratch)) if options.only in s.name]
        print(f"{len(samples)} samples")
        if options.show:
            show(samples, options.show[0], Path(options.show[1]), options.seed)
            return 0
        if options.one:
            print(one_outcome(samples, options.one, Path(scratch) / "one", options.seed).as_line())
            return 0
        outcomes = fuzz(samples, options, options.out or Path(scratch) / "outcomes.jsonl")
    print(summary(outcomes))
    spoiled_samples = [each for each in outcomes if each.number == 0 and each.kind != "read"]
    for each in spoiled_samples:
        if not each.sample.startswith(("bad-", "real-")):
            print(f"!! the sample itself is not read: {each}")
    return int(any(each.kind not in GOOD for each in outcomes))
