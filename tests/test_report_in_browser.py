"""The report in a real browser: nothing overflows on a phone, no words of a picture are cut or covered, heads
sort, nothing is fetched, all can use it; on paper it is a short document."""

import base64
import re
from importlib import resources

import numpy as np
import pypdfium2
import pytest

from browser_probe import BROWSER, found_in, printed
from driven_browser import driven_browser, needs_browser, set_size
from planfit import __version__
from planfit.as_built import AsBuilt, AsBuiltOptions, AsBuiltWall
from planfit.report.html.page import Provenance, make_report
from planfit.report.html.tables import captioned
from planfit.report.plots.drawing import PANEL_PT, Drawing
from planfit.units import in_units, told_in
from test_report import floorplan as floorplan  # a fixture
from test_report import make_result

pytestmark = pytest.mark.skipif(BROWSER is None, reason="no Chromium to open the report with")

PROBE = """
<script>
addEventListener("load", () => {
  const frame = document.querySelector("iframe"), page = frame.contentDocument;
  const found = {words: page.body.innerText.trim().split(/\\s+/).length};
  for (const section of page.querySelectorAll("details.section")) section.open = true;
  found.all_words = page.body.innerText.trim().split(/\\s+/).length;
  const rows = () => [...page.querySelectorAll("table.sortable tbody tr")];
  const numbers = () => rows().map((r) => r.cells[2].textContent);
  const head = page.querySelectorAll("table.sortable th")[2];
  found.before = numbers();
  head.querySelector("button").click(); found.up = numbers();
  head.querySelector("button").click(); found.down = numbers();
  found.width = page.documentElement.scrollWidth;
  found.pictures = page.querySelectorAll(".plot svg").length;
  const gap = (a, b) => Math.max(a.left - b.right, b.left - a.right, a.top - b.bottom, b.top - a.bottom);
  found.cut = []; found.covered = [];
  for (const picture of page.querySelectorAll(".plot svg")) {
    const rim = picture.getBoundingClientRect();
    const texts = [...picture.querySelectorAll("text")];
    const words = texts.map((t) => [t.textContent, t.getBoundingClientRect()]);
    for (const [text, box] of words)
      if (box.left < rim.left || box.right > rim.right || box.top < rim.top || box.bottom > rim.bottom)
        found.cut.push(text);
    words.forEach(([text, box], k) => words.slice(0, k).forEach(([other, its]) => {
      if (gap(box, its) < -0.2 * Math.min(box.height, its.height)) found.covered.push([text, other]);
    }));
  }
  document.title = "FOUND" + JSON.stringify(found);
});
</script>
"""


def report_of(floorplan, offsets_m, made=None):
    """With a verdict on each of its four walls."""
    walls = zip(floorplan.ends, floorplan.normals, offsets_m, strict=True)
    judged = tuple(
        AsBuiltWall(k, ends, normal, True, offset_m, 0.005, 3, 3, 0.0)
        for k, (ends, normal, offset_m) in enumerate(walls)
    )
    as_built = AsBuilt(judged, AsBuiltOptions(), "plan")
    result = make_result(12, offsets_m)
    return make_report("scan", floorplan, result, "[a]\nb = 1\n", as_built=as_built, made=made)


@pytest.mark.parametrize("width_px", [360, 1200])
def test_report_fits_sorts_and_shows_its_pictures(tmp_path, floorplan, width_px):
    report = report_of(floorplan, (0.01, 0.07, -0.12, 0.0))
    found = found_in(tmp_path / "probe.html", report, width_px, PROBE)
    assert found["width"] <= width_px
    assert found["pictures"] == 11
    assert found["words"] <= 900 < found["all_words"]
    assert found["cut"] == []
    assert found["covered"] == []

    def offsets(cells):
        return [float(c.split()[0].replace("\u2212", "-")) for c in cells]

    assert offsets(found["before"]) != sorted(offsets(found["before"]))
    assert offsets(found["up"]) == sorted(offsets(found["before"]))
    assert offsets(found["down"]) == sorted(offsets(found["before"]), reverse=True)


def test_on_paper_it_has_few_pages_and_names_the_walls_that_are_off(tmp_path, floorplan):
    report = report_of(floorplan, (0.01, 0.07, -0.12, 0.0))
    pages = pypdfium2.PdfDocument(printed(tmp_path / "report.html", report))
    texts = [page.get_textpage().get_text_range() for page in pages]
    assert len(pages) <= 8
    assert all(text.strip() for text in texts)
    words = " ".join(texts)
    words = words.replace("\u00a0", " ").replace("\u2212", "-")
    assert "-12.0 cm" in words  # of a section that is folded on the screen
    assert "+7.0 cm" in words
    assert "+1.0" in report
    assert "+1.0" not in words  # a wall that agrees
    assert "Options of this run" not in words  # closed, and no use on paper
    assert "No. verdict offset" in " ".join(words.split())
    # What is compared stands on one page.
    for text in texts:
        assert text.count("after:") == text.count("before:")


