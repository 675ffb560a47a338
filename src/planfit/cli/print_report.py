"""`planfit export --to pdf`: the report of a run on paper."""

from pathlib import Path

from planfit.cli.console import out
from planfit.errors import OutputError, ScanError
from planfit.export.pdf import find_browser, print_page
from planfit.runtime import whole_file


def export_report(folder: Path, target: Path) -> int:
    """Print, tell.

    Args:
        folder: of a run.
        target: file to write.

    Raises:
        OutputError: the suffix is another, or no browser prints it.
        ScanError: the folder has no report.
    """
    if target.suffix.lower() != ".pdf":
        raise OutputError(
            f"{target}: expected a file of .pdf, found {target.suffix or 'no suffix'}; choose another "
            "name with -o"
        )
    page = folder / "report.html"
    if not page.is_file():
        raise ScanError(
            f"{folder}: expected the output folder of planfit refine with its report.html, found none; "
            "refine the scan first"
        )
    find_browser()  # before anything is written
    with whole_file(target) as part:
        print_page(page, part)
    out.print(f"written: {target}", soft_wrap=True)
    return 0
