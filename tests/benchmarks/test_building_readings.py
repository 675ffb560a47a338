"""Files that are only read: how a reading ends, facts within tolerances, no file at hand without a case."""

import pickle
from dataclasses import replace
from pathlib import Path

import cv2
import ezdxf
import numpy as np
import pytest
from buildings import plan_checks, reading_cases
from buildings.plan_readings import doubts_of, plan_cases
from buildings.reading_cases import (
    ReadingCase,
    case_of,
    fact_at_least,
    fact_at_most,
    fact_between,
    fact_same,
    fact_within,
    names_one_of,
    present,
    read_or_refused,
)
from buildings.recordings import recording_cases
from buildings.rows import DOUBTED, REFUSED, RIGHT, SILENT, Fact, Reading
from faults.scans import SHARED

from planfit.errors import FloorplanError
from planfit.floorplan import Floorplan, PlanSource

RIGHT_FACT, WRONG_FACT = (Fact("doors", "2", found, found == "2") for found in ("2", "0"))


@pytest.mark.parametrize(
    ("reading", "outcome"),
    [
        (Reading((RIGHT_FACT,)), RIGHT),
        (Reading((RIGHT_FACT,), doubts=("look at it",), exit_code=1), RIGHT),
        (Reading((RIGHT_FACT, WRONG_FACT)), SILENT),
        (Reading((WRONG_FACT,), doubts=("look at it",)), DOUBTED),
        (Reading((WRONG_FACT,), exit_code=1), DOUBTED),
        (Reading((), "cannot be read", exit_code=2), REFUSED),
        (Reading((), "give --storey", exit_code=2, is_refusal_right=True), RIGHT),
    ],
)
def test_how_a_reading_ends(reading: Reading, outcome: str) -> None:
    assert reading.outcome == outcome


def test_numbers_are_right_within_tolerances_and_at_their_ends() -> None:
    assert fact_within("m", 12.0, 12.125, 0.125).is_right
    assert not fact_within("m", 12.0, 12.13, 0.125).is_right
    assert [fact_between("m", 2, 3, v).is_right for v in (1.9, 2, 3, 3.1)] == [0, 1, 1, 0]
    assert [fact_at_least("share", 0.9, v).is_right for v in (0.89, 0.9)] == [False, True]
    assert [fact_at_most("share", 0.1, v).is_right for v in (0.1, 0.11)] == [True, False]
    assert not any(
        make(float("nan")).is_right
        for make in (
            lambda v: fact_within("m", 1.0, v, 0.1),
            lambda v: fact_between("m", 0.0, 2.0, v),
            lambda v: fact_at_least("m", 0.0, v),
            lambda v: fact_at_most("m", 2.0, v),
        )
    )
    assert fact_same("frames", 12, 12) == Fact("frames", "12", "12", True)
    assert fact_within("m", 12.0, 7.5, 0.125) == Fact("m", "12 +- 0.12", "7.5", False)


def refuse() -> Reading:
    """As a reader does."""
    raise FloorplanError("/data/give --layer/plan.dxf: expected walls, found none; give --storey")


def test_a_refusal_is_right_where_it_names_the_step_and_not_where_the_folder_does() -> None:
    path = Path("/data/give --layer/plan.dxf")
    told = read_or_refused(refuse, ("--STOREY",), path)
    assert (told.outcome, told.exit_code) == (RIGHT, 2)
    assert told.refusal.endswith("give --storey")
    assert read_or_refused(refuse, ("--layer",), path).outcome == REFUSED
    assert read_or_refused(refuse).outcome == REFUSED
    assert names_one_of("give --layer", ("--storey", "--layer"))


def test_other_errors_are_no_refusals() -> None:
    with pytest.raises(ZeroDivisionError):
        read_or_refused(lambda: 1 // 0)  # pyright: ignore[reportArgumentType]


def test_a_case_is_there_where_its_file_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reading_cases, "SHARED", tmp_path)
    case = case_of("plan", "plans", "a", "floorplans/a.svg", refuse)
    assert case.name == "plan a"
    assert not present(case)
    (tmp_path / "floorplans").mkdir()
    (tmp_path / "floorplans" / "a.svg").touch()
    assert present(case)


def all_reading_cases() -> tuple[ReadingCase, ...]:
    """Plans and recordings."""
    return (*plan_cases(), *recording_cases())


def test_names_are_unique_cases_can_be_sent_to_processes_and_a_third_is_quick() -> None:
    cases = all_reading_cases()
    assert len({case.name for case in cases}) == len(cases)
    assert [pickle.loads(pickle.dumps(case)).name for case in cases] == [c.name for c in cases]
    assert 0 < sum(case.is_short for case in cases) <= len(cases) / 3


@pytest.mark.shared
@pytest.mark.skipif(not SHARED.is_dir(), reason="no real plans: set PLANFIT_SHARED to their folder")
def test_every_file_at_hand_has_a_case() -> None:
    cases = all_reading_cases()
    paths = {case.path for case in cases}
    field = [*(SHARED / "field" / "plans").iterdir(), *(SHARED / "field" / "scans").iterdir()]
    folders = {str(folder.relative_to(SHARED)) for folder in field}
    without = {f for f in folders if not any(f"{path}/".startswith(f"{f}/") for path in paths)}
    assert not without
    files = {str(p.relative_to(SHARED)) for p in (SHARED / "floorplans").rglob("*") if p.is_file()}
    assert files <= paths
    assert [case.name for case in cases if not present(case)] == []


