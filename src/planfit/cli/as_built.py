"""`planfit export --to as-built`: the walls of a run as built, as a table, drawing or issues."""

from pathlib import Path

from planfit.as_built import counted, counted_openings, read_as_built
from planfit.cli.console import out
from planfit.errors import OutputError, require
from planfit.export.as_built_files import AS_BUILT_WRITERS


def export_as_built(folder: Path, target: Path, tolerance_m: float | None) -> int:
    """Write, tell.

    Args:
        folder: of a run.
        target: file to write; its suffix tells the form.
        tolerance_m: of verdicts, if not that of the run.

    Raises:
        OutputError: the suffix is that of no form.
        OptionError: the tolerance is negative.
        ScanError: the folder has no verdicts.
    """
    write = AS_BUILT_WRITERS.get(target.suffix.lower())
    if write is None:
        raise OutputError(
            f"{target}: expected a file of {', '.join(AS_BUILT_WRITERS)}, found "
            f"{target.suffix or 'no suffix'}; choose one of these with -o"
        )
    require(
        tolerance_m is None or tolerance_m >= 0,
        f"tolerance-m: expected 0 or more, found {tolerance_m}",
    )
    as_built = read_as_built(folder)
    write(target, as_built, tolerance_m)
    counts = counted(as_built.verdicts(tolerance_m))
    words = ", ".join(f"{count} {verdict.value}" for verdict, count in counts.items() if count)
    if as_built.openings:
        counts = counted_openings(as_built.openings)
        listed = ", ".join(f"{count} {verdict.value}" for verdict, count in counts.items() if count)
        words += f"; openings: {listed}"
    out.print(f"written: {target}, {words}", soft_wrap=True)
    return 0
