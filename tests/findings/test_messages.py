"""Every kind is told as the page of findings tells it, by the facts that stand there."""

import json
import re

import numpy as np
import pytest

from finding_records import KINDS, PAGE, check_findings
from planfit.findings import (
    Finding,
    PlanKind,
    PoseKind,
    ResultKind,
    ScanKind,
    SurveyKind,
    finding_record,
)

ROWS = re.findall(r"^\| `(\w+)` \| (\w+) \| `(\{.*\})` \| (.*) \|$", PAGE, re.MULTILINE)


def frozen(value):
    return tuple(map(frozen, value)) if isinstance(value, list) else value


def made(kind, facts=None, frames=(), faces=(), parts=()):
    return Finding(
        KINDS[kind],
        {name: frozen(value) for name, value in (facts or {}).items()},
        frozen(list(frames)),
        frozen(list(faces)),
        tuple(made(**part) for part in parts),
    )


def test_the_page_has_every_kind_once_in_the_order_of_the_tables():
    assert [row[0] for row in ROWS] == list(KINDS)
    # Kinds of one value would be one member.
    assert len(KINDS) == sum(
        len(kinds.__members__) for kinds in (ScanKind, PoseKind, PlanKind, ResultKind, SurveyKind)
    )


@pytest.mark.parametrize(("kind", "severity", "example", "words"), ROWS, ids=[r[0] for r in ROWS])
def test_facts_are_told_to_the_letter(kind, severity, example, words):
    found = made(kind, **json.loads(example))
    assert found.sentence == words
    assert found.severity == severity
    check_findings([finding_record(found)])
    if not found.advice:
        assert found.sentence == found.words


def test_a_finding_of_one_of_several_scans_names_it_first():
    lines = Finding(PlanKind.SINGLE_LINES)
    assert lines.about("cellar").sentence == f"cellar: {lines.sentence}"
    assert lines.about("storey 1").about("cellar").sentence == f"cellar: storey 1: {lines.sentence}"


def test_facts_that_words_need_are_asked_for_at_once():
    with pytest.raises(
        ValueError, match=r"MARGIN: expected the facts \['other_wall_share', 'wall_"
    ):
        Finding(PlanKind.LITTLE_MARGIN, {"wall_share": 0.5})


@pytest.mark.parametrize(
    ("kind", "facts", "words"),
    [
        (PlanKind.POINTS_AGAINST_WALLS, {"points": (), "offs_m": ()}, "with them: check them"),
        (
            PlanKind.POINTS_AGAINST_WALLS,
            {"points": tuple("ABCDEFGH"), "offs_m": (1.0,) * 8},
            "F (1.00 m off there), 2 more",
        ),
        (PlanKind.PLAN_RESCALED, {"scale_ratio": 1 / 1.05, "sigma_share": 0.001}, "5.0% too large"),
        (PlanKind.PLAN_MIRRORED, {"was_mirrored": True}, "run again without --mirror"),
        (
            PlanKind.AMBIGUOUS_PLACE,
            {"other_metres_per_unit": 0.5},
            "(--scale 1:100, or metres a unit)",
        ),
        (PlanKind.LITTLE_WALL_ON_PLAN, {"is_plan_metric": False}, "plan of this building?"),
        (PlanKind.THICKNESS_FITTED, {"drawn_thickness_m": 0.03}, "as strokes 0.03 m thick: "),
        (PoseKind.CLOCK_CORRECTED, {"offset_s": -0.02, "offset_frames": -0.6}, "20 ms earlier"),
        (PoseKind.CLOCK_CORRECTED, {"rate": -0.004}, "half way, and 4 ms earlier each second"),
        (ScanKind.NO_MATCHES, {"has_plan": False, "has_colour": True}, "by the floor alone; check"),
        (ResultKind.FRAMES_NOT_FIXED, {"direction": None}, "are not fixed: they may be off"),
    ],
)
def test_words_follow_the_facts(kind, facts, words):
    (example,) = (json.loads(row[2]) for row in ROWS if row[0] == kind.code)
    example["facts"] = example.get("facts", {}) | facts
    assert words in made(kind.code, **example).sentence


@pytest.mark.parametrize("n_walls", [1, 5, 7])
def test_of_many_moved_walls_the_first_are_named(n_walls):
    (example,) = (json.loads(row[2]) for row in ROWS if row[0] == "wall_moved")
    wall = made("wall_moved", **example)
    found = Finding(ResultKind.WALLS_MOVED, parts=(wall,) * n_walls)
    assert found.sentence.count(wall.sentence) == min(n_walls, 5)
    assert ("and 2 more" in found.sentence) == (n_walls == 7)
    assert found.sentence.startswith("1 wall stands" if n_walls == 1 else f"{n_walls} walls stand")


@pytest.mark.parametrize(
    ("share", "told"),
    [
        *((0.947, "94%"), (0.9499, "94%"), (0.95, "95%"), (1.0, "100%"), (0.29, "29%")),
        (np.nan, "an unknown share"),
    ],
)
def test_a_share_that_a_limit_is_asked_of_is_never_rounded_up_to_it(share, told):
    facts = {"predicted_rms_m": 0.2, "within_share": share, "tolerance_m": 0.15}
    assert f"(RMS): {told} of them" in made("all_may_be_off", facts, ((0, 49),)).sentence


def test_a_record_is_plain_json():
    facts = {"wall_share": np.float64(0.5), "other_wall_share": float("nan")}
    record = finding_record(Finding(PlanKind.LITTLE_MARGIN, facts, ((1, 2),), (3,)).about("cellar"))
    assert json.loads(json.dumps(record, allow_nan=False)) == record
    assert record["facts"] == {"wall_share": 0.5, "other_wall_share": None}
    assert (record["kind"], record["severity"]) == ("little_margin", "warning")
    assert (record["frames"], record["faces"], record["subject"]) == ([[1, 2]], [3], "cellar")
