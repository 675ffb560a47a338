"""Which frames are tried with which."""

import numpy as np

from builders import look, with_constants
from planfit.matching import pairs as pairs_module
from planfit.matching.covisibility import ViewSamples
from planfit.matching.pairs import FrameDescriptors, PairOptions, choose_pairs
from planfit.scan.odometry import OdometryOptions, make_odometry


def chosen(poses, drift=None, **options):
    poses = np.asarray(poses)
    drift = drift or OdometryOptions()
    known = {
        name: options.pop(name) for name in ("neighbours", "loops_per_frame") if name in options
    }
    with with_constants(pairs_module, **options):
        pairs = choose_pairs(poses, make_odometry(poses, drift), PairOptions(**known))
    assert pairs.shape[1] == 2
    assert np.all(pairs[:, 0] < pairs[:, 1])
    as_tuples = [tuple(int(v) for v in pair) for pair in pairs]
    assert as_tuples == sorted(set(as_tuples))
    return set(as_tuples)


def there_and_back(n=30, step_m=1.0, yaw_back_deg=0.0, gap_m=0.0):
    """A straight walk and the same way back, looking ahead or turned."""
    out = [look([i * step_m, 0, 1.5], 0) for i in range(n)]
    back = [look([i * step_m, gap_m, 1.5], yaw_back_deg) for i in reversed(range(n))]
    return out + back


def test_neighbours_in_time():
    far_apart = [look([20.0 * i, 0, 0], 0) for i in range(6)]
    assert chosen(far_apart, neighbours=2) == {(i, j) for i in range(6) for j in (i + 1, i + 2)
                                               if j < 6}  # fmt: skip
    assert len(chosen(far_apart, neighbours=1)) == 5


def test_one_frame_and_two():
    assert chosen([look([0, 0, 0], 0)]) == set()
    assert chosen([look([0, 0, 0], 0), look([1, 0, 0], 0)]) == {(0, 1)}


def test_a_place_visited_again_is_a_pair():
    pairs = chosen(there_and_back())
    for i in range(25):
        assert (i, 59 - i) in pairs


def test_a_place_seen_the_other_way_is_none():
    pairs = chosen(there_and_back(yaw_back_deg=180))
    assert all(j - i <= 4 or i > 25 for i, j in pairs if (i < 30) != (j < 30))
    pairs = chosen(there_and_back(yaw_back_deg=45))
    assert (5, 54) in pairs
    assert (5, 54) not in chosen(there_and_back(yaw_back_deg=45), max_angle_deg=40.0)


def test_base_distance_m():
    sure = OdometryOptions(1e-6, 0.0, 1e-6, 0.0)
    assert (5, 54) in chosen(there_and_back(gap_m=2.0), sure, base_distance_m=2.5)
    assert (5, 54) not in chosen(there_and_back(gap_m=2.0), sure, base_distance_m=1.5)


def test_the_gate_grows_with_the_distance_walked():
    poses = there_and_back(gap_m=4.0)
    sure, unsure = OdometryOptions(1e-6, 0.0, 1e-6, 0.0), OdometryOptions(0.2, 0.0, 0.5, 0.0)
    options = {"loops_per_frame": 60}
    assert not any(j - i > 4 and i < 30 <= j for i, j in chosen(poses, sure, **options))
    pairs = chosen(poses, unsure, **options)
    assert (2, 57) in pairs  # 55 steps between them
    assert (26, 33) not in pairs  # 7 steps


def test_max_distance_m_bounds_the_gate():
    unsure = OdometryOptions(5.0, 0.0, 5.0, 0.0)
    poses = there_and_back(gap_m=6.0)
    assert (5, 54) in chosen(poses, unsure, loops_per_frame=60)
    assert (5, 54) not in chosen(poses, unsure, loops_per_frame=60, max_distance_m=5.0)


