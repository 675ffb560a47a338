"""The report: one HTML file that needs nothing else, for a screen, a phone or paper; what it is told beside
the result: what it holds, and when, how and with what the run was made."""

import platform
import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from html import escape
from importlib import resources
from importlib.metadata import PackageNotFoundError, version
from pathlib import PurePath

import numpy as np

from planfit import __version__
from planfit.as_built import AsBuilt, AsBuiltOptions
from planfit.findings import Finding, sentences_of
from planfit.floorplan import Floorplan
from planfit.pipeline.contradicted import ByHand
from planfit.pipeline.result import RefineResult
from planfit.pipeline.survey_residuals import contradicted_points
from planfit.pipeline.verdict import Outcome
from planfit.report.html import sections, tables
from planfit.report.html.evidence_sections import (
    certainty,
    disagreement_section,
    registration_section,
    survey_section,
)
from planfit.report.html.overview import (
    close_ups,
    overview,
    scans_section,
    storeys_section,
    three_numbers,
)
from planfit.report.html.sections import items_with_photos
from planfit.report.html.view_section import view_data, view_script, view_section, view_style
from planfit.report.measures import (
    BeforeAfter,
    TruthErrors,
    key_metrics,
    measure,
    measure_storeys,
    reasons_in_words,
    told_first,
)
from planfit.report.plots.overlay import choose_close_ups
from planfit.report.plots.top_view import Crop, Mark, crop_to_scan
from planfit.report.scene import Scene
from planfit.units import asked


@dataclass(frozen=True)
class ReportOptions:
    """What the report holds beside its words and plots."""

    has_view: bool = True
    """Show the scan in 3D. Without, the page has a tenth of the size and is written some seconds sooner."""
    as_built: AsBuiltOptions = field(default_factory=AsBuiltOptions)
    """Verdicts on the walls of the plan."""


_LIBRARIES = {
    "NumPy": "numpy",
    "SciPy": "scipy",
    "numba": "numba",
    "OpenCV": "opencv-python-headless",
}
"""Those that results may depend on, by how they are called."""


@dataclass(frozen=True)
class Provenance:
    """Of a run."""

    at: str
    """Date, time, and offset from UTC."""
    command: str
    """The command line as it was typed; nothing where a program called planfit."""
    versions: dict[str, str]
    """Of planfit, Python and the libraries that results may depend on."""
    plan_sha256: dict[str, str] = field(default_factory=dict)
    """Of each file of the plan, by its name."""


def provenance_now(command: str = "") -> Provenance:
    """Of a run that begins now."""
    versions = {"planfit": __version__, "Python": platform.python_version()}
    for name, distribution in _LIBRARIES.items():
        try:
            versions[name] = version(distribution)
        except PackageNotFoundError:  # another build of it, as OpenCV has several
            continue
    return Provenance(time.strftime("%Y-%m-%d %H:%M:%S %z"), command, versions)


_COLOR = {Outcome.REFINED: "good", Outcome.IMPROVED: "fair", Outcome.NO_BETTER: "bad"}


@dataclass(frozen=True)
class Shown:
    """What the sections of a report are made of; fields are arguments of `make_report`."""

    scan_name: str
    floorplan: Floorplan | None
    result: RefineResult
    options_text: str
    truth: TruthErrors | None
    both: BeforeAfter
    crop: Crop
    """Part of the plan that pictures show."""
    marks: tuple[Mark, ...]
    """Windows where before and after differ most; none of plans by storey, which have their own."""
    scene: Scene | None
    as_built: AsBuilt | None
    made: Provenance | None


Section = Callable[[Shown], str]
"""A part of the report as HTML, empty where it does not apply; what follows each heading (`<h2>`) is folded
under it."""
_SECTION = re.compile("<h2>(.*?)</h2>(.*?)(?=<h2>|$)", re.DOTALL)
_OPEN = ("Storey", "Scans")
"""First words of the headings of sections that stand in for the first picture, and are seen at once."""


def make_report(
    scan_name: str,
    floorplan: Floorplan | None,
    result: RefineResult,
    options_text: str,
    truth: TruthErrors | None = None,
    both: BeforeAfter | None = None,
    scene: Scene | None = None,
    as_built: AsBuilt | None = None,
    made: Provenance | None = None,
) -> str:
    """The report of a run as one self-contained HTML page: no links, pictures and scripts inside.

    Args:
        scan_name: as its folder is called; of a path, the last part is shown.
        floorplan: that the scan was fitted to; without one, there are no sections on it.
        result: of `planfit.refine`.
        options_text: the options of the run, shown as they are.
        truth: position errors against true poses, where these are known.
        both: what `measure` gives of the result with that plan, where that is at hand.
        scene: what a 3D view shows; without, there is none.
        as_built: verdicts on the walls of the plan; without, there are none.
        made: when, how and with what the run was made, where that is to be told.
    """
    both = both or measure(floorplan, result)
    crop = crop_to_scan(both)
    shown = Shown(
        _last_part(scan_name),
        floorplan,
        result,
        options_text,
        truth,
        both,
        crop,
        choose_close_ups(both, crop) if result.storeys is None else (),
        scene,
        as_built,
        made,
    )
    body = [html for section in SECTIONS if (html := section(shown))]
    on_plan = "without a plan" if floorplan is None else f"on {_last_part(floorplan.name)}"
    title = f"{shown.scan_name} {on_plan}: planfit report"
    return page_of(title, _folded(body), scene)


