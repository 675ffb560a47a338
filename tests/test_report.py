"""The report: right numbers, nothing from elsewhere, no nonsense where little was seen."""

import io
import re
import time
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image

from builders import make_ties, room_plan
from planfit.adjust import PlanAdjustment, TornStep
from planfit.adjust.association import Association
from planfit.alignment import Alignment
from planfit.alignment.refine import AlignmentHypothesis
from planfit.evaluation import wall_distances
from planfit.findings import Finding, ScanKind, SurveyKind
from planfit.floorplan import Floorplan
from planfit.geometry import se3, segments
from planfit.lsq.solver import Cost, Solution, Stop
from planfit.matching import Matches
from planfit.pipeline.result import RefineResult
from planfit.pipeline.validation import Check
from planfit.report import formatting
from planfit.report.html.page import Provenance, make_report, provenance_now
from planfit.report.measures import TruthErrors, measure, reasons_in_words, told_first
from planfit.report.plots.charts import certainty_plot, loop_closures_of, matches_by_frame
from planfit.report.plots.drawing import to_svg
from planfit.report.plots.overlay import choose_close_ups, draw_overlay
from planfit.report.plots.top_view import crop_to_scan, find_gaps
from planfit.segmentation import (
    Gravity,
    LevelPoints,
    Structure,
    WallPatches,
    no_level_points,
    no_wall_patches,
)
from verdicts import make_evidence, make_stretch, make_verdict, make_visit

WIDTH, DEPTH = 8.0, 6.0  # m, of the room
OFFSET = np.array([0.3, 0.0, 0.0])  # m, recorded poses against true ones
PER_PATCH = 60
PNG_MAGIC = b"\x89PNG\r\n\x1a\n"


@pytest.fixture
def floorplan():
    # Counter-clockwise, so that normals to the left look into the room.
    corners = np.array([[0.0, 0.0], [WIDTH, 0.0], [WIDTH, DEPTH], [0.0, DEPTH]])
    ends = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
    return Floorplan("plans/<room>.npy", ends, segments.left_normals(ends), np.full(4, True))


