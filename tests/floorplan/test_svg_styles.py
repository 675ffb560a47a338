"""What style sheets in SVG files say: of which elements, how wide, in what colour; else it is said."""

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from planfit.errors import FloorplanError
from planfit.floorplan import Floorplan, read_floorplan
from planfit.floorplan.formats.svg.css_values import length_px, plain_colour
from planfit.floorplan.formats.svg.styles import apply_styles

WALLS = [
    (60, 60, 700, 60), (700, 60, 700, 540), (700, 540, 60, 540), (60, 540, 60, 60),
    (400, 60, 400, 540), (60, 340, 700, 340),
]  # fmt: skip
LINES = "".join(
    f'<line class="wall outer" x1="{a}" y1="{b}" x2="{c}" y2="{d}"/>' for a, b, c, d in WALLS
)
BOXES = [(60, 60, 640, 480), (72, 72, 302, 256), (386, 72, 302, 256), (72, 340, 302, 188),
         (386, 340, 302, 188)]  # fmt: skip
RECTANGLES = "".join(f'<rect x="{x}" y="{y}" width="{w}" height="{h}"/>' for x, y, w, h in BOXES)


def read(tmp_path: Path, style: str, shapes: str) -> Floorplan:
    path = tmp_path / "plan.svg"
    path.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 800 600"><style>{style}</style>'
        f'<g class="floor" id="g1"><g class="walls">{shapes}</g></g></svg>'
    )
    return read_floorplan(path)


def assert_all_understood(plan: Floorplan) -> None:
    assert not any("not understood" in words for words in plan.source.warnings)


@pytest.mark.parametrize("width", [
    "6px", "calc(12px / 2)", "calc(2 * (1px + 2px))", "calc(100% - 701.1067811865px)", "min(6px, 5%)",
    "clamp(2px, 6px, 10px)", ".375rem", "1.5875mm", "6px !important", "calc(var(--w) * 2)",
])  # fmt: skip
def test_widths_of_strokes_are_computed(tmp_path: Path, width: str) -> None:
    plan = read(tmp_path, f"svg{{--w:3px}} line{{stroke:#222;stroke-width:{width}}}", LINES)
    assert plan.thickness == pytest.approx(6.0, abs=0.01)
    assert_all_understood(plan)


def test_percentages_are_of_the_diagonal_over_the_root_of_two(tmp_path: Path) -> None:
    plan = read(tmp_path, "line{stroke:#222;stroke-width:1%}", LINES)
    assert plan.thickness == pytest.approx(1000 / 2**0.5 / 100, abs=0.01)


@pytest.mark.parametrize("rules", [
    ".walls line{stroke:#222;stroke-width:6px}",
    "#g1 .walls > line{stroke:#222;stroke-width:6px}",
    "line.wall.outer{stroke:#222;stroke-width:6px}",
    "[class='wall outer']{stroke:#222;stroke-width:6px}",
    ".walls{line{stroke:#222;stroke-width:6px}}",
    ".wall{stroke-width:6px} line{stroke:#222;stroke-width:1px}",
    "line{stroke:#222;stroke-width:6px} @media print{line{stroke-width:1px}}",
    "line{stroke:#222} @media screen{line{stroke-width:6px}}",
    ".walls{stroke:#222;stroke-width:6px} line{stroke:inherit}",
    ".wall{stroke:#222;stroke-width:6px} .wall:hover{stroke-width:20px}",
    "#g1 > line, #g1 line{stroke:#222;stroke-width:6px} .floor > .wall{stroke-width:1px}",
    ".walls{line{stroke:#222;&amp;.wall{stroke-width:6px}}}",
    "line[class=',;}']{stroke-width:1px} line{stroke:#222;stroke-width:6px}",
    "line{stroke:#222;stroke-width:6px} /* } line{stroke-width:1px} */",
])  # fmt: skip
def test_rules_are_of_the_elements_that_they_select(tmp_path: Path, rules: str) -> None:
    plan = read(tmp_path, rules, LINES)
    assert plan.thickness == pytest.approx(6.0, abs=0.01)
    assert_all_understood(plan)


@pytest.mark.parametrize("fill", [
    "none", "NONE", "rgb(250 250 250)", "rgb(250 250 250 / 90%)", "url(#pale)", "url(#none) white",
])  # fmt: skip
def test_rooms_without_a_dark_fill_are_outlines(tmp_path: Path, fill: str) -> None:
    pale = '<linearGradient id="pale"><stop stop-color="#fff"/></linearGradient>'
    rules = f".walls rect{{fill:{fill};stroke:#222;stroke-width:1px}}"
    plan = read(tmp_path, rules, f"<defs>{pale}</defs>{RECTANGLES}")
    assert plan.thickness == pytest.approx(12.0, abs=0.01)
    assert plan.lengths.sum() == pytest.approx(6432.0, rel=1e-3)
    assert_all_understood(plan)


@pytest.mark.parametrize(("rules", "words"), [
    ("line{stroke:#222;stroke-width:.75vw}", "stroke-width '.75vw'"),
    ("line{stroke:lab(20% 0 0);stroke-width:6px}", "stroke 'lab(20% 0 0)', taken for black"),
    ("line{stroke:#222;stroke-width:6px} line:not(.wall){display:none}", "rule of 'line:not(.wall)'"),
    ("line{stroke:#222;stroke-width:6px} @import 'more.css';", "style sheet in another file"),
])  # fmt: skip
def test_what_is_not_understood_is_said(tmp_path: Path, rules: str, words: str) -> None:
    warnings = read(tmp_path, rules, LINES).source.warnings
    assert any(words in warning for warning in warnings)


@pytest.mark.parametrize(
    "text", ["2px * 3px", "1px / 0", "calc(", "min()", "6apples", "((((", "", "3px 4px"]
)
def test_lengths_that_are_none(text: str) -> None:
    assert length_px(text, 16.0, 100.0) is None


def test_colours_as_they_are_read() -> None:
    assert plain_colour("rgb(1 2 3 / 50%)", {}) == "#01020380"
    assert plain_colour("CurrentColor", {}) == "currentColor"
    assert plain_colour("oklch(0.97 0.01 90)", {}) is None
    assert plain_colour("rgb(none 2 3)", {}) is None


def test_sheets_of_many_rules_for_many_elements_are_refused(tmp_path: Path) -> None:
    """After 12 s on a slow machine; all pairs of them would take a quarter of an hour."""
    rules = "".join(f"g g g g g.a{k} *{{fill:red}}" for k in range(4000))
    with pytest.raises(FloorplanError, match="pairs of rules and elements"):
        read(tmp_path, rules, "<line/>" * 4000)


@pytest.mark.parametrize(
    "sheet", ["}", "{{{{", "a{b:c", "a>>b{fill:red}", "{fill:red}", "a,,b{fill:red}", "a{" * 3000]
)
def test_broken_sheets_are_read(sheet: str) -> None:
    data = f'<svg xmlns="http://www.w3.org/2000/svg"><style>{sheet}</style><line/></svg>'
    root = ET.fromstring(data.replace(">>", "&gt;&gt;"))
    apply_styles(root)
    assert root[1].tag.endswith("line")