def test_on_paper_sections_are_seen_where_scripts_may_not_run(tmp_path, floorplan):
    report = report_of(floorplan, (0.01, 0.07, -0.12, 0.0))
    report = re.sub("<script.*?</script>", "", report, flags=re.S)
    pages = pypdfium2.PdfDocument(printed(tmp_path / "report.html", report))
    words = " ".join(page.get_textpage().get_text_range() for page in pages)
    assert "12.0" in words.replace("\u00a0", " ")
    assert "Misfit, weighted by how sure each observation is" in " ".join(words.split())


def test_on_paper_a_table_of_walls_that_all_agree_is_left_out(tmp_path, floorplan):
    report = report_of(floorplan, (0.01, 0.0, -0.01, 0.0))
    pages = pypdfium2.PdfDocument(printed(tmp_path / "report.html", report))
    words = " ".join(" ".join(page.get_textpage().get_text_range() for page in pages).split())
    assert "On paper, only walls that are not as drawn are listed." in words
    assert "No. verdict offset" not in words


MADE = Provenance(
    "2026-01-02 03:04:05 +0000", "planfit refine", {"planfit": "1"}, {"plan.dxf": "0123abcd" * 8}
)


@needs_browser
@pytest.mark.parametrize(("size", "size_pt"), [("A4", (595, 842)), ("letter", (612, 792))])
def test_on_paper_it_is_a_document_with_nothing_cut_off(tmp_path, floorplan, size, size_pt):
    page = tmp_path / "report.html"
    report = report_of(floorplan, (0.01, 0.07, -0.12, 0.0), MADE)
    page.write_text(report.replace("@page {", f"@page {{ size: {size};"), encoding="utf-8")
    with driven_browser() as driver:
        is_dark = {"name": "prefers-color-scheme", "value": "dark"}
        driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [is_dark]})
        driver.get(page.as_uri())
        how = {"preferCSSPageSize": True, "printBackground": True}
        data = driver.execute_cdp_cmd("Page.printToPDF", how)["data"]
    pages = pypdfium2.PdfDocument(base64.b64decode(data))
    texts = [page.get_textpage() for page in pages]
    words = [" ".join(text.get_text_range().split()) for text in texts]
    for told in ("Project scan", MADE.at, "0123abcd" * 8, f"planfit {__version__}"):
        assert told in words[0]
    assert "Checked by Date Signature" in words[-1]
    margin_pt = 12 / 25.4 * 72
    for number, (page, text) in enumerate(zip(pages, texts, strict=True), start=1):
        assert f"{number} of {len(pages)}" in words[number - 1]
        assert page.get_size() == pytest.approx(size_pt, abs=1)
        boxes = np.array([text.get_rect(k) for k in range(text.count_rects())])
        assert boxes[:, 0].min() > margin_pt
        assert boxes[:, 2].max() < size_pt[0] - margin_pt
        assert np.asarray(page.render().to_pil())[:20, :20].min() == 255  # white paper


@needs_browser
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size_px", [(1400, 900), (400, 800)])
def test_axe_finds_nothing(tmp_path, floorplan, size_px, scheme):
    axe = pytest.importorskip("axe_core_python", reason="no axe-core (axe-core-python)")
    page = tmp_path / "report.html"
    page.write_text(report_of(floorplan, (0.01, 0.07, -0.12, 0.0), MADE), encoding="utf-8")
    with driven_browser() as driver:
        set_size(driver, *size_px)
        feature = {"name": "prefers-color-scheme", "value": scheme}
        driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [feature]})
        driver.get(page.as_uri())
        driver.execute_script(
            "document.querySelectorAll('details').forEach((d) => (d.open = true))"
        )
        driver.execute_script(resources.files(axe).joinpath("axe.min.js").read_text("utf-8"))
        driver.set_script_timeout(120)
        found = driver.execute_async_script(
            "axe.run().then(({ violations }) => arguments[0](violations))"
        )
        width_px = driver.execute_script("return document.documentElement.scrollWidth")
    assert [(one["id"], [node["html"] for node in one["nodes"]]) for one in found] == []
    assert width_px <= size_px[0]


def test_wide_pictures_are_scrolled_by_the_keyboard_too():
    """On a phone they are wider than the page (axe: scrollable-region-focusable)."""
    wide, narrow = (captioned(Drawing(w, 100), "", "alt") for w in (2 * PANEL_PT, PANEL_PT))
    assert 'class="plot wide" tabindex="0"' in wide
    assert "tabindex" not in narrow


@needs_browser
def test_the_page_tells_lengths_in_the_words_of_python(floorplan, tmp_path):
    lengths_m = [0.0, 0.002, 0.0253, 0.303, 0.304, -0.3048, 2.2876, 30.47, 30.4801, 400.0]
    lengths_m += np.random.default_rng(4).uniform(-40, 40, 60).tolist()
    with driven_browser() as driver:
        for units in ("m", "ft"):
            page = tmp_path / f"{units}.html"
            with told_in(units):
                page.write_text(report_of(floorplan, (0.01, 0.07, -0.12, 0.0)), encoding="utf-8")
                expected = [in_units(length_m, ".2f") for length_m in lengths_m]
            driver.get(page.as_uri())
            told = driver.execute_script(
                "return arguments[0].map((metres) => inUnits(metres, 2))", lengths_m
            )
            assert told == expected
