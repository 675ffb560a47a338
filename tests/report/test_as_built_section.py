"""Walls as built in the report: words, map and table; in a browser, the tolerance that is chosen there."""

from dataclasses import replace

import numpy as np
import pytest

from browser_probe import BROWSER, found_in
from planfit.as_built import AsBuilt, AsBuiltOpening, AsBuiltOptions, AsBuiltWall, Verdict
from planfit.report.html.page import make_report
from test_report import floorplan as floorplan  # a fixture
from test_report import make_result, read

NAN = float("nan")


def wall(face, y, offset_m=NAN, sigma_m=NAN, through=0.0):
    """Along x, seen from below."""
    ends = np.array([[5.0, y], [1.0, y]])
    n = 0 if np.isnan(offset_m) else 7
    return AsBuiltWall(face, ends, np.array([0.0, -1.0]), True, offset_m, sigma_m, n, n, through)


def made(tolerance_m=0.05):
    walls = (
        wall(0, 0.0, 0.01, 0.004),
        wall(1, 1.0, -0.08, 0.01),
        wall(2, 2.0, through=0.8),
        wall(3, 3.0),
        wall(-1, 4.0, 0.0, 0.02),
        wall(4, 900.0),  # where the scan does not come
    )
    return AsBuilt(walls, AsBuiltOptions(tolerance_m=tolerance_m), "plan")


def report_with(floorplan, as_built):
    return make_report("scan", floorplan, make_result(), "", as_built=as_built)


def test_every_verdict_is_told_where_the_scan_was(floorplan):
    page = report_with(floorplan, made())
    assert "1 agrees, 1 moved, 1 missing, 1 not seen, 1 new" in page
    for verdict in Verdict:
        style = f"as-built-{verdict.value.replace(' ', '-')}"
        # A row of the table, but where there is nothing to say, and a line of the map.
        assert (f'<tr class="{style}' in page) == (verdict is not Verdict.NOT_SEEN)
        assert f'<g class="{style}"' in page
    assert "Of 16 m of" in page  # four faces of 4 m
    assert "12 m were seen" in page
    assert page.count("<g class=") == 5
    assert "3 walls are not as planned" in page.replace("\n", " ")
    assert "6: " not in page  # a wall far away is in the files alone


def test_without_verdicts_there_is_no_section(floorplan):
    assert "As built against" not in read(floorplan, make_result()).words


def test_the_map_shows_where_a_moved_wall_stands(floorplan):
    """The map looks from above: y of the drawing goes down."""
    page = report_with(floorplan, made())
    group = page[page.index('<g class="as-built-moved"') :].split("</g>")[0]
    drawn, stands = (part.split("/>")[0] for part in group.split("<line ")[1:])
    y = [float(part.split('y1="')[1].split('"')[0]) for part in (drawn, stands)]
    # By -0.08 m along a normal that looks to -y: towards +y, up.
    assert y[1] - y[0] == pytest.approx(-0.08, abs=1e-3)
    assert "moved by 0.080 m" in group


def door(is_drawn, at, open_share, closed_share, edges=(NAN, NAN)):
    """Of 1 m, in a wall along y."""
    ends = np.array([[at, 1.0], [at, 2.0]])
    sigmas = (0.03, 0.04) if np.isfinite(edges[0]) else (NAN, NAN)
    return AsBuiltOpening(
        is_drawn, ends, np.array([1.0, 0.0]), 0.2, open_share, closed_share, 5, 5, edges, sigmas
    )


def test_openings_are_on_the_map_and_in_a_table_of_their_own(floorplan):
    openings = (
        door(True, 1.0, 1.0, 0.0, (0.1, 0.95)),
        door(True, 2.0, 0.0, 1.0),
        door(True, 3.0, 0.0, 0.0),
        door(False, 4.0, 0.9, 0.0, (0.0, 1.0)),
        door(True, 900.0, 1.0, 0.0),  # where the scan does not come
    )
    page = report_with(floorplan, replace(made(), openings=openings))
    assert "1 open, 1 closed, 1 not seen, 1 new" in page.replace("\n", " ")
    section = page[page.index('<section class="openings">') :].split("</section>")[0]
    rows = section.split("<tr")[2:]
    assert [row.split('class="')[1].split('"')[0] for row in rows] == [
        "opening opening-open as-planned",
        "opening opening-closed",
        "opening opening-not-seen as-planned",
        "opening opening-new",
    ]
    assert "0.850" in rows[0]
    assert "+2.5" in rows[0]  # the middle, from 0.5 to 0.525
    assert page.count('<g class="opening ') == 4
    # The counts of walls are of walls alone, also when the page counts anew.
    assert "1 agrees, 1 moved, 1 missing, 1 not seen, 1 new" in page
    assert "openings" not in page[page.index('<section class="as-built">') :].split("</section>")[0]
    assert '<section class="openings">' not in report_with(floorplan, made())


PROBE = """
<script>
addEventListener("load", () => {
  const page = document.querySelector("iframe").contentDocument;
  const section = page.querySelector("section.as-built");
  const input = section.querySelector(".as-built-tolerance");
  const look = (value) => {
    if (value !== null) { input.value = value; input.dispatchEvent(new Event("input")); }
    const row = section.querySelector("tr[data-number='2']"), line = section.querySelectorAll("g")[1];
    const stands = line.querySelector(".stands");
    return {
      words: section.querySelector(".as-built-counts").textContent,
      verdict: row.cells[1].textContent, key: row.cells[1].dataset.key, row: row.className,
      color: page.defaultView.getComputedStyle(line.querySelector(".drawn")).stroke,
      stands: page.defaultView.getComputedStyle(stands).display,
    };
  };
  const found = {first: look(null), wide: look("0.1"), close: look("0.075"), none: look(""),
                 width: page.documentElement.scrollWidth};
  document.title = "FOUND" + JSON.stringify(found);
});
</script>
"""


@pytest.mark.skipif(BROWSER is None, reason="no Chromium to open the report with")
def test_the_tolerance_is_chosen_on_the_page(tmp_path, floorplan):
    found = found_in(tmp_path / "probe.html", report_with(floorplan, made()), 390, PROBE)
    assert found["width"] <= 390
    first, wide, close = found["first"], found["wide"], found["close"]
    assert first["words"] == "1 agrees, 1 moved, 1 missing, 1 not seen, 1 new"
    assert (first["verdict"], first["stands"]) == ("moved", "inline")
    assert "unsure" not in first["row"]
    assert wide["words"] == "2 agrees, 0 moved, 1 missing, 1 not seen, 1 new"
    assert (wide["verdict"], wide["key"], wide["stands"]) == ("agrees", "agrees", "none")
    assert wide["color"] != first["color"]
    assert (close["verdict"], "unsure" in close["row"]) == ("moved", True)
    assert found["none"] == close  # an empty box changes nothing
