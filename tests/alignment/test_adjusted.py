"""The alignment judged again with adjusted walls: sure where it is right, whatever it was before."""

from dataclasses import replace

import numpy as np
import pytest

from builders import faces_plan, room_plan
from planfit.alignment import AlignOptions, align, judge_adjusted, sample_walls
from planfit.findings import PlanKind
from planfit.floorplan import Floorplan
from planfit.geometry import se3

OPTIONS = AlignOptions()


@pytest.fixture(scope="module")
def office():
    """Three rooms beside each other, no two alike."""
    rooms = [
        faces_plan([[x, 0], [x + w, 0], [x + w, d], [x, d]])
        for x, w, d in ((0, 6, 4), (6.2, 5, 5), (11.4, 3, 7))
    ]
    ends = np.concatenate([room.ends for room in rooms])
    return replace(rooms[0], ends=ends, normals=np.concatenate([r.normals for r in rooms]),
                   is_oriented=np.ones(len(ends), dtype=bool))  # fmt: skip


def walls_of(floorplan, keep=slice(None)):
    eyes = floorplan.ends[keep].mean(axis=1) + floorplan.normals[keep]
    return sample_walls(floorplan.normals[keep], floorplan.ends[keep], seen_from=eyes)


def turned(walls, yaw, shift):
    """Walls as they were before: in axes of their own."""
    back = se3.inverse(se3.yaw_transform(yaw, np.array([*shift, 0.0])))
    rotation, translation = back[:2, :2], back[:2, 3]
    return replace(
        walls,
        xy=walls.xy @ rotation.T + translation,
        normals=walls.normals @ rotation.T,
        seen_from=walls.seen_from @ rotation.T + translation,
    )


def test_adjusted_walls_on_their_plan_are_sure_though_they_were_bent_before(office):
    walls = walls_of(office)
    before = align(turned(walls, 0.3, (5.0, 2.0)), office, OPTIONS)
    bent = replace(before, is_sure=False, score=0.3, findings=())
    judged = judge_adjusted(walls, office, bent, OPTIONS)
    assert judged.doubt is None
    assert judged.score > 0.99
    assert judged.seen_through == 0.0
    # The competitor is looked for with the adjusted walls, in the plan's axes.
    assert 0.0 < judged.runner_up_score < 0.8


def test_walls_beside_the_plan_are_doubted(office):
    walls = walls_of(office)
    found = align(walls, office, OPTIONS)
    off = replace(walls, xy=walls.xy + np.array([0.4, 0.4]))
    judged = judge_adjusted(off, office, replace(found, candidates=()), OPTIONS)
    assert judged.score < 0.3
    assert judged.doubt.kind is PlanKind.ADJUSTED_LITTLE_WALL


def test_a_symmetric_room_is_sure_only_where_its_place_was_given():
    plan = room_plan()
    walls = walls_of(plan)
    found = align(walls, plan, OPTIONS)
    assert (
        judge_adjusted(walls, plan, found, OPTIONS).doubt.kind is PlanKind.ADJUSTED_FITS_ELSEWHERE
    )
    given = replace(found, is_as_recorded=True)
    assert judge_adjusted(walls, plan, given, OPTIONS).doubt is None
    assert judge_adjusted(walls, plan, found, AlignOptions(candidate=2)).doubt is None


def test_a_given_place_that_another_beats_is_doubted(office):
    # Two of three rooms lie 1.5 m off: the third alone holds the place that was recorded.
    walls = walls_of(office)
    shifted = replace(walls, xy=walls.xy + np.where(walls.xy[:, :1] > 6.1, 1.5, 0.0) * [1.0, 0.0])
    found = replace(align(walls, office, OPTIONS), is_as_recorded=True)
    other = align(shifted, office, OPTIONS)
    rivals = replace(found, candidates=(*found.candidates, *other.candidates))
    judged = judge_adjusted(shifted, office, rivals, OPTIONS)
    assert judged.runner_up_score > judged.score
    assert judged.doubt.kind is PlanKind.ADJUSTED_FITS_ELSEWHERE


def test_a_plan_that_lacks_half_of_the_walls_is_sure_where_no_wall_is_seen_through(office):
    lacking = Floorplan("half", office.ends[::2], office.normals[::2], office.is_oriented[::2])
    walls = walls_of(office)
    found = replace(align(walls, lacking, OPTIONS), is_as_recorded=True, candidates=())
    judged = judge_adjusted(walls, lacking, found, OPTIONS)
    assert 0.25 < judged.score < 0.6
    assert judged.doubt is None


def test_a_plan_that_was_seen_through_is_doubted_though_the_place_was_given(office):
    # A hall seen from its middle. Of what is taken for its plan, two walls stand where some were seen.
    hall = faces_plan([[0, 0], [12, 0], [12, 8], [0, 8]])
    walls = replace(walls_of(hall), seen_from=np.full_like(walls_of(hall).seen_from, [6.0, 4.0]))
    rooms = [faces_plan([[x, 1], [x + 2, 1], [x + 2, 4], [x, 4]]) for x in (1, 3.5, 7, 9.5)]
    drawn = [hall.ends[:2], *(room.ends for room in rooms)]
    facing = [hall.normals[:2], *(room.normals for room in rooms)]
    ends, normals = np.concatenate(drawn), np.concatenate(facing)
    other = Floorplan("another building", ends, normals, np.ones(len(ends), dtype=bool))
    lacking = Floorplan("two walls", ends[:2], normals[:2], np.ones(2, dtype=bool))
    found = replace(align(walls, hall, OPTIONS), is_as_recorded=True, candidates=())
    judged = judge_adjusted(walls, other, found, OPTIONS)
    assert judged.score > 0.25
    assert judged.evidence.is_seen_through
    assert judged.doubt.kind is PlanKind.ADJUSTED_SEEN_THROUGH
    # The same two alone, where others are not drawn at all, is a plan that lacks walls.
    assert judge_adjusted(walls, lacking, found, OPTIONS).doubt is None
    # Where surveyed points put the scan, its place is known, whatever the plan.
    surveyed = replace(found, is_surveyed=True)
    assert judge_adjusted(walls, other, surveyed, OPTIONS).doubt is None


def test_a_mirrored_plan_is_doubted(office):
    walls = walls_of(office)
    found = replace(align(walls, office, OPTIONS), is_mirrored=True)
    assert judge_adjusted(walls, office, found, OPTIONS).doubt.kind is PlanKind.ADJUSTED_MIRRORED
