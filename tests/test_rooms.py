"""Rooms as built against as planned, on verdicts that are made here."""

import numpy as np
import pytest

from planfit.as_built import AsBuilt, AsBuiltOptions, AsBuiltWall, rooms_as_built
from planfit.units import area, told_in
from test_openings import DOOR, EAST_X, WEST_X, partition, room


def judged(plan, offsets_m):
    """Verdicts with these offsets, by face; other faces were not seen."""
    return AsBuilt(
        tuple(
            AsBuiltWall(k, ends, normal, True, offsets_m.get(k, np.nan), 0.01, 5, 5, 0.0)
            for k, (ends, normal) in enumerate(zip(plan.ends, plan.normals, strict=True))
        ),
        AsBuiltOptions(),
        "plan",
    )


def test_a_door_parts_two_rooms_and_their_areas_follow_the_walls():
    plan = partition(DOOR)
    west = (plan.ends[:, :, 0] == WEST_X).all(axis=1)
    outer = np.flatnonzero((plan.ends[:, :, 0] == 0.0).all(axis=1))
    moved = {int(face): 0.02 for face in np.flatnonzero(west)} | {int(outer[0]): -0.05}
    small, large = sorted(rooms_as_built(plan, judged(plan, moved)), key=lambda one: one.seen_share)
    assert (small.area_m2, large.area_m2) == pytest.approx((4 * (6 - EAST_X), 4 * WEST_X))
    assert (small.seen_share, small.built_area_m2) == (0.0, small.area_m2)
    # The wall moved into the room by 2 cm but for its door, the one that faces it out by 5 cm.
    assert large.built_area_m2 - large.area_m2 == pytest.approx(-0.02 * 3.0 + 0.05 * 4.0)
    assert large.area_sigma_m2 == pytest.approx(0.01 * np.linalg.norm([1.5, 1.5, 4.0]))
    planned, built = large.widths[0].planned_m, large.widths[0].built_m
    assert (planned, built) == pytest.approx((WEST_X, WEST_X + 0.03))
    assert large.widths[1].planned_m == pytest.approx(4.0)
    assert np.isnan(large.widths[1].built_m)


def test_the_inside_of_walls_and_what_is_open_is_no_room():
    (whole,) = rooms_as_built(room(), judged(room(), {}))
    assert whole.area_m2 == pytest.approx(24.0)
    three_walls = room().take(np.arange(3))
    assert rooms_as_built(three_walls, judged(three_walls, {})) == ()


def test_areas_in_words():
    assert area(10.0) == "10.0 m²"
    with told_in("ft"):
        assert float(area(10.0).removesuffix(" sq ft")) == pytest.approx(107.6, abs=0.05)
