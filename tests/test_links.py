"""Links of the registration: what two stretches of the walk share, against slow and obvious twins."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import planfit
from planfit.export.tables import write_registration
from planfit.geometry import se3
from planfit.matching import SurfacePairs
from planfit.pipeline.links import CUBE_M, WITHIN_CUBES, Link
from planfit.pipeline.registration import register
from planfit.report.html.evidence_sections import MAX_ROWS, registration_section
from test_disagreements import LOOPS, walk_there_and_back
from test_registration import evidence_of


@pytest.fixture(scope="module")
def there_and_back():
    """A corridor walked to its end and back by the same places."""
    pairs = [(i, 59 - i) for i in LOOPS] + [(i, i + 1) for i in range(59)]
    _, scan, observations = walk_there_and_back(pairs)
    return planfit.refine(scan, None, observations=observations)


def floor_seen(result, frames):
    """Floor points that frames see."""
    floor = result.structure.floor
    return np.concatenate(
        [
            se3.transform(
                result.plan_from_cams[i], floor.points_cam[floor.start[i] : floor.start[i + 1]]
            )
            for i in range(frames[0], frames[1] + 1)
        ]
    )


def share_shared(a, b):
    """Share of a's area near b: a point counts by how few others of its kind are about it."""
    near_own, near_other = (np.linalg.norm(a[:, None] - of, axis=2) for of in (a, b))
    weight = 1.0 / (near_own < CUBE_M).sum(axis=1)
    return weight @ (near_other.min(axis=1) <= WITHIN_CUBES * CUBE_M) / weight.sum()


def distances_of(result, poses, link):
    """Of each match between both stretches, one by one; and how many pairs of frames they are of."""
    found, n_pairs, matches = [], 0, result.matches
    for k, (i, j) in enumerate(matches.pairs):
        (a, b), (c, d) = link.first_frames, link.last_frames
        if not (a <= i <= b and c <= j <= d):
            continue
        n_pairs += 1
        for m in range(matches.start[k], matches.start[k + 1]):
            ends = [
                se3.transform(poses[f], p[m][None])[0]
                for f, p in ((i, matches.points_a), (j, matches.points_b))
            ]
            found.append(np.linalg.norm(ends[0] - ends[1]))
    return np.array(found), n_pairs


def test_links_by_slow_twins(there_and_back):
    result = there_and_back
    links = result.evidence.links
    assert len(links) > 5
    stretches = [each.frames for each in result.evidence.stretches]
    neighbours = set(pairwise(stretches))
    assert neighbours <= {(link.first_frames, link.last_frames) for link in links}
    visits = {(v.first_frames, v.last_frames): v for v in result.evidence.visits}
    for link in links:
        seen_by = [floor_seen(result, frames) for frames in (link.first_frames, link.last_frames)]
        shared = [share_shared(*order) for order in (seen_by, seen_by[::-1])]
        assert min(abs(link.overlap - each) for each in shared) < 0.05
        after_m, n_pairs = distances_of(result, result.plan_from_cams, link)
        before_m, _ = distances_of(result, result.initial_plan_from_cams, link)
        assert (link.n_points, link.n_pairs) == (len(after_m), n_pairs)
        assert link.after_m == pytest.approx(after_m.mean(), abs=1e-9)
        assert link.before_m == pytest.approx(before_m.mean(), abs=1e-6)
        visit = visits.pop((link.first_frames, link.last_frames), None)
        if visit is not None:
            assert visit.mean_m == pytest.approx(link.after_m)
    assert visits == {}  # each is a link too


def test_surfaces_are_asked_only_where_they_hold(rng):
    """Two cameras that slid along a corridor: its walls say nothing of that, and all of the way across."""
    motion = se3.make_transform(np.eye(3), np.array([0.0, 0.5, 0.0]))
    pairs = SurfacePairs(
        pairs=np.array([[0, 1]]),
        a_from_b=motion[None],
        information=np.diag([1e4, 1e4, 1e4, 0.0, 1e4, 1e4])[None],
        explained=np.ones(1),
        by_sensor=np.zeros((1, 6, 7)),
        distance_m=np.ones(1),
    )
    poses = np.stack([np.eye(4), se3.make_transform(np.eye(3), np.array([3.0, 0.5, 0.2]))])
    moved = se3.make_transform(se3.exp_so3(rng.normal(size=3)), rng.normal(size=3)) @ poses
    for each in (poses, moved):
        assert pairs.held_off_m(each) == pytest.approx([0.2])
    assert SurfacePairs.none().held_off_m(poses).shape == (0,)


def test_on_the_page_and_in_the_table_the_worst_first(tmp_path):
    links = [Link((0, 3), (4, 7), 0.8, 0.5, 0.01 + 0.001 * k, 30, 4) for k in range(MAX_ROWS + 2)]
    by_surfaces = Link((4, 7), (15, 19), float("nan"), 0.9, 0.4, 0, 2)
    found = register(replace(evidence_of(0.002), links=(*links, by_surfaces)), (), None)
    assert found.links[0] == by_surfaces
    write_registration(tmp_path / "registration.csv", found)
    lines = (tmp_path / "registration.csv").read_text().splitlines()
    told = [line for line in lines if line.startswith('"link of')]
    assert len(told) == 2 * (MAX_ROWS + 3)
    assert told[:2] == [
        '"link of frames 4-7 and 15-19, mean distance",m,0.900000,0.400000,,0',
        '"link of frames 4-7 and 15-19, overlap",share,,,,2',
    ]
    assert told[3] == '"link of frames 0-3 and 4-7, overlap",share,,0.800000,,4'
    page = registration_section(found).replace("\u00a0", " ")
    assert "; 3 more are in <code>registration.csv</code>" in page
    assert page.count("80 %") == MAX_ROWS - 1
    assert page.index("0.400 m") < page.index("0.031 m")