def page_of(title: str, body: Sequence[str], scene: Scene | None = None) -> str:
    """A self-contained page of parts that are HTML; the title is plain text. `scene` is that of a
    part that is a 3D view."""
    style, page, as_built = (
        resources.files("planfit.report.html").joinpath(name).read_text("utf-8")
        for name in ("style.css", "page.js", "as_built.js")
    )
    script = page + as_built
    first = rest = ""
    if scene is not None:
        style, script = style + view_style(), script + view_script()
        first, rest = view_data(scene)
    units = "" if asked() == "m" else f' data-units="{asked()}"'
    return (
        f'<!DOCTYPE html>\n<html lang="en"{units}>\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n"
        f"<style>\n{style}</style>\n</head>\n<body>\n<main>\n"
        + "\n".join(body)
        + f"\n</main>\n{first}<script>\n{script}</script>\n{rest}</body>\n</html>\n"
    )


def _top(shown: Shown) -> str:
    """What is to be seen first: title, verdict, three numbers and the scan on its plan; then what to know
    before the result is used, and key metrics."""
    result, floorplan, made = shown.result, shown.floorplan, shown.made
    numbers = key_metrics(result, shown.both, shown.truth)
    fitted = "made to agree with itself, without a floorplan,"
    if floorplan is not None:
        fitted = f"fitted to the floorplan {_last_part(floorplan.name)}"
    on_date = "" if made is None else f" on {escape(made.at.split()[0])}"
    warnings = _with_photos(shown, [(each, escape(each.sentence)) for each in result.findings])
    parts = [
        f"<h1>{escape(shown.scan_name)}</h1>",
        _title_block(shown),
        f'<p class="under">{escape(fitted)} by planfit {escape(__version__)}{on_date}</p>',
        f'<p class="verdict {_COLOR[result.verdict.outcome]}">'
        f"{escape(told_first(result.verdict))}</p>",
        three_numbers(result, numbers),
    ]
    if result.storeys is None:
        parts.append(overview(floorplan, shown.both, shown.crop, shown.marks))
    parts.append(f"<p>{escape(reasons_in_words(result.verdict, shown.truth))}</p>")
    if result.by_hand is not None:
        parts.append(_by_hand(result.by_hand))
    if result.verdict.reservations:
        parts.append(_reservations(shown))
    if warnings:
        parts.append(
            f'<div class="warnings"><h2>Before you use this result</h2><ul>{warnings}</ul></div>'
        )
    parts.append("<h2>Key metrics</h2>")
    if numbers:
        parts.append(tables.key_metric_table(numbers))
    else:
        parts.append("<p>Too little was seen of walls, floor and matches to measure anything.</p>")
    return "\n".join(parts)


def _storeys_or_close_ups(shown: Shown) -> str:
    """Storey by storey, where each has a plan of its own; else where before and after differ most."""
    storeys = shown.result.storeys
    if storeys is None:
        return close_ups(shown.floorplan, shown.both, shown.marks)
    return storeys_section(storeys, measure_storeys(shown.result), shown.crop)


def _certainty(shown: Shown) -> str:
    """How sure each frame is, and what contradicts what, control points among it."""
    result, survey = shown.result, shown.result.survey
    points = [] if survey is None else sentences_of(contradicted_points(survey.points))
    return certainty(result, shown.truth) + disagreement_section(
        result.evidence.disagreements, points
    )


def _title_block(shown: Shown) -> str:
    """What a document says of itself first: on paper alone, as the page has it at its end."""
    made, scan = shown.made, shown.result.made_of.scan if shown.result.made_of else None
    plan = "none" if shown.floorplan is None else _last_part(shown.floorplan.name)
    told = {} if made is None else {f"SHA-256 of {n}": h for n, h in made.plan_sha256.items()}
    rows = {
        "Project": shown.scan_name,
        "Date": "" if made is None else made.at,
        "Scan": "" if scan is None else f"{scan.format}, {len(scan)} frames",
        "Plan": plan,
        **told,
        "Made by": f"planfit {__version__}",
    }
    cells = "".join(
        f"<dt>{escape(name)}</dt><dd>{escape(it)}</dd>" for name, it in rows.items() if it
    )
    return f'<dl class="title-block on-paper">{cells}</dl>'


