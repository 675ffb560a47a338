"""The report on paper: Chromium prints it, as no library of ours lays out a page of HTML."""

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from planfit.errors import OutputError

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "msedge")
"""Names of Chromium and of browsers made of it, as they are looked for on PATH."""
MAX_PRINT_S = 180.0
"""A report with all pictures takes some seconds."""


def find_browser() -> str:
    """The first of `BROWSERS` on PATH.

    Raises:
        OutputError: there is none.
    """
    for name in BROWSERS:
        found = shutil.which(name)
        if found is not None:
            return found
    raise OutputError(
        f"PDF: expected Chromium on PATH ({', '.join(BROWSERS)}), found none; install it, or open the "
        "report in any browser and print it there"
    )


def print_page(page: Path, pdf: Path) -> None:
    """Print a page that needs nothing but its own file.

    Raises:
        OutputError: no browser is there, or it does not print.
    """
    browser = find_browser()
    # A profile of its own: one that is in use would open the page there, and print nothing.
    with tempfile.TemporaryDirectory(prefix="planfit-print-") as profile:
        command = [
            browser, "--headless", "--disable-gpu", "--no-first-run", "--disable-background-networking",
            "--disable-extensions", "--no-pdf-header-footer", f"--user-data-dir={profile}",
            f"--print-to-pdf={pdf.resolve()}",
        ]  # fmt: skip
        if hasattr(os, "geteuid") and os.geteuid() == 0:
            command.append(
                "--no-sandbox"
            )  # for root, as in a container, Chromium does not start with it
        try:
            done = subprocess.run(
                [*command, page.resolve().as_uri()],
                capture_output=True,
                text=True,
                errors="replace",
                timeout=MAX_PRINT_S,
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            raise OutputError(
                f"{page}: expected {browser} to print it within {MAX_PRINT_S:.0f} s, found it still at "
                "it; open the report and print it there"
            ) from error
        except OSError as error:
            raise OutputError(
                f"{browser}: expected a program that prints, found: {error}"
            ) from error
    if not _is_pdf(pdf):
        said = (done.stderr.strip().splitlines() or ["nothing"])[-1]
        raise OutputError(
            f"{page}: expected {browser} to print it, found that it said {said!r} (exit code "
            f"{done.returncode}); open the report and print it there"
        )


def _is_pdf(path: Path) -> bool:
    """Whether it is there, and whole as far as both ends tell."""
    if not path.is_file():
        return False
    content = path.read_bytes()
    return content.startswith(b"%PDF-") and b"%%EOF" in content[-1024:]
