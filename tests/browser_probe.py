"""A page opened in headless Chromium, in a frame of some width, and what a script found there."""

import html
import json
import re
import shutil
import subprocess

BROWSER = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)


def found_in(page, text, width_px, probe):
    """What `probe`, a script, says of a page with this text; it leaves "FOUND" and JSON in its own title.

    `page` (a path) is written, so that links of the text begin at its folder.
    """
    page.write_text(
        "<!DOCTYPE html><meta charset=utf-8><title>-</title>"
        f'<iframe style="width:{width_px}px;height:800px;border:0" srcdoc="{html.escape(text)}">'
        f"</iframe>{probe}",
        encoding="utf-8",
    )
    shown = _run(page, "--virtual-time-budget=20000", "--dump-dom")
    title = re.search(r"<title>FOUND(.*?)</title>", shown, re.S)
    assert title, shown[-2000:]
    return json.loads(html.unescape(title[1]))


def printed(page, text):
    """The PDF that Chromium makes of a page with this text; `page` (a path) is written."""
    page.write_text(text, encoding="utf-8")
    pdf = page.with_suffix(".pdf")
    _run(page, "--no-pdf-header-footer", f"--print-to-pdf={pdf}")
    return pdf


def _run(page, *flags):
    """What Chromium prints of a page (a path)."""
    command = [
        BROWSER, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={page.parent / 'profile'}",
        *flags, page.as_uri(),
    ]  # fmt: skip
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout
