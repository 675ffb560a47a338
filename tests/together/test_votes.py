"""How scans are linked: by votes of frames that show the same place."""

import numpy as np
import pytest

from planfit.geometry import se3
from planfit.matching import RelativePoses
from planfit.pipeline.together.placing import Group, group_by_links
from planfit.pipeline.together.votes import Link, link_by_votes

FIRST_FROM_SECOND = se3.yaw_transform(1.1, np.array([4.0, -2.5, 0.0]))


def walk(rng, n):
    """Upright cameras at eye level, in a level frame."""
    yaws = rng.uniform(-np.pi, np.pi, n)
    centres = np.column_stack([rng.uniform(0, 8, (n, 2)), np.full(n, 1.5)])
    looking = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    turns = np.stack([se3.yaw_transform(float(yaw))[:3, :3] @ looking for yaw in yaws])
    return se3.make_transform(turns, centres)


def pairs_of(first, second, place, n, rng):
    """Pairs of frames, as verified where the second scan stands at `place` in the first."""
    pairs = np.column_stack([rng.integers(len(first), size=n), rng.integers(len(second), size=n)])
    motions = se3.inverse(first[pairs[:, 0]]) @ place @ second[pairs[:, 1]]
    return RelativePoses(pairs, motions, np.full(n, 20), np.full(n, 0.3))


@pytest.fixture
def scans():
    rng = np.random.default_rng(4)
    return rng, walk(rng, 60), walk(rng, 50)


def test_right_pairs_give_the_place(scans):
    rng, first, second = scans
    found = pairs_of(first, second, FIRST_FROM_SECOND, 30, rng)
    link = link_by_votes(0, 1, (first, second), found, has_floors=True)
    assert link is not None
    assert link.n_votes == 30
    np.testing.assert_allclose(link.first_from_second, FIRST_FROM_SECOND, atol=1e-6)


def test_scattered_false_pairs_are_outvoted(scans):
    rng, first, second = scans
    found = pairs_of(first, second, FIRST_FROM_SECOND, 20, rng)
    for _ in range(12):
        elsewhere = se3.yaw_transform(rng.uniform(-3, 3), np.array([*rng.uniform(-9, 9, 2), 0.0]))
        found = found.then(pairs_of(first, second, elsewhere, 1, rng))
    link = link_by_votes(0, 1, (first, second), found, has_floors=True)
    assert link is not None
    np.testing.assert_allclose(link.first_from_second, FIRST_FROM_SECOND, atol=0.1)


def test_two_places_with_about_as_many_votes_give_no_link(scans):
    """A room that looks like another is in favour of its own place."""
    rng, first, second = scans
    other = se3.yaw_transform(1.1, np.array([9.0, -2.5, 0.0]))
    found = pairs_of(first, second, FIRST_FROM_SECOND, 20, rng)
    found = found.then(pairs_of(first, second, other, 15, rng))
    assert link_by_votes(0, 1, (first, second), found, has_floors=True) is None


@pytest.mark.parametrize(
    ("place", "has_floors", "is_linked"),
    [
        (se3.yaw_transform(1.0, np.array([1.0, 0.0, 2.9])), True, False),
        (se3.yaw_transform(1.0, np.array([1.0, 0.0, 2.9])), False, True),
        (se3.make_transform(se3.exp_so3(np.array([0.3, 0, 0])), np.zeros(3)), True, False),
    ],
    ids=["a storey higher", "floors not seen", "tilted"],
)
def test_a_scan_is_neither_lifted_nor_tilted(scans, place, has_floors, is_linked):
    rng, first, second = scans
    found = pairs_of(first, second, place, 30, rng)
    link = link_by_votes(0, 1, (first, second), found, has_floors)
    assert (link is not None) == is_linked


def test_frames_of_one_moment_are_one_vote(scans):
    """Twenty pairs between the same two runs of frames share their errors: they are no two places."""
    rng, first, second = scans
    found = pairs_of(first[:8], second[:8], FIRST_FROM_SECOND, 20, rng)
    assert link_by_votes(0, 1, (first, second), found, has_floors=True) is None


def test_scans_are_linked_over_others_the_surest_links_first():
    a_from_b = se3.yaw_transform(0.4, np.array([1.0, 2.0, 0.0]))
    b_from_c = se3.yaw_transform(-1.0, np.array([3.0, 0.0, 0.0]))
    wrong = se3.yaw_transform(2.0, np.array([9.0, 9.0, 0.0]))
    links = [Link(1, 2, b_from_c, 9, 3.0), Link(0, 1, a_from_b, 9, 2.0), Link(0, 2, wrong, 3, 0.5)]
    groups = group_by_links(4, links)
    assert [group.members for group in groups] == [(0, 1, 2), (3,)]
    np.testing.assert_allclose(groups[0].root_from_levels[1], a_from_b, atol=1e-12)
    np.testing.assert_allclose(groups[0].root_from_levels[2], a_from_b @ b_from_c, atol=1e-12)
    assert isinstance(groups[1], Group)