_SIGNATURE = "".join(f"<span>{what}</span>" for what in ("Checked by", "Date", "Signature"))


def _foot(shown: Shown) -> str:
    axes = "as recorded, turned upright" if shown.floorplan is None else "as in the plan"
    return (
        f'<p class="signature on-paper">{_SIGNATURE}</p>'
        f"<footer>{_made(shown.made)} x and y {axes}, heights above the floor.</footer>"
    )


def _made(made: Provenance | None) -> str:
    """When, with which versions, and by which command."""
    if made is None:
        return f"Made by planfit {escape(__version__)}."
    versions = ", ".join(f"{name} {number}" for name, number in made.versions.items())
    by = f" by <code>{escape(made.command)}</code>" if made.command else ""
    return f"Made {escape(made.at)}{by} with {escape(versions)}."


def _folded(parts: Sequence[str]) -> list[str]:
    """The page's parts, all but the first folded: headings of what is closed are a list of contents."""
    top, *rest = parts
    # The 3D view is a section of its own, and stays open.
    return [top, *(re.sub(_SECTION, _fold, p) if p.startswith("<h2>") else p for p in rest)]


def _fold(section: re.Match[str]) -> str:
    is_open = " open" if section[1].startswith(_OPEN) else ""
    return (
        f'<details class="section"{is_open}><summary><h2>{section[1]}</h2></summary>'
        f"{section[2]}</details>"
    )


def _by_hand(by_hand: ByHand) -> str:
    """What was corrected by hand, and what each correction came to."""
    items = "".join(f"<li>{escape(each.sentence)}</li>" for each in by_hand.outcomes)
    items += "".join(f"<li>left out: {escape(each.sentence)}</li>" for each in by_hand.left_out)
    return (
        f'<details class="by-hand"><summary>{escape(by_hand.sentence)}</summary>'
        f"<ul>{items}</ul></details>"
    )


def _reservations(shown: Shown) -> str:
    items = [
        (
            each,
            f"{escape(each.words[0].upper() + each.words[1:])}. "
            f"<em>What to do:</em> {escape(each.advice)}.",
        )
        for each in shown.result.verdict.reservations
    ]
    found = _with_photos(shown, items)
    return f'<div class="warnings"><h2>Reservations</h2><ul>{found}</ul></div>'


def _with_photos(shown: Shown, items: Sequence[tuple[Finding, str]]) -> str:
    pictures = {} if shown.scene is None else shown.scene.pictures
    return items_with_photos(items, shown.result, pictures)


def _costs_and_time(shown: Shown) -> str:
    result = shown.result
    return (
        '<h2>How it was solved</h2><div class="columns">'
        "<div><h3>Cost of each term</h3>"
        "<p>Misfit, weighted by how sure each observation is; it has no unit, and less is better. "
        "The recorded motion fits itself perfectly before; its cost after is what was given up of "
        "it for the rest.</p>"
        f"{tables.cost_table(result)}</div>"
        "<div><h3>Time</h3><p>Stages that were found in the cache take almost none.</p>"
        f"{tables.time_table(result)}</div></div>"
    )


def _statistics(shown: Shown) -> str:
    result = shown.result
    centres = result.initial_plan_from_cams[:, :3, 3]
    path_length = float(np.linalg.norm(np.diff(centres, axis=0), axis=1).sum())
    return (
        "<h2>Statistics of the scan</h2>"
        f'<div class="statistics">{tables.statistics_table(result, path_length)}</div>'
        "<details><summary>Options of this run</summary>"
        f'<pre tabindex="0">{escape(shown.options_text)}</pre></details>'
    )


def _last_part(path: str) -> str:
    """Of a path; of each where plans of storeys are named together."""
    return " and ".join(PurePath(one).name or one for one in path.split(" and "))


SECTIONS: tuple[Section, ...] = (
    _top,
    lambda shown: scans_section(shown.result),
    _storeys_or_close_ups,
    lambda shown: "" if shown.scene is None else view_section(shown.scene),
    _certainty,
    lambda shown: registration_section(shown.result.registration),
    lambda shown: survey_section(shown.result.survey),
    lambda shown: sections.fit_and_correction(shown.both),
    lambda shown: sections.sensor_section(shown.result),
    lambda shown: sections.floor(shown.floorplan, shown.both, shown.crop),
    lambda shown: sections.walls(shown.floorplan, shown.result, shown.crop, shown.as_built),
    lambda shown: sections.frame_matches(shown.floorplan, shown.both, shown.result, shown.crop),
    _costs_and_time,
    _statistics,
    _foot,
)
"""All parts of the report, in the order of the page; the first is above the list of contents."""