def make_result(n_frames=12, wall_offsets=(0.0, 0.0, 0.0, 0.0), is_checked=True):
    """A walk through the room; frame i sees wall i % 4 and the floor.

    Recorded poses are off by `OFFSET`, refined ones are true. Scanned walls lie `wall_offsets` m in
    front of the drawn ones; the floor is 2 cm above and below z = 0 in equal parts.
    """
    rng = np.random.default_rng(0)
    angle = 2 * np.pi * np.arange(n_frames) / n_frames
    positions = np.stack([4 + 2 * np.cos(angle), 3 + 1.5 * np.sin(angle), 1.5 + 0 * angle], axis=1)
    rotations = se3.exp_so3(rng.normal(0, 0.5, (n_frames, 3)))
    plan_from_cams = se3.make_transform(rotations, positions)
    initial = plan_from_cams.copy()
    initial[:, :3, 3] += OFFSET
    wall_idx = np.arange(n_frames) % 4
    patches, ends, normals = [], [], []
    for i, wall in enumerate(wall_idx):
        cam_from_plan = se3.inverse(plan_from_cams[i])
        along = np.linspace(2.0, 4.0, PER_PATCH)
        d = wall_offsets[wall]
        x = {0: along, 1: WIDTH - d + 0 * along, 2: along, 3: d + 0 * along}[wall]
        y = {0: d + 0 * along, 1: along, 2: DEPTH - d + 0 * along, 3: along}[wall]
        points = np.stack([x, y, rng.uniform(0.5, 2.5, PER_PATCH)], axis=1)
        patches.append(se3.transform(cam_from_plan, points))
        ends.append(
            se3.transform(cam_from_plan, np.array([[x[0], y[0], 1.5], [x[-1], y[-1], 1.5]]))
        )
        normal = [(0, 1, 0), (-1, 0, 0), (0, -1, 0), (1, 0, 0)][wall]
        normals.append(cam_from_plan[:3, :3] @ normal)
    floor = []
    for i in range(n_frames):
        xy = rng.uniform([1, 1], [WIDTH - 1, DEPTH - 1], (40, 2))
        z = np.tile([0.02, -0.02], 20)
        floor.append(se3.transform(se3.inverse(plan_from_cams[i]), np.column_stack([xy, z])))
    structure = Structure(
        floor=LevelPoints(np.concatenate(floor), 40 * np.arange(n_frames + 1)),
        floor_heights_m=np.zeros(n_frames),
        walls=WallPatches(
            points_cam=np.concatenate(patches),
            start=PER_PATCH * np.arange(n_frames + 1),
            frame_idx=np.arange(n_frames),
            normals_cam=np.array(normals),
            ends_cam=np.array(ends),
        ),
        unassigned_points_cam=np.zeros((0, 3)),
        unassigned_frame_idx=np.zeros(0, dtype=int),
        ceiling=no_level_points(n_frames),
        columns=no_wall_patches(),
        back_end="masks",
        floor_height_m=0.0,
    )
    pairs = np.array([[0, 1], [0, 5]])
    solution = Solution(plan_from_cams, Stop.COST, 3, {"walls": Cost(10.0, 1.0)})
    association = Association(wall_idx.copy(), np.array(wall_offsets)[wall_idx])
    judged = (
        Check("places seen again, median distance", 0.08, 0.02, "m", False),
        Check("wall points within 0.1 m of the plan", 0.5, 1.0, "share", False),
    )
    return RefineResult(
        floorplan=room_plan(),
        plan_from_cams=plan_from_cams,
        initial_plan_from_cams=initial,
        world_from_plan=np.eye(4),
        gravity=Gravity(np.array([0.0, 0.0, 1.0]), 1.0, "the <most> common normal"),
        structure=structure,
        matches=Matches(
            pairs, np.array([0, 2, 3]), np.zeros((3, 3)), np.zeros((3, 3)), np.ones(3), 7, 1234
        ),
        alignment=Alignment(np.eye(4), 0.8, AlignmentHypothesis(0.1, np.zeros(2), 0.3), True),
        adjustment=PlanAdjustment(
            solution,
            make_ties(room_plan(), association, n_frames),
            np.zeros(0),
            np.zeros(0),
            4,
            True,
            12,
        ),
        solved_frame_idx=np.arange(n_frames),
        cost_by_term={"points": (200.0, 50.0), "odometry": (0.0, 3.0)},
        checks=judged if is_checked else (),
        findings=(),
        seconds_by_stage={"level": 0.01, "adjust to the plan": 2.5},
        verdict=make_verdict(n_frames=n_frames),
        evidence=make_evidence(n_frames=n_frames),
    )


def without_walls(result):
    bare = replace(result.structure, walls=no_wall_patches())
    none = Association(np.zeros(0, dtype=int), np.zeros(0))
    stretches = (
        make_stretch(0, n_patches=0, near_before=np.nan, near_kept_out=np.nan, beside=np.nan),
    )
    judged = {"alignment": None, "is_placed": False, "stretches": stretches}
    return replace(
        result,
        verdict=make_verdict(len(result.plan_from_cams), **judged),
        evidence=make_evidence(len(result.plan_from_cams), **judged),
        structure=bare,
        alignment=None,
        adjustment=replace(
            result.adjustment,
            correspondences=replace(result.adjustment.correspondences, walls=none),
        ),
        checks=(),
    )


def without_floor(result):
    structure = result.structure
    bare = replace(
        structure,
        floor=no_level_points(len(structure.floor.start) - 1),
        floor_height_m=float("nan"),
    )
    return replace(result, structure=bare)


def without_matches(result):
    none = np.zeros((0, 3))
    empty = Matches(
        np.zeros((0, 2), dtype=int), np.zeros(1, dtype=int), none, none, none[:, 0], 7, 0
    )
    return replace(result, matches=empty)


def without_association(result):
    n = len(result.structure.walls)
    none = Association(np.full(n, -1), np.full(n, np.nan))
    return replace(
        result,
        adjustment=replace(
            result.adjustment,
            correspondences=replace(result.adjustment.correspondences, walls=none),
        ),
    )


def alone(result):
    """Nothing was seen at all."""
    return without_matches(without_floor(without_walls(result)))


class Page(HTMLParser):
    """Collects what a browser would fetch, visible text and unbalanced tags."""

    VOID = ("meta", "img", "br")

    def __init__(self, html):
        super().__init__()
        self.sources, self.tags, self.text, self._open = [], [], [], []
        self.feed(html)
        assert not self._open

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.sources += [value for name, value in attrs if name in ("src", "href", "srcset")]
        if tag not in self.VOID:
            self._open.append(tag)

    def handle_endtag(self, tag):
        assert self._open.pop() == tag

    def handle_data(self, data):
        if not {"style", "script"} & set(self._open):
            self.text.append(data)

    @property
    def words(self):
        return re.sub(r"\s+", " ", "".join(self.text))


def read(floorplan, result, options="", truth=None):
    return Page(make_report("scan", floorplan, result, options, truth))


def test_report_is_self_contained(floorplan):
    html = make_report("scan", floorplan, make_result(), "")
    page = Page(html)
    assert page.sources
    # Pictures inside, and places on the page itself.
    assert all(source.startswith(("data:image/png;base64,", "#")) for source in page.sources)
    assert not {"link", "iframe", "object"} & set(page.tags)
    assert page.tags.count("script") == 1  # our own, inside
    assert not re.search(r"fetch\(|XMLHttp|eval\(|innerHTML", html)
    assert not re.search(r"https?://|url\(|@import", html)
    assert "Before you use this result" not in page.words  # there are no warnings
    assert len(html) < 4e6
    assert html == make_report("scan", floorplan, make_result(), "")


def test_all_but_the_first_part_is_folded_under_its_headings(floorplan):
    text = make_report("scan", floorplan, make_result(), "")
    first, rest = text.split("Key metrics", 1)
    assert '<details class="section"' not in first
    headings = re.findall("<h2>(.*?)</h2>", rest)
    folded = re.findall('<details class="section"><summary><h2>(.*?)</h2></summary>', rest)
    assert headings == folded
    assert {"Walls of the plan", "Statistics of the scan"} <= set(folded)
    assert len(re.findall("<details", text)) == len(re.findall("</details>", text))


def test_it_tells_when_how_and_with_what_it_was_made(floorplan):
    made = Provenance(
        "2031-02-03 04:05:06 +0900",
        "planfit refine 'a <b>' -o out",
        {"planfit": "7.8", "NumPy": "9.1"},
    )
    words = Page(make_report("scan", floorplan, make_result(), "", made=made)).words
    assert " on 2031-02-03 " in words
    foot = words[words.index("Made 2031-02-03 04:05:06 +0900") :]
    assert "planfit refine 'a <b>' -o out" in foot
    assert "with planfit 7.8, NumPy 9.1." in foot


def test_what_is_made_now_has_todays_date_and_the_versions_in_use():
    before = time.strftime("%Y-%m-%d")
    made = provenance_now("planfit refine x")
    assert made.at.split()[0] in (before, time.strftime("%Y-%m-%d"))
    assert made.command == "planfit refine x"
    assert made.versions["NumPy"] == np.__version__
    assert {"planfit", "Python", "SciPy", "numba"} <= set(made.versions)
    assert provenance_now().command == ""


def test_text_is_escaped(floorplan):
    unused = Finding(SurveyKind.POINTS_UNSEEN, {"points": ("<b>7</b>", "& others")})
    result = replace(make_result(), findings=(unused,))
    html = make_report("<scan> & co", floorplan, result, "[a]\nname = '<script>'\n")
    for raw in ("<b>", "<scan>", "'<script>'", "<room>", "<most>"):
        assert raw not in html
    words = Page(html).words
    for text in ("points <b>7</b>, & others", "<scan> & co", "<script>", "<room>.npy"):
        assert text in words


def test_warnings_are_shown_before_the_numbers(floorplan):
    floor, walls = Finding(ScanKind.NO_FLOOR), Finding(ScanKind.NO_WALL)
    words = read(floorplan, replace(make_result(), findings=(floor, walls))).words
    assert "Before you use this result" in words
    assert words.index("no floor was") < words.index("no wall was") < words.index("Key metrics")


def test_measures_equal_those_computed_by_hand(floorplan):
    result = make_result()
    both = measure(floorplan, result)
    # Half of the walls are moved along themselves, half across.
    assert both.before.walls.nsd_m == pytest.approx(0.15)
    assert both.after.walls.nsd_m == pytest.approx(0.0, abs=1e-12)
    assert both.before.walls.near_share == pytest.approx(0.5)
    assert both.after.walls.near_share == 1.0
    assert both.after.floor.height_rms_m == pytest.approx(0.02)
    assert both.after.floor.height_median_m == pytest.approx(0.02)
    np.testing.assert_allclose(both.correction[:, 3:], np.tile(-OFFSET, (12, 1)), atol=1e-12)
    np.testing.assert_allclose(both.correction[:, :3], 0.0, atol=1e-9)


