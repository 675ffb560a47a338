"""The figures and the page of `benchmarks/recordings`."""

from collections.abc import Sequence

from recordings.cases import CLOCKS, MOUNTS, NO_MOUNTS, OWN_UNITS, RIGHT_UNITS, UNITS, Case
from recordings.measure import ASKED, RIGHT, WRONG, Row

_HEAD = """# Recordings in other units, on mounts, by other clocks

From `python benchmarks/recordings run` and `python benchmarks/recordings page recordings.jsonl -o
docs/recordings.md`. Pieces of 32 frames of real, semi-real and synthetic scans (120 of those with a mount)
are changed as recordings that people have are, with poses as a tracker records them and depth that is a
little off. planfit is told nothing, and judges the recorded motion as `planfit refine --poses-convention
auto` does before anything is solved. *Right*: what was changed is undone, and nothing else; *asked*: the
run says what is open and what to give; *wrong*: neither. What is random follows from a case's name. Even
numbers, of the first frames of scans, are there to choose by; odd numbers, of the last frames, report.

Units are 1/1000, 1/5000, 1/4000, 1/6553.5 and 1/256 m, and of floating-point depth mm and feet; depth in
its right unit is up to 8 % off. Mounts are turned by up to 180 degrees, with an arm of up to 0.5 m; they
are right within 1 degree and 0.05 m, but for directions of the arm that turns of the walk do not tell.
Trajectories with another clock are files of poses at 10 to 100 Hz beside images at 30 Hz; they are right
where steps over a second are at most 1.5 times as far off as with clocks that agree, and 5 mm."""


def figures(cases: Sequence[Case], rows: Sequence[Row]) -> list[str]:
    """The table of shares, a line each."""
    of = {row.number: row for row in rows}
    lines = ["| group | half | cases | right | asked | of these right by plan | wrong |"]
    lines += ["| --- | --- | --- | --- | --- | --- | --- |"]
    for group in (UNITS, RIGHT_UNITS, OWN_UNITS, MOUNTS, NO_MOUNTS, CLOCKS):
        for half, is_last in (("even", False), ("odd", True)):
            own = [
                of[case.number]
                for case in cases
                if case.number in of and case.group == group and case.is_last == is_last
            ]
            counts = [sum(row.outcome == kind for row in own) for kind in (RIGHT, ASKED, WRONG)]
            by_plan = sum(row.by_plan == RIGHT for row in own)
            numbers = [len(own), counts[0], counts[1], by_plan, counts[2]]
            if own:
                lines.append(f"| {group} | {half} | " + " | ".join(map(str, numbers)) + " |")
    return lines


def make_page(cases: Sequence[Case], rows: Sequence[Row]) -> str:
    """The page as Markdown: figures, and each case that is not right."""
    other = ["| case | put in | found | |", "| --- | --- | --- | --- |"]
    for row in sorted(rows, key=lambda row: row.number):
        if row.outcome != RIGHT:
            found = (row.found or row.said)[:160].replace("|", "/")
            by_plan = f", by plan {row.by_plan}" if row.by_plan else ""
            other.append(f"| {row.name} | {row.put_in} | {found} | {row.outcome}{by_plan} |")
    versions = ", ".join(sorted({row.digest for row in rows}))
    measured = f"{len(rows)} of {len(cases)} cases, by versions of the code {versions}."
    parts = [_HEAD, measured, "\n".join(figures(cases, rows)), "## Not right", "\n".join(other)]
    return "\n\n".join(parts) + "\n"
