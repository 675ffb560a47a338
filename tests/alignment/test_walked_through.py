"""What the camera walked through and saw through, against slow and obvious ways."""

import numpy as np
import pytest

from builders import faces_plan, room_plan
from planfit.alignment import AlignmentHypothesis, PlanEvidence, plan_evidence, sample_walls
from planfit.alignment.evidence import WALKED_FREELY, evidence_findings, with_way
from planfit.alignment.visibility import crosses_face
from planfit.alignment.wall_samples import WallSamples
from planfit.floorplan import Floorplan
from planfit.floorplan.nearest_faces import END_MARGIN_M

HERE = AlignmentHypothesis(0.0, np.zeros(2), 0.0)


@pytest.fixture(scope="module")
def plan():
    """A room of 8 x 5 m."""
    return room_plan(8.0, 5.0)


def seen(plan, eyes):
    """All faces of the plan, each from one of the eyes in turn."""
    eyes = np.array(eyes)[np.arange(len(plan)) % len(eyes)]
    return sample_walls(plan.normals, plan.ends, seen_from=eyes)


def with_wall(plan, ends):
    """The plan with one more line, seen from either side."""
    more = faces_plan([*np.array(ends, dtype=float)])
    return Floorplan(
        "more",
        np.concatenate([plan.ends, more.ends[:1]]),
        np.concatenate([plan.normals, more.normals[:1]]),
        np.append(plan.is_oriented, False),
    )


def test_a_right_plan_is_neither_walked_nor_seen_through(plan):
    middle = plan.ends.mean(axis=(0, 1))
    found = plan_evidence(seen(plan, [middle, middle + 0.5]), plan, HERE)
    assert found.walked_through_share == 0.0
    assert found.seen_through_share < 0.02
    assert found.judged_m == pytest.approx(plan.lengths.sum(), rel=0.05)


def test_a_wall_that_the_camera_walked_and_saw_through(plan):
    low = plan.ends.reshape(-1, 2).min(axis=0)
    wall = low + np.array([[4.0, 1.0], [4.0, 4.0]])
    walls = seen(plan, low + np.array([[3.2, 2.5], [4.8, 2.5]]))
    found = plan_evidence(walls, with_wall(plan, wall), HERE)
    assert found.walked_through_share == 1.0
    # 3 m of it, beside 26 m of wall.
    assert found.seen_through_share == pytest.approx(3 / 29, abs=0.03)


def test_a_way_through_walls_takes_from_the_score(plan):
    low = plan.ends.reshape(-1, 2).min(axis=0)
    lines = with_wall(plan, low + np.array([[4.0, 1.0], [4.0, 4.0]]))
    scored = AlignmentHypothesis(0.0, np.zeros(2), 0.8)
    eyes = low + np.array([[3.5, 2.5], [4.5, 2.5]])
    assert with_way(seen(plan, eyes), plan, scored).score == 0.8
    assert with_way(seen(plan, eyes), lines, scored).score == pytest.approx(0.8 * WALKED_FREELY)
    # Views 4 m apart do not say which way the camera took.
    far = low + np.array([[2.0, 2.5], [6.0, 2.5]])
    assert with_way(seen(plan, far), lines, scored).score == 0.8
    around = low + np.array([[3.5, 0.5], [4.5, 0.5]])
    assert with_way(seen(plan, around), lines, scored).score == 0.8


def test_without_cameras_nothing_is_judged(plan):
    walls = WallSamples(plan.ends[:, 0], plan.normals)
    found = plan_evidence(walls, plan, HERE)
    assert found.judged_m == 0.0
    assert found.walked_through_share == found.seen_through_share == 0.0


def test_crossings_against_one_at_a_time(rng):
    first, second = rng.uniform(0, 10, (2, 60, 2))
    ends = rng.uniform(0, 10, (30, 2, 2))

    def side(a, b, c):
        return np.sign((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))

    def crosses(p, q, a, b):
        return side(p, q, a) != side(p, q, b) and side(a, b, p) != side(a, b, q)

    def shortened(face):
        length = np.linalg.norm(face[1] - face[0])
        margin = min(END_MARGIN_M / length, 0.25)
        return face[0] + margin * (face[1] - face[0]), face[1] + margin * (face[0] - face[1])

    slow = [
        any(crosses(p, q, *shortened(face)) for face in ends)
        for p, q in zip(first, second, strict=True)
    ]
    assert crosses_face(first, second, ends).tolist() == slow


def centre_lines(half_m, plan):
    """Each face moved behind itself, of unknown side: walls as lines in their middle."""
    ends = plan.ends - half_m * plan.normals[:, None]
    return Floorplan("lines", ends, plan.normals, np.zeros(len(plan), dtype=bool))


@pytest.mark.parametrize(
    ("half_m", "expected_m"), [(0.1, 0.1), (0.04, 0.04), (0.0, 0.0), (0.015, 0.0)]
)
def test_walls_drawn_by_centre_lines_are_noticed(plan, half_m, expected_m, rng):
    middle = plan.ends.mean(axis=(0, 1))
    walls = seen(plan, [middle])
    noisy = WallSamples(
        walls.xy + rng.normal(0, 0.02, walls.xy.shape), walls.normals, walls.seen_from
    )
    found = plan_evidence(noisy, centre_lines(half_m, plan), HERE)
    assert found.line_offset_m == pytest.approx(expected_m, abs=0.005)
    against, besides = evidence_findings(found)
    assert bool(against) == (expected_m > 0.05)
    assert bool(besides) == (0 < expected_m < 0.05)


def test_faces_of_known_side_have_no_centre_line(plan):
    middle = plan.ends.mean(axis=(0, 1))
    off = Floorplan(
        "off", plan.ends - 0.1 * plan.normals[:, None], plan.normals, np.ones(len(plan), dtype=bool)
    )
    assert plan_evidence(seen(plan, [middle]), off, HERE).line_offset_m == 0.0


@pytest.mark.parametrize(
    ("seen_through", "judged_m", "is_against"),
    [(0.6, 20.0, True), (0.4, 20.0, False), (0.6, 5.0, False)],
)
def test_walls_seen_through_speak_against_the_plan(seen_through, judged_m, is_against):
    against, besides = evidence_findings(PlanEvidence(0.0, seen_through, judged_m))
    assert bool(against) is is_against
    assert besides == []