def test_measures_equal_those_of_evaluate(floorplan):
    result = make_result()
    unassigned = np.random.default_rng(1).normal(size=(70_000, 3))
    structure = replace(
        result.structure,
        unassigned_points_cam=unassigned,
        unassigned_frame_idx=np.full(len(unassigned), 3),
    )
    both = measure(floorplan, replace(result, structure=structure))
    expected = wall_distances(structure, floorplan, result.initial_plan_from_cams)
    np.testing.assert_array_equal(both.before.walls.nearest_m, expected.nearest_m)
    np.testing.assert_array_equal(both.before.wall_distances_m, expected.nearest_m)


def test_key_metrics_appear_with_units_and_change(floorplan):
    words = read(floorplan, make_result(), truth=TruthErrors(1.0, 0.25, 0.5, 0.1)).words
    metrics = words[words.index("Key metrics") :]
    assert "0.080 m0.020 m−75 %" in metrics
    assert "50 %100 %+50 percentage points" in metrics
    assert "0.150 m0.000 m−100 %" in metrics
    assert "1.00 m0.250 m−75 %" in metrics
    assert "0.500 m0.100 m−80 %" in metrics
    assert "from 1.00 m to 0.250 m" in words[: words.index("Key metrics")]


def test_first_sentence_and_reasons_are_those_of_the_verdict():
    verdict = make_result().verdict
    assert told_first(verdict).startswith("Refined: cameras were moved by 0.50 m")
    words = reasons_in_words(verdict)
    assert all(reason[1:] in words for reason in verdict.further_reasons)


def test_verdict_numbers_and_the_scan_on_its_plan_come_first(floorplan):
    page = read(floorplan, make_result())
    top = page.words[: page.words.index("Key metrics")]
    parts = (
        "Refined: ",
        "0.030 m expected position error",
        "100% of the frames",
        "0.020 m places seen twice",
    )
    parts = (*parts, "100 % wall points on the plan", "before: ", "after: ", "Seen from above")
    places = [top.index(part) for part in parts]
    assert places == sorted(places)


def test_key_metrics_tell_what_got_worse_and_what_better(floorplan):
    worse = Check("wall points within 0.1 m of the plan", 0.9, 0.4, "share", True)
    result = replace(make_result(), checks=(make_result().checks[0], worse))
    words = read(floorplan, result).words
    table = words[words.index("Key metrics") :]
    seen, near = table.index("Places seen twice"), table.index("Wall points on the plan")
    assert "better" in table[seen:near]
    assert "worse" in table[near : table.index("Distance to the plan")]


def test_key_metrics_do_not_call_the_same_better(floorplan):
    same = Check("places seen again, median distance", 0.02, 0.02, "m", False)
    words = read(floorplan, replace(make_result(), checks=(same,))).words
    row = words[words.index("Places seen twice") : words.index("Distance to the plan")]
    assert not {"better", "worse"} & set(row.split())


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, "Refined: "),
        (
            {"torn": (TornStep((3, 4), 0.5, 2.4, 2.0, 30.0, 90.0),)},
            "Improved, with reservations: the path is torn at frames 3-4",
        ),
        ({"visits": (make_visit(kept_out_m=0.9),)}, "No better: use the recorded poses"),
    ],
)
def test_outcome_is_the_head_line(floorplan, changes, expected):
    judged = {"verdict": make_verdict(12, **changes), "evidence": make_evidence(12, **changes)}
    words = read(floorplan, replace(make_result(), **judged)).words
    assert expected in words[: words.index("Key metrics")]
    assert ("Reservations" in words) == ("reservations" in expected)
    assert ("What to do:" in words) == ("reservations" in expected)


def test_certainty_of_each_frame_is_shown_with_the_truth_where_known(floorplan):
    torn = (TornStep((3, 4), 0.5, 2.4, 2.0, 30.0, 90.0),)
    judged = {"verdict": make_verdict(12, torn=torn), "evidence": make_evidence(12, torn=torn)}
    plain = read(floorplan, make_result()).words
    shown = read(floorplan, replace(make_result(), **judged)).words
    assert "How sure each frame is" in plain
    assert "0.030 m RMS" in plain
    assert "1 time a place is seen again" in plain
    assert "Shaded" not in plain
    assert "Shaded: frames with a reservation" in shown
    true = read(
        floorplan, make_result(), truth=TruthErrors(1.0, 0.2, 0.5, 0.1, np.full(12, 0.2))
    ).words
    assert "Dotted: the true error" in true
    assert "Dotted" not in plain


