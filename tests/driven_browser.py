"""Headless Chromium that a test presses; tests are skipped where there is none."""

from contextlib import contextmanager

import pytest
from chromium import BROWSER, DRIVER, driven_chromium, set_size

__all__ = ["driven_browser", "needs_browser", "set_size"]

needs_browser = pytest.mark.skipif(
    BROWSER is None or DRIVER is None, reason="no Chromium with its driver to open a page with"
)


@contextmanager
def driven_browser():
    """A driver of selenium; the test is skipped where there is none, or Chromium cannot be driven."""
    exceptions = pytest.importorskip(
        "selenium.common.exceptions", reason="no selenium to drive a browser with"
    )
    driving = driven_chromium("--force-prefers-reduced-motion")
    try:
        driver = driving.__enter__()
    except exceptions.WebDriverException as error:
        pytest.skip(f"Chromium cannot be driven here: {error.msg}")
    try:
        yield driver
    finally:
        driving.__exit__(None, None, None)
