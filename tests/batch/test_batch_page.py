"""The page of a batch and jobs.csv: every job with what became of it, links that lead somewhere."""

import csv
import html
import re
from urllib.parse import unquote

import pytest
from batch_results import write_results
from filelock import FileLock

from browser_probe import BROWSER, found_in
from planfit.batch.jobs import Job
from planfit.batch.ledger import JOB_KEY, End, State
from planfit.batch.page import Result, write_page

OUTCOMES = {
    "refined": Result.REFINED,
    "improved": Result.RESERVATIONS,
    "no better": Result.NO_BETTER,
}


def finish(ledger, name, outcome="refined", seconds=12.3, **what):
    """A job that is done."""
    write_results(
        ledger.folder(name), {"scan": name, JOB_KEY: "k"}, has_picture=True, outcome=outcome, **what
    )
    ledger.log(name).touch()
    ledger.keep_state(name, State(End.DONE, "k", "", seconds, 1_234_000_000))


@pytest.fixture
def jobs(ledger):
    """One of each kind."""
    for i, outcome in enumerate(OUTCOMES):
        finish(ledger, f"Büro {i} #%", outcome, predicted_m=0.01 * (i + 1))
    finish(ledger, "no plan", walls=(None, None))
    for name, end in (("away", End.REFUSED), ("dead", End.CRASHED)):
        ledger.log(name).touch()
        ledger.keep_state(name, State(end, "", f"the reason of <{name}>", 1.0, None))
    names = [*(f"Büro {i} #%" for i in range(3)), "no plan", "away", "dead", "open"]
    return [Job(name, f"/scans/{name}") for name in names]


def test_every_job_is_there_with_what_became_of_it(ledger, jobs):
    rows = write_page(jobs, ledger, "Haus <1>")
    assert [row.result for row in rows] == [
        Result.REFINED, Result.RESERVATIONS, Result.NO_BETTER, Result.REFINED, Result.REFUSED,
        Result.CRASHED, Result.OPEN,
    ]  # fmt: skip
    page = (ledger.out / "index.html").read_text(encoding="utf-8")
    assert (
        "2 refined, 1 with reservations, 1 no better, 1 refused, 1 crashed, 1 not done yet" in page
    )
    assert "the reason of &lt;away&gt;" in page
    assert "few frames" in page  # the reservation's own words, not the verdict's reasons
    assert "Haus &lt;1&gt;" in page
    with (ledger.out / "jobs.csv").open(encoding="utf-8", newline="") as file:
        table = list(csv.DictReader(file))
    assert [line["verdict"] for line in table] == [row.result.value for row in rows]
    assert table[1]["predicted_error_m"] == "0.0200"
    assert (table[0]["wall_on_plan_before"], table[0]["wall_on_plan_after"]) == ("0.7000", "0.9800")
    assert table[3]["wall_on_plan_after"] == ""
    assert (table[0]["seconds"], table[0]["peak_memory_gb"]) == ("12.3", "1.23")
    assert table[4]["reason"] == "the reason of <away>"


def test_links_lead_somewhere_and_nothing_is_fetched(ledger, jobs):
    write_page(jobs, ledger, "house")
    page = (ledger.out / "index.html").read_text(encoding="utf-8")
    links = [html.unescape(link) for link in re.findall(r'(?:href|src)="([^"]+)"', page)]
    assert len(links) == 4 * 3 + 2 + 1  # report twice and picture; logs of the failed; jobs.csv
    for link in links:
        assert "://" not in link
        assert (ledger.out / unquote(link)).is_file(), link
    assert "http" not in re.sub(r'href="[^"]*"', "", page)


def test_results_of_other_inputs_are_not_shown_for_a_job_that_failed(ledger):
    finish(ledger, "a")
    ledger.keep_state("a", State(End.REFUSED, "another key", "the plan is gone"))
    (row,) = write_page([Job("a", "/s")], ledger, "t")
    assert (row.result, row.reason, row.report) == (Result.REFUSED, "the plan is gone", "")


def test_thumbnails_follow_the_results_and_are_small(ledger):
    finish(ledger, "a")
    write_page([Job("a", "/s")], ledger, "t")
    thumbnail = ledger.thumbnail("a")
    first = thumbnail.stat().st_mtime_ns
    assert thumbnail.stat().st_size < 20_000
    write_page([Job("a", "/s")], ledger, "t")
    assert thumbnail.stat().st_mtime_ns == first
    finish(ledger, "a")
    write_page([Job("a", "/s")], ledger, "t")
    assert thumbnail.stat().st_mtime_ns > first
    (ledger.folder("a") / "overlay.png").write_bytes(b"no picture")
    write_page([Job("a", "/s")], ledger, "t")
    assert not thumbnail.exists()


PROBE = """<script>addEventListener("load", () => {
  const page = document.querySelector("iframe").contentDocument;
  const names = () => [...page.querySelectorAll("tbody tr")].map((r) => r.cells[0].textContent);
  const heads = page.querySelector("thead tr").cells, found = {};
  const press = (i) => { heads[i].querySelector("button").click(); return names(); };
  found.name = press(0); found.down = press(0); found.verdict = press(1); found.error = press(3);
  found.width = page.documentElement.scrollWidth;
  document.title = "FOUND" + JSON.stringify(found);
});</script>"""


@pytest.mark.skipif(BROWSER is None, reason="no Chromium to open the page with")
def test_the_page_sorts_and_fits_a_phone(ledger, jobs):
    write_page(jobs, ledger, "house")
    text = (ledger.out / "index.html").read_text(encoding="utf-8")
    found = found_in(ledger.out / "probe.html", text, 360, PROBE)
    names = [job.name for job in jobs]
    assert found["name"] == sorted(names, key=str.lower)
    assert found["down"] == found["name"][::-1]
    assert found["verdict"][:3] == ["open", "dead", "away"]
    assert found["error"][:4] == ["Büro 0 #%", "no plan", "Büro 1 #%", "Büro 2 #%"]
    assert found["width"] <= 360


def test_the_page_waits_for_no_job(ledger):
    """A job's lock is held for as long as it goes on."""
    with FileLock(ledger.lock("page")):
        write_page([Job("page", "/s")], ledger, "t")
    assert (ledger.out / "index.html").exists()
