"""All variants on all scans. What is already measured is not measured again."""

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from paper_tables.measure import MAP, Case, load_case, load_real_case, measure
from paper_tables.results import Measured, Results, read_results
from paper_tables.scans import BenchScan
from paper_tables.variants import DESCENT_VARIANTS, VARIANTS, Variant, setup_digest
from planfit.errors import OutputError
from planfit.runtime import Runtime


@dataclass(frozen=True)
class BenchOptions:
    """What is run, and where it is kept."""

    out: Path
    """JSON file of results; scans that it has are left as they are."""
    scans: tuple[BenchScan, ...]
    real: tuple[Path, ...] = ()
    """Folders of real scans with their plan and `groundtruth.tum`."""
    variants: tuple[Variant, ...] = VARIANTS
    descent: BenchScan | None = None
    """The scan that the paper's own descent is measured on; None: it is not."""


def run_bench(
    options: BenchOptions,
    planfit: str,
    conditions: str,
    runtime: Runtime,
    on_measured: Callable[[Measured], None],
) -> Results:
    """Measure what is not yet in the file, scan by scan; the file is written after each refinement.

    Args:
        options: what is run.
        planfit: version, for the record; results of another version are not added to.
        conditions: the machine, for the record.
        runtime: threads and progress; finished stages are kept in `OUT.cache` until their scan is done.
        on_measured: told of each result.

    Raises:
        OutputError: the file has results of another version, or of other defaults.
        ScanError: a real scan cannot be used.
    """
    setup = setup_digest(MAP)
    results = Results(planfit, conditions, (), setup)
    if options.out.exists():
        results = read_results(options.out)
        if results.setup != setup:
            raise OutputError(
                f"{options.out}: expected results of the options and maps of this planfit, found those of "
                "others (a default has changed since); choose another file with -o"
            )
        if results.planfit != planfit:
            raise OutputError(
                f"{options.out}: expected results of planfit {planfit}, found those of "
                f"{results.planfit}; choose another file with -o"
            )
    cache = options.out.with_name(options.out.name + ".cache")
    runtime = replace(runtime, cache_dir=cache)
    for name, load, variants in _loaders(options):
        missing = _missing(results, name, variants)
        if not missing:
            continue
        case = load(runtime)
        for variant in missing:
            measured = measure(case, variant, runtime)
            results = replace(results, measured=(*results.measured, measured))
            results.write(options.out)
            on_measured(measured)
        shutil.rmtree(cache, ignore_errors=True)
    return results


def _loaders(
    options: BenchOptions,
) -> list[tuple[str, Callable[[Runtime], Case], Sequence[Variant]]]:
    """Name of each scan, what loads it, and what is measured on it."""
    made: list[tuple[str, Callable[[Runtime], Case], Sequence[Variant]]] = [
        (scan.name, partial(load_case, scan), options.variants) for scan in options.scans
    ]
    made += [(path.name, partial(load_real_case, path), options.variants) for path in options.real]
    if options.descent is not None:
        scan = options.descent
        made.append((scan.name, partial(load_case, scan), DESCENT_VARIANTS))
    return made


def _missing(results: Results, scan: str, variants: Sequence[Variant]) -> list[Variant]:
    done = {m.variant for m in results.measured if m.scan == scan}
    return [variant for variant in variants if variant.key not in done]
