"""Lengths in words, in metres and in feet."""

import re

import numpy as np
import pytest

from planfit.cli import run
from planfit.findings import ResultKind
from planfit.findings.finding import Finding, finding_record
from planfit.floorplan import Floorplan, read_floorplan, write_floorplan_json
from planfit.report.formatting import SPACE, centimetres, length
from planfit.units import in_units, told_in

INCHES = re.compile(
    r"(?P<sign>[+-]?)(?:(?P<ft>[\d,]+) ft)? ?(?:(?P<in>[\d.]+(?: \d/8| \d/4| \d/2)?|\d/\d) in)?"
)


def metres(words: str) -> float:
    """What words in feet and inches say."""
    found = INCHES.fullmatch(words)
    assert found, words
    parts = (found["in"] or "0").split()
    inches = sum(int(a) / int(b) for a, _, b in (p.partition("/") for p in parts if "/" in p))
    inches += sum(float(p) for p in parts if "/" not in p)
    feet = float((found["ft"] or "0").replace(",", ""))
    return (-1 if found["sign"] == "-" else 1) * (12 * feet + inches) * 0.0254


@told_in("ft")
def test_feet_say_the_same_length_as_finely_as_a_tape() -> None:
    rng = np.random.default_rng(0)
    for value in [
        *rng.uniform(-30, 30, 300),
        *rng.uniform(-0.31, 0.31, 300),
        0.3048,
        0.3047,
        3.6575,
    ]:
        told = in_units(value)
        finest = 0.0254 / 16 if abs(value) >= 0.3 else 0.0254 / 20
        assert metres(told) == pytest.approx(value, abs=finest + 1e-9), told
        assert not re.search(r"\b12(\.0)? ?\d?/?\d? in", told), told  # a foot is no twelve inches
    assert in_units(0.073, "+.2f").startswith("+")
    assert in_units(62.5).endswith(" ft")
    assert in_units(float("inf")) == "inf m"
    assert length(-0.0254).replace(SPACE, " ") == "\u22121.0 in"
    assert centimetres(0.0254, signed=True).replace(SPACE, " ") == "+1.0 in"


def test_a_finding_is_told_in_what_is_asked_for_and_recorded_in_metres() -> None:
    facts = {"before_m": 0.1, "after_m": 0.2}
    finding = Finding(ResultKind.REVISITS_CAME_APART, facts)
    metric = finding.words
    assert "from 0.100 to 0.200 m" in metric
    with told_in("ft"):
        assert "from 3.9 in to 7.9 in" in finding.words
    assert finding_record(finding)["words"] == metric


def test_units_of_a_command(tmp_path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = tmp_path / "plan.json"
    square = np.array([[0, 0], [6.096, 0], [6.096, 3.048], [0, 3.048], [0, 0]])
    write_floorplan_json(plan, Floorplan.from_segments(np.stack([square[:-1], square[1:]], axis=1)))
    assert run(["plan", str(plan), "--units", "ft"]) == 0
    assert "20 ft x 10 ft" in capsys.readouterr().out
    assert run(["plan", str(plan), "--units=m"]) == 0
    assert "6.096 x 3.048 m" in capsys.readouterr().out
    for words in (["--units"], ["--units", "yd"]):
        assert run(["plan", str(plan), *words]) == 2
        assert "expected one of m, ft" in capsys.readouterr().err
    copy = tmp_path / "copy.json"
    assert run(["plan", str(plan), "--units", "ft", "-o", str(copy)]) == 0
    assert np.allclose(read_floorplan(copy).ends.max(), 6.096)