def square(**changes: object) -> Floorplan:
    """A room of 4 x 3, y down as in a picture, by its inner faces."""
    corners = np.array([(0, 0), (4, 0), (4, -3), (0, -3)], float) * 100
    ends = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
    return Floorplan.from_segments(ends, name="square", **changes)  # pyright: ignore[reportArgumentType]


def facts_right(facts) -> list[bool]:
    return [fact.is_right for fact in facts]


def test_sizes_and_lengths_of_a_room() -> None:
    plan = square()
    assert facts_right(plan_checks.sides(plan, (400.0, 300.0), 1.0, "m")) == [True] * 3
    assert facts_right(plan_checks.sides(plan, (300.0,), 1.0, "px")) == [False, False]
    assert facts_right(plan_checks.length(plan, 1399.0, 1401.0)) == [True]
    assert facts_right(plan_checks.proportion(plan, 4 / 3)) == [True]
    assert facts_right(plan_checks.plans_on_sheet(plan, 1)) == [True]
    assert facts_right(plan_checks.gaps(plan, 1, 9)) == [False]
    assert facts_right(plan_checks.along_axes(plan, 0.99)) == [True]


def test_notes_are_no_doubts() -> None:
    note = "2 plans on one sheet, probably storeys: 0 (left), 1 (right)"
    plan = square().with_warning(note).with_warning("the page holds a picture that was not read")
    assert doubts_of(plan) == ("the page holds a picture that was not read",)


def drawn(ends: list, name: str = "drawn") -> Floorplan:
    """Faces as a reader gives them of a file with y down."""
    plan = Floorplan.from_segments(np.array(ends, float) * (1, -1), name=name, is_metric=False)
    return replace(plan, source=PlanSource(file_from_plan=np.diag([1.0, -1.0, 1.0])))


def outline(u0: int, v0: int, u1: int, v1: int) -> list:
    """Sides of a rectangle."""
    return [[(u0, v0), (u1, v0)], [(u1, v0), (u1, v1)], [(u1, v1), (u0, v1)], [(u0, v1), (u0, v0)]]


def test_walls_that_were_missed_and_faces_where_there_are_none() -> None:
    lines = ((0.0, 0.0, 400.0, 0.0, 400.0, 300.0),)
    both = [[(0, 0), (400, 0)], [(400, 0), (400, 300)]]
    for ends, right in (
        (both, [True, True]),
        (both[:1], [False, True]),
        ([*both, [(0, 200), (300, 200)]], [True, False]),
    ):
        assert facts_right(plan_checks.lines_of_file(drawn(ends), lines, 5.0, 0.9)) == right
    assert facts_right(plan_checks.outer_walls(drawn(both[:1]), lines, 0.5)) == [True]


def test_grey_bodies_are_walls_and_signs_are_not(tmp_path: Path) -> None:
    image = np.full((300, 400, 3), 255, np.uint8)
    image[100:120, 50:350] = plan_checks.WALL_GREY
    image[200:260, 50:110] = (0, 0, 220)
    name = str(tmp_path / "escape.png")
    cv2.imwrite(name, image)
    wall, sign = outline(49, 99, 350, 120), outline(50, 200, 110, 260)
    assert facts_right(plan_checks.grey_bodies(drawn(wall, name))) == [True, True]
    assert facts_right(plan_checks.grey_bodies(drawn(sign, name))) == [False, False]
    assert facts_right(plan_checks.grey_bodies(drawn(wall + sign, name))) == [True, False]


def test_faces_lie_on_ink(tmp_path: Path) -> None:
    image = np.full((300, 400, 3), 255, np.uint8)
    cv2.rectangle(image, (50, 50), (350, 250), (60, 60, 60), 1)
    name = str(tmp_path / "lines.png")
    cv2.imwrite(name, image)
    room = outline(50, 50, 350, 250)
    assert facts_right(plan_checks.on_ink(drawn(room, name))) == [True, True]
    across = [*room, [(50, 50), (350, 250)]]
    assert facts_right(plan_checks.on_ink(drawn(across, name))) == [True, False]
    assert facts_right(plan_checks.on_ink(drawn(room[:2], name))) == [False, True]


def test_doors_half_open(tmp_path: Path) -> None:
    """A wall of 6 m along y = 0 with a door from 1 to 1.9 m and one from 3 to 3.9 m, cm."""
    drawing = ezdxf.new()  # pyright: ignore[reportPrivateImportUsage]
    leaf = 90 * np.array([np.cos(np.deg2rad(30)), np.sin(np.deg2rad(30))])
    for x in (100, 300):
        drawing.modelspace().add_arc((x, 0), 90, 0, 30)
    name = str(tmp_path / "doors.dxf")
    drawing.saveas(name)
    leaves = [[(x, 0), (x + leaf[0], leaf[1])] for x in (100, 300)]
    pieces = [[(0, 0), (100, 0)], [(190, 0), (300, 0)], [(390, 0), (600, 0)]]
    whole = [[(0, 0), (600, 0)]]
    assert facts_right(plan_checks.doors_ajar(drawn(pieces, name))) == [True, True]
    assert facts_right(plan_checks.doors_ajar(drawn(whole, name))) == [True, False]
    assert facts_right(plan_checks.doors_ajar(drawn(pieces + leaves, name))) == [False, True]
