"""The page of the battery, made of its measurements: every number in it is computed here."""

from collections.abc import Sequence

from faults.cases import Case
from faults.figures import (
    FaultRow,
    Figure,
    Result,
    fault_rows,
    make_figures,
    match_results,
    reliability_rows,
)
from faults.measure import CRASHED, Measured

_HEAD = """# Faulty scans, wrong plans

From `python benchmarks/faults run -o faults.jsonl` and
`python benchmarks/faults page faults.jsonl -o docs/faults.md`; both say more with `--help`. Each case is a
scan with a drift of its own and up to two faults: of tracking (jumps, lost tracking, more drift, delay, wrong
conventions), of the plan (walls missing, moved, added, another scale, another building), of the images. What
is random follows from the case's name. Scans: ConSLAM and the red kitchen of 7-Scenes, where they are at
hand, and ten synthetic ones. The kitchen's plan is drawn by hand.

Errors are RMS over all frames, in the plan's frame, without alignment to the truth; without a plan, after it.
*Faultless* is the same scan with the same drift and no fault; where that goes wrong by itself, twice the
median over the scan's drifts. Exit codes are those of `planfit refine`: 0 refined, 1 not vouched for,
2 refused."""

_FIGURES = """## What is asked

Thresholds may be chosen on cases of even number; those of odd number report.

*Silent wrong*: exit 0 with an error above 0.10 m and three times the faultless one, above that of the input,
or on a plan where the scan has no place. *Vouched for when right*: exit 0, of the results within 1.5 times
the faultless error."""


def make_page(cases: Sequence[Case], measured: Sequence[Measured]) -> str:
    """The page as Markdown."""
    results = match_results(cases, measured)
    parts = [_HEAD, _what_was_run(cases, results), _FIGURES, figures_table(results)]
    parts += [
        "## Fault by fault",
        "Medians and worst, m; both halves.",
        _fault_table(fault_rows(results)),
    ]
    if rows := reliability_rows(results):
        parts += ["## Predicted errors", "Both halves.", _reliability_table(rows)]
    parts += _lists(results)
    return "\n\n".join(parts) + "\n"


def _what_was_run(cases: Sequence[Case], results: Sequence[Result]) -> str:
    digests = {r.measured.digest for r in results}
    versions = "one version" if len(digests) < 2 else f"{len(digests)} versions of the code"
    hours = sum(r.measured.seconds for r in results) / 3600
    return (
        f"{len(results)} of {len(cases)} cases, {versions} (digest {', '.join(sorted(digests))}), "
        f"{hours:.1f} hours of one core."
    )


def figures_table(results: Sequence[Result]) -> str:
    """The figures, even and odd numbers apart."""
    even, odd = (
        make_figures([r for r in results if r.is_even == is_even]) for is_even in (True, False)
    )
    lines = [
        "| figure | asked | even numbers | cases | odd numbers | cases |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    lines += [
        f"| {a.name} | {a.asked} | {_found(a)} | {a.n} | {_found(b)} | {b.n} |"
        for a, b in zip(even, odd, strict=True)
    ]
    return "\n".join(lines)


def _found(figure: Figure) -> str:
    return figure.found if figure.n else "not measured"


def _fault_table(rows: Sequence[FaultRow]) -> str:
    lines = [
        "| fault | size | cases | before | faultless | median | worst | exit 0 | 1 | 2 | crash |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for row in rows:
        errors = (row.before_m, row.faultless_m, row.median_m, row.worst_m)
        cells = [row.faults, row.size, row.n, *(_metres(e) for e in errors), *row.exit_codes]
        lines.append(f"| {' | '.join(str(cell) for cell in cells)} |")
    return "\n".join(lines)


def _reliability_table(rows: Sequence) -> str:
    lines = [
        "| predicted, m | cases | median predicted, m | median error, m | frames within twice |",
        "| --- | --- | --- | --- | --- |",
    ]
    lines += [
        f"| {row.low_m:g} to {row.high_m:g} | {row.n} | {row.median_predicted_m:.3f} "
        f"| {row.median_error_m:.3f} | {row.within:.0%} |"
        for row in rows
    ]
    return "\n".join(lines)


def _lists(results: Sequence[Result]) -> list[str]:
    parts = []
    if wrong := [r for r in results if r.is_silent_wrong]:
        lines = [
            f"- {r.case.number}, {r.case.name}: {_metres(r.measured.before_m)} -> "
            f"{_metres(r.measured.error_m)} m (one frame by {_metres(r.measured.largest_m)} m), faultless "
            f"{_metres(r.faultless_m)} m"
            for r in wrong
        ]
        parts += ["## Silent wrong, case by case", "\n".join(lines)]
    if crashed := [r for r in results if r.measured.exit_code == CRASHED]:
        lines = [f"- {r.case.number}, {r.case.name}: {r.measured.said}" for r in crashed]
        parts += ["## Crashes", "\n".join(lines)]
    return parts


def _metres(value: float | None) -> str:
    if value is None:
        return ""
    return f"{value:.3f}" if value < 10 else f"{value:.1f}"