def test_certainty_plot_shows_prediction_truth_and_reservations():
    torn = make_verdict(50, torn=(TornStep((10, 11), 0.5, 2.4, 2.0, 30.0, 90.0),))
    shown = [
        to_svg(certainty_plot(verdict, np.full(50, radius_m), true_error_m))
        for verdict, radius_m, true_error_m in (
            (make_verdict(50), 0.1, None),
            (make_verdict(50), 0.3, None),
            (make_verdict(50), 0.1, np.full(50, 0.2)),
            (torn, 0.1, None),
        )
    ]
    assert len(set(shown)) == 4


@pytest.mark.parametrize(
    ("strip", "expected"),
    [
        (without_walls, "the scan is not placed on the plan"),
        (without_floor, "No floor was seen"),
        (without_matches, "matched points0"),
        (without_association, "no wall of it can be judged"),
        (alone, "Too little was seen"),
        (lambda result: replace(result, cost_by_term={}, seconds_by_stage={}), "sum00"),
    ],
)
def test_report_says_what_is_missing(floorplan, strip, expected):
    result = strip(make_result())
    words = read(floorplan, result).words
    assert expected in words
    assert not re.search(r"\bnan\b|\binf\b|\bNone\b", words)


@pytest.mark.parametrize("n_frames", [1, 10])
def test_short_scans(floorplan, n_frames):
    result = make_result(n_frames)
    if n_frames < 6:
        result = without_matches(result)
    assert f"frames{n_frames}" in read(floorplan, result).words


@pytest.mark.parametrize("strip", [without_walls, alone])
def test_overlay_where_little_was_seen(floorplan, strip):
    assert draw_overlay(floorplan, measure(floorplan, strip(make_result(1)))).startswith(PNG_MAGIC)


def test_not_aligned_shows_no_distances_to_the_plan(floorplan):
    result = without_walls(make_result())
    unassigned = replace(
        result.structure,
        unassigned_points_cam=np.ones((50, 3)),
        unassigned_frame_idx=np.zeros(50, dtype=int),
    )
    words = read(floorplan, replace(result, structure=unassigned)).words
    assert "NSD" not in words
    assert "within 0.10 m" not in words


def test_overlay_is_a_png_with_two_panels(floorplan):
    image = Image.open(io.BytesIO(draw_overlay(floorplan, measure(floorplan, make_result()))))
    assert image.format == "PNG"
    assert image.width > 1.5 * image.height > 600  # the room is about square: side by side
    colors = {color for _, color in image.convert("RGB").getcolors(100_000)}
    for wanted in ((213, 94, 0), (0, 114, 178)):
        assert min(np.abs(np.array(wanted) - color).max() for color in colors) < 4


def test_overlay_stacks_wide_scans(floorplan):
    result = make_result()
    far = result.plan_from_cams.copy()
    far[0, 0, 3] += 60.0
    image = Image.open(
        io.BytesIO(draw_overlay(floorplan, measure(floorplan, replace(result, plan_from_cams=far))))
    )
    assert image.height > 0.4 * image.width
    assert image.width < 2000


def test_overlay_is_cropped_to_the_scan(floorplan):
    result = make_result()
    outside = np.array([[[500.0, 500.0], [600.0, 500.0]]])
    larger = replace(
        floorplan,
        ends=np.concatenate([floorplan.ends, outside]),
        normals=np.concatenate([floorplan.normals, segments.left_normals(outside)]),
        is_oriented=np.full(5, True),
    )
    assert draw_overlay(larger, measure(larger, result)) == draw_overlay(
        floorplan, measure(floorplan, result)
    )
    crop = crop_to_scan(measure(larger, result))
    assert (crop.low < [0.0, 0.0]).all()
    assert (crop.low > [-2.5, -2.5]).all()
    assert (crop.high > [WIDTH, DEPTH]).all()
    assert (crop.high < [WIDTH + 2.5, DEPTH + 2.5]).all()