def test_loops_per_frame_bounds_every_frame():
    poses = there_and_back(20) * 3  # every view six times over
    for most in (0, 1, 3):
        loops = [p for p in chosen(poses, loops_per_frame=most) if p[1] - p[0] > 4]
        counts = np.bincount(np.array(loops, dtype=int).ravel(), minlength=len(poses))
        assert counts.max() <= most
        assert counts.sum() >= len(poses) * most * 0.8


def test_a_camera_that_lingers_is_no_revisit_and_takes_no_budget():
    rng = np.random.default_rng(1)
    still = [
        look(np.array([0, 0, 1.5]) + rng.normal(0, 0.003, 3), rng.normal(0, 0.2))
        for _ in range(300)
    ]
    away = [look([0.5 * i, 0, 1.5], 0) for i in range(30)]
    pairs = chosen(still + away + away[::-1])
    assert sum(j - i > 4 for i, j in pairs if j < 300) < 300
    assert sum(i < 300 and j >= 358 for i, j in pairs) > 0


def test_every_visit_gets_its_share_of_the_budget():
    lap = [look([2 * np.cos(a), 2 * np.sin(a), 1.5], np.rad2deg(a)) for a in np.arange(0, 6.2, 0.1)]
    pairs = chosen(lap * 4, loops_per_frame=4)
    n = len(lap)
    for visits in ((0, 1), (0, 2), (0, 3), (1, 3)):
        assert sum((i // n, j // n) == visits for i, j in pairs) > 10


def test_retrieval_finds_the_loop_that_the_gate_misses():
    # The way back is recorded seven metres off; descriptors tell that frame 59 - i shows what frame i shows.
    unsure = OdometryOptions(0.15, 0.0, 0.1, 0.0)
    poses = np.asarray(there_and_back(gap_m=7.0))
    rng = np.random.default_rng(3)
    vectors = rng.normal(size=(30, 64))
    vectors = np.concatenate([vectors, vectors[::-1]])
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    odometry = make_odometry(poses, unsure)
    points = np.tile([[0.0, 0.0, 3.0]], (60, 24, 1))
    views = ViewSamples(points, np.tile([[-0.6, 0.6], [-0.5, 0.5]], (60, 1, 1)))
    descriptors = FrameDescriptors(vectors, np.zeros(60), views)
    truth = {(i, 59 - i) for i in range(16)}

    def found(odometry, **constants):
        with with_constants(pairs_module, max_distance_m=4.0, **constants):
            pairs = choose_pairs(poses, odometry, PairOptions(), descriptors)
        return {(int(i), int(j)) for i, j in pairs}

    assert truth <= found(odometry)
    assert not truth & found(odometry, retrieved_per_frame=0)
    sure = make_odometry(poses, OdometryOptions(1e-6, 0.0, 1e-6, 0.0))
    assert not truth & found(sure)
    assert not truth <= found(odometry, max_drift_sigmas=1.0)


def test_the_nearest_views_come_first():
    # Frames 10 and 11 both look at what frame 0 saw; 11 from the same place.
    poses = [look([0, 0, 1.5], 0)] + [look([100.0 + 20 * i, 0, 0], 0) for i in range(9)]
    poses += [look([0, 2.0, 1.5], 0), look([0, 0.1, 1.5], 0)]
    loops = {p for p in chosen(poses, loops_per_frame=1) if p[1] - p[0] > 4}
    assert loops == {(0, 11)}


def test_view_distance_m_prefers_those_who_look_at_one_spot():
    # Both a metre off; frame 10 turned in towards the spot 4 m ahead of frame 0, 11 turned away.
    inwards = np.rad2deg(np.arctan2(1.0, 4.0))
    poses = [look([0, 0, 1.5], 0)] + [look([100.0 + 20 * i, 0, 0], 0) for i in range(9)]
    poses += [look([0, 1.0, 1.5], -inwards), look([0, 0.8, 1.5], inwards)]
    options = {"loops_per_frame": 1}
    assert {p for p in chosen(poses, **options) if p[1] - p[0] > 4} == {(0, 10)}
    near = chosen(poses, view_distance_m=0.0, **options)
    assert {p for p in near if p[1] - p[0] > 4} == {(0, 11)}
