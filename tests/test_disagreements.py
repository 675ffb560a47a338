"""Which evidence contradicts which: a suspect is told, with what it stands against, and nothing else."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest

import planfit
from builders import make_matches, make_structure, room_scan
from planfit.adjust import moved_walls
from planfit.corrections import AddedLoop
from planfit.export.record import make_record
from planfit.geometry import se3
from planfit.pipeline.disagreements import Disagreement, Eased, EvidenceItem
from planfit.pipeline.options import RefineOptions
from planfit.report.html.evidence_sections import disagreement_section
from planfit.scan.statistics import lift_pixel
from test_corrections import (
    NO_MATCHES,
    by_hand,
    floor_of,
    joined,
    l_shaped_world,
    seen,
    straight_walk,
)

UV = (80.0, 60.0)
LOOPS = (2, 3, 4, 13, 14, 22)
"""Frames that a frame of the way back sees again."""


def walk_there_and_back(pairs):
    """A corridor walked to its end and back by the same places, pairs of frames matched: its truth, scan and
    observations."""
    rng = np.random.default_rng(0)
    out = straight_walk(30)
    true = np.concatenate([out, out[::-1]])
    points = rng.uniform([-1, 2, 0], [10, 4, 2.5], (400, 3))
    matches = []
    for i, j in pairs:
        near = points[np.abs(points[:, 0] - true[i, 0, 3]) < 1.5]
        matches.append(make_matches(true, [(i, j)], near))
    observations = seen(make_structure(true, floor_of(true, rng)), joined(matches), true)
    return true, replace(room_scan(true), has_color=False), observations


@pytest.fixture(scope="module")
def there_and_back():
    """With loops in between, and no other pairs."""
    return walk_there_and_back([(i, 59 - i) for i in LOOPS])


def picked_wrongly(scan, true, i, j, off_m):
    """Pixels of frames i and j; the second shows what lies off by some metres along x."""
    point = se3.transform(se3.inverse(true[j]) @ true[i], lift_pixel(scan, i, UV)[None])[0]
    other = scan.cameras[j].project((point + np.array([off_m, 0, 0]))[None])[0].round(1)
    return UV, tuple(map(float, other))


def test_nothing_contradicts_anything_in_a_faultless_walk(there_and_back):
    _, scan, observations = there_and_back
    result = planfit.refine(scan, None, observations=observations)
    assert result.evidence.disagreements == ()
    assert "Nothing" in disagreement_section(())


def test_a_false_loop_is_told_with_the_steps_that_it_bends(there_and_back):
    true, scan, observations = there_and_back
    loops = [
        AddedLoop(k, (i, 59 - i), picked_wrongly(scan, true, i, 59 - i, 0.6))
        for k, i in enumerate((17, 18), 1)
    ]
    result = planfit.refine(scan, None, observations=observations, corrections=by_hand(*loops))
    (told,) = result.evidence.disagreements
    assert told.item == EvidenceItem("loop by hand", (17, 18), (41, 42))
    # The walk gives way; without the loop it is as far off as it was picked wrongly.
    assert told.after_m < 0.2
    assert told.kept_out_m == pytest.approx(0.6, abs=0.02)
    # The steps about the frames, there and back, and none of the others.
    assert {each.item.kind for each in told.eased} == {"recorded motion"}
    runs = [each.item.first_frames for each in told.eased]
    assert sorted(runs) == [(12, 23), (36, 47)]
    assert sum(each.by_m for each in told.eased) > 0.5
    record = make_record("0", {}, scan, None, RefineOptions(), result)
    (row,) = record["verdict"]["disagreements"]
    assert row["words"] == told.sentence
    assert "loop by hand between frames 17-18 and 41-42" in row["words"]


def test_a_loop_picked_rightly_stands_against_nothing(there_and_back):
    true, scan, observations = there_and_back
    loop = AddedLoop(1, (17, 42), picked_wrongly(scan, true, 17, 42, 0.0))
    result = planfit.refine(scan, None, observations=observations, corrections=by_hand(loop))
    (told,) = result.evidence.disagreements
    assert told.kept_out_m < 0.06  # a pixel's width at that distance, and the walk's own sigma
    assert told.eased == ()


def test_a_wall_drawn_elsewhere_is_told(rng):
    """One of two walls that hold x is drawn 0.15 m off, and is not named as moved: that is off."""
    true, built, structure = l_shaped_world(rng)
    ends = built.ends.copy()
    ends[1, :, 0] += 0.15
    options = RefineOptions().with_("align.start", "0,0,0")
    observations = seen(structure, NO_MATCHES, true)
    plan = replace(built, ends=ends)
    with patch.object(moved_walls, "MIN_OFFSET_M", 0.6):
        result = planfit.refine(room_scan(true), plan, options, observations=observations)
    (told,) = (each for each in result.evidence.disagreements if each.item.face_idx == 1)
    assert told.kept_out_m == pytest.approx(0.15, abs=0.02)
    assert "wall from (6.15, 0.00) to (6.15, 4.00)" in told.sentence
    right = planfit.refine(room_scan(true), built, options, observations=observations)
    assert right.evidence.disagreements == ()


def test_frames_and_walls_of_the_section_can_be_pressed():
    loop, wall = (
        EvidenceItem("loop", (0, 11), (48, 59)),
        EvidenceItem("wall", face_idx=7, ends=((0.0, 1.0), (2.0, 1.0))),
    )
    html = disagreement_section([Disagreement(loop, 0.02, 0.5, (Eased(wall, 0.3),))])
    for frame in (0, 11, 48, 59):
        assert f'data-frame="{frame}">{frame}</span>' in html
    assert '<span data-wall="7">wall from (0.00, 1.00) to (2.00, 1.00)</span>' in html