def test_close_ups_show_where_it_changed_and_do_not_overlap(floorplan):
    rng = np.random.default_rng(2)
    both = measure(floorplan, make_result())
    xy = rng.uniform([0, 0], [60, 20], (20_000, 2))
    changed = (np.abs(xy - [50, 10]) < 2).all(axis=1) | (np.abs(xy - [20, 5]) < 2).all(axis=1)
    before = replace(both.before, wall_xy=xy, wall_distances_m=0.5 * changed)
    after = replace(both.after, wall_xy=xy, wall_distances_m=0.0 * changed)
    both = replace(both, before=before, after=after)
    marks = choose_close_ups(both, crop_to_scan(both))
    assert [mark.letter for mark in marks] == ["A", "B"]
    middles = sorted(tuple((m.crop.low + m.crop.high) / 2) for m in marks)
    np.testing.assert_allclose(middles, [(20, 5), (50, 10)], atol=1.0)
    assert all(np.allclose(mark.crop.size, 8.0) for mark in marks)


def test_close_ups_are_left_out_of_small_scans(floorplan):
    both = measure(floorplan, make_result())
    assert choose_close_ups(both, crop_to_scan(both)) == ()


def test_statistics_costs_and_times_are_listed(floorplan):
    words = read(floorplan, make_result(), options="[walls]\nsigma_m = 0.05\n").words
    for sentences_of in (
        "frames12",
        "keypoints with depth1 234",
        "pairs of frames tried7",
        "pairs verified2",
        "loop closures (more than 4 keyframes apart)1",
        "matched points3",
        "found on the plan12 (100 %)",
        "floor points480",
        "labelled bymasks",
        "that fits80 %",
        "elsewhere30 %",
        "margin between the two50 percentage points",
        "matched points20050−75 %",
        "recorded motion03from zero",
        "adjust to the plan2.5 s",
        "sum2.5 s",
        "sigma_m = 0.05",
    ):
        assert sentences_of in words, sentences_of


def test_gaps_are_steps_far_above_the_usual():
    x = np.cumsum([0.0, 0.5, 0.5, 5.0, 0.5, 1.5, 0.5])
    np.testing.assert_array_equal(find_gaps(np.stack([x, 0 * x], axis=1)), [2])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (formatting.length(0.0726), "0.073 m"),
        (formatting.length(1.114), "1.11 m"),
        (formatting.length(None), "n/a"),
        (formatting.share(0.9971), "99.7 %"),
        (formatting.share(1.0), "100 %"),
        (formatting.share(0.004), "0.4 %"),
        (formatting.centimetres(-0.0004, signed=True), "0.0 cm"),
        (formatting.centimetres(0.123, signed=True), "+12.3 cm"),
        (formatting.change(0.2, 0.3, "m"), "+50 %"),
        (formatting.change(0.0, 0.3, "m"), "from zero"),
        (formatting.change(0.3, 0.3, "share"), "unchanged"),
        (formatting.count(276002), "276 002"),
    ],
)
def test_quantities(text, expected):
    assert re.sub(r"\s", " ", text) == expected


def test_loop_closures_and_matches_of_frames_are_counted():
    matches = make_result().matches  # two matches of frames 0 and 1, one of 0 and 5
    assert loop_closures_of(matches, 4, np.arange(7)).tolist() == [[0, 5]]
    assert loop_closures_of(matches, 2, np.array([0, 1, 5])).tolist() == []
    assert matches_by_frame(matches, 7).tolist() == [3, 2, 0, 0, 0, 1, 0]


def test_words_are_legible_on_their_grounds_by_day_and_by_night(floorplan):
    text = make_report("scan", floorplan, make_result(), "")
    by_day, by_night = re.findall(r":root \{(.*?)\}", text, re.S)
    colors = {}
    for block in (by_day, by_night):
        colors |= dict(re.findall(r"--(\w+): #(\w+);", block))
        for ground in ("paper", "shade", "good", "fair", "bad", "off"):
            assert contrast(colors["ink"], colors[ground]) >= 4.5
        for words in ("soft", "before", "after", "worse"):
            assert contrast(colors[words], colors["paper"]) >= 4.5


def contrast(first, second):
    """Of two colours in hexadecimal, by WCAG 2.2."""

    def luminance(color):
        wide = color if len(color) == 6 else "".join(2 * digit for digit in color)
        parts = [int(wide[k : k + 2], 16) / 255 for k in (0, 2, 4)]
        linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    dark, light = sorted((luminance(first), luminance(second)))
    return (light + 0.05) / (dark + 0.05)
