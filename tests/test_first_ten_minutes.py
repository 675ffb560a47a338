"""The page of the first ten minutes shows what planfit prints."""

from pathlib import Path

import pytest

from walk import COMMAND, PAGE, walked, words_of


@pytest.mark.slow
def test_commands_of_the_first_ten_minutes_print_what_the_page_shows(tmp_path: Path) -> None:
    page = PAGE.read_text("utf-8")
    assert len(COMMAND.findall(page)) == page.count("    $ planfit ") >= 10
    assert words_of(walked(page, tmp_path)) == words_of(page), "if it is meant: python docs/walk.py"


def test_words_are_compared_without_numbers_and_stages() -> None:
    one = "    $ planfit refine  # 3 s\n    9.1 s: read 2.8, tracking 1.0,\n    other 0.1\n    ends at 0.02 m"
    other = "    $ planfit refine  # 41 s\n    2.1 s: read 1.1, other 1.0\n    ends  at 0.31 m"
    assert words_of(one) == words_of(other)
    assert words_of(one) != words_of(other.replace("ends", "begins"))
