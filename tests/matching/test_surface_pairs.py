"""Matches by geometry: rooms whose motion is known, corridors that leave it free, look-alikes."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import look, room_scan, with_constants
from planfit.errors import OptionError
from planfit.geometry import se3
from planfit.geometry.calibration import NOMINAL, PARAMETERS
from planfit.matching import MatchingOptions, SurfaceOptions, SurfacePairs
from planfit.matching.pairs import PairOptions
from planfit.matching.surfaces import find
from planfit.matching.surfaces import register as register_module
from planfit.matching.surfaces.find import (
    find_surface_pairs,
    measure_surface_neighbours,
    poor_frames,
)
from planfit.matching.surfaces.grids import COLUMNS, ROWS, find_surface_grids
from planfit.matching.surfaces.register import Registered, observe, register, starts_about
from planfit.matching.surfaces.registration_kernels import LOSS_SIGMAS, observed, sums_at
from planfit.matching.types import RelativePoses
from planfit.priors import Prior
from planfit.runtime import Runtime
from planfit.scan.odometry import OdometryOptions, make_odometry
from planfit.scan.views import FilesView, calibrated_scan

UP = np.array([0.0, 0.0, 1.0])
BOXES = [((1.5, 0.0, 0.0), (2.3, 0.6, 1.1)), ((5.2, 2.0, 0.0), (6.0, 3.0, 0.8))]
DOORS = [((x, 1.8, 0.0), (x + 0.9, 2.0, 2.1)) for x in np.arange(0.0, 40.0, 3.0)]
"""Cupboards along one wall of a corridor, alike and as far apart as doors are."""


N = 56
"""Frames of the walk: 13 degrees from each to the next."""


def nothing_matched():
    return RelativePoses(np.zeros((0, 2), int), np.zeros((0, 4, 4)), np.zeros(0, int))


MAX_DEPTH_M = SurfaceOptions().max_depth_m


def bare(scan):
    return replace(scan, has_color=False, up_world=UP)


def grids_of(poses, **room):
    scan = room_scan(np.stack(poses), **room)
    return find_surface_grids(scan, np.arange(len(poses)), MAX_DEPTH_M, Runtime())


def matching(use="few", loops_per_frame=8):
    pairs = PairOptions(loops_per_frame=loops_per_frame)
    return MatchingOptions(pairs=pairs, surfaces=SurfaceOptions(use=use))


def round_walk(n, laps=2):
    """A walk on an oval in a room of 6 x 4 m, the camera looking out over the walls."""
    angle = 2 * np.pi * laps * np.arange(n) / n
    return np.stack(
        [
            look((3 + 1.2 * np.cos(a), 2 + 0.8 * np.sin(a), 1.5), np.rad2deg(a) + 20, 12)
            for a in angle
        ]
    )


@pytest.mark.parametrize("start", ["none at all", "half a metre off"])
def test_the_corner_of_a_room_tells_all_of_a_motion(start) -> None:
    poses = [look((2.0, 1.8, 1.5), 35, 15), look((2.3, 2.0, 1.55), 43, 10, 2)]
    true = se3.inverse(poses[0]) @ poses[1]
    off = np.array([0.05, 0.1, 0.0, 0.35, 0.1, -0.3])
    first = np.eye(4) if start == "none at all" else se3.retract(true, off)
    best = register(grids_of(poses, boxes=BOXES), 0, 1, first[None])[0]
    assert_allclose(se3.difference(best.a_from_b, true)[3:], 0.0, atol=0.01)
    assert np.rad2deg(se3.rotation_angle(best.a_from_b[:3, :3].T @ true[:3, :3])) < 0.3
    assert best.explained > 0.6
    assert best.contradicted < 0.01
    seen = observe(grids_of(poses, boxes=BOXES), 0, 1, best.a_from_b)
    assert np.isfinite(seen.variances).all()


def test_a_corridor_says_nothing_of_motion_along_itself() -> None:
    room = {"size_m": (40.0, 2.0, 2.6)}
    poses = [look((15.0, 1.0, 1.5), 5, 8), look((15.5, 1.1, 1.5), -4, 10)]
    true = se3.inverse(poses[0]) @ poses[1]
    along = poses[0][:3, :3].T @ np.array([1.0, 0.0, 0.0])
    start = se3.retract(true, np.array([0.0, 0.05, 0.0, *(0.1 * along + [0.1, 0.0, 0.0])]))
    grids = grids_of(poses, **room)
    best = register(grids, 0, 1, start[None])[0]
    off = se3.difference(best.a_from_b, true)
    across = off[3:] - along * (along @ off[3:])
    assert_allclose(across, 0.0, atol=0.01)
    # Along the corridor the motion stays where it began.
    begun = along @ se3.difference(start, true)[3:]
    assert along @ off[3:] == pytest.approx(begun, abs=0.02)
    seen = observe(grids, 0, 1, best.a_from_b)
    information = seen.information
    pairs = SurfacePairs(
        np.array([[0, 1]]),
        best.a_from_b[None],
        information[None],
        np.ones(1),
        seen.by_sensor[None],
        np.ones(1),
    )
    assert_array_equal(pairs.n_free, [1])
    free = np.linalg.eigh(information)[1][:, 0]
    assert abs(free[3:] @ along) > 0.999


@pytest.mark.parametrize("parameter", PARAMETERS)
def test_motions_follow_the_sensor_as_if_matched_again_with_it(parameter) -> None:
    """Seen through another sensor and brought together once more, a pair moves as was foretold.

    By as much as leaves the pairs of cells the same; with others, weak directions may jump.
    """
    poses = [look((2.0, 1.8, 1.5), 35, 15), look((2.6, 2.1, 1.55), 49, 8, 3)]
    true = se3.inverse(poses[0]) @ poses[1]
    scan = room_scan(np.stack(poses), boxes=BOXES)
    at = NOMINAL.vector
    at[PARAMETERS.index(parameter)] += 0.0005 if parameter == "depth_quadratic_per_m" else 0.002
    sensor = NOMINAL.with_vector(at)

    def pair_of(seen):
        grids = find_surface_grids(seen, np.arange(2), MAX_DEPTH_M, Runtime())
        motion = register(grids, 0, 1, true[None])[0].a_from_b
        told = observe(grids, 0, 1, motion)
        return SurfacePairs(
            np.array([[0, 1]]), motion[None], told.information[None], np.ones(1),
            told.by_sensor[None], np.array([told.distance_m]),
        )  # fmt: skip

    nominal, again = pair_of(scan), pair_of(calibrated_scan(scan, sensor))
    lever = np.repeat([2.0, 1.0], 3)  # m a radian at what is seen
    asked = lever * se3.difference(again.a_from_b[0], nominal.a_from_b[0])
    told = lever * se3.difference(nominal.corrected(sensor).a_from_b[0], nominal.a_from_b[0])
    assert np.linalg.norm(asked) > 0.0004
    assert_allclose(told, asked, atol=0.05 * np.linalg.norm(asked))


def test_motions_grow_with_the_depth_and_so_do_their_sigmas() -> None:
    motion = se3.make_transform(se3.exp_so3(np.array([0.1, 0.2, 0.3])), np.array([0.4, 0.0, 0.2]))
    by_sensor = np.zeros((1, 6, 7))
    by_sensor[0, 3:, 0] = motion[:3, 3]
    pairs = SurfacePairs(
        np.array([[0, 1]]), motion[None], np.eye(6)[None], np.ones(1), by_sensor, np.full(1, 3.0)
    )
    long = pairs.corrected(replace(NOMINAL, depth_scale=1.25))
    assert_allclose(long.a_from_b[0, :3, 3], 1.25 * motion[:3, 3])
    assert_allclose(long.a_from_b[0, :3, :3], motion[:3, :3])
    assert_allclose(np.diagonal(long.information[0]), [1, 1, 1, 0.64, 0.64, 0.64])
    assert pairs.corrected(NOMINAL) is pairs


def test_one_wall_leaves_three_directions_free() -> None:
    room = {"size_m": (80.0, 60.0, 60.0)}
    poses = [look((40.0, 57.0, 30.0), 90), look((40.2, 56.8, 30.0), 88)]
    true = se3.inverse(poses[0]) @ poses[1]
    seen = observe(grids_of(poses, **room), 0, 1, true)
    assert int(np.isinf(seen.variances).sum()) == 3
    normal = poses[0][:3, :3].T @ np.array([0.0, -1.0, 0.0])
    assert normal @ seen.information[3:, 3:] @ normal > 1e3


def test_gradient_is_that_of_the_robust_cost_of_the_plane_distances() -> None:
    """Against central differences of a slow twin; about the optimum pairs of cells do not change."""
    poses = [look((2.0, 1.8, 1.5), 35, 15), look((2.2, 1.9, 1.5), 41, 12)]
    grids = grids_of(poses, boxes=BOXES, noise_m=0.004)
    true = se3.inverse(poses[0]) @ poses[1]
    sigma = np.array([0.015, 0.005])
    views = [(grids.depth_m[k], grids.normals[k], grids.cameras[k]) for k in range(2)]
    motion = se3.retract(true, np.array([0.002, -0.003, 0.002, 0.01, -0.008, 0.006]))
    hessian, sums, _ = sums_at(*views, motion, sigma)
    rows = [*twin_rows(*views, motion), *twin_rows(*views[::-1], se3.inverse(motion))]
    assert len(rows) == pytest.approx(sums[0], rel=0.02)
    planes = fixed_planes(views, motion)
    steps = 1e-5 * np.eye(6)
    slopes = [
        (robust_cost(planes, se3.retract(motion, s), sigma)
         - robust_cost(planes, se3.retract(motion, -s), sigma)) / 2e-5
        for s in steps
    ]  # fmt: skip
    # The kernel's own gradient: its first step from here, undone.
    gradient = kernel_gradient(views, motion, sigma)
    assert_allclose(gradient, slopes, rtol=2e-3, atol=2e-3 * np.abs(slopes).max())
    assert_allclose(hessian, hessian.T, atol=1e-9 * np.abs(hessian).max())
    values, vectors, scaling = observed(hessian, sums, motion)
    turned = vectors.T @ scaling.T @ hessian @ scaling @ vectors
    assert_allclose(turned, np.diag(values), atol=1e-8 * values[-1])


def kernel_gradient(views, motion, sigma):
    from planfit.matching.surfaces import registration_kernels as kernels

    hessian, gradient, sums = np.zeros((6, 6)), np.zeros(6), np.zeros(7)
    rest = (kernels.GATES_M[-1], sigma, 1)
    out = hessian, gradient, sums, np.zeros((0, 7))
    kernels._add(*views, motion, *rest, False, *out)
    kernels._add(*views[::-1], motion, *rest, True, *out)
    return gradient


def twin_rows(view_a, view_b, a_from_b):
    """Cell of the first view, cell of the second: those that lie on one surface."""
    depth_a, normals_a, camera_a = view_a
    depth_b, normals_b, camera_b = view_b
    rows = []
    for row, column in np.argwhere(depth_b > 0):
        z = depth_b[row, column]
        own = (
            np.array([(column - camera_b[2]) / camera_b[0], (row - camera_b[3]) / camera_b[1], 1])
            * z
        )
        x = a_from_b[:3, :3] @ own + a_from_b[:3, 3]
        u = int(np.floor(camera_a[0] * x[0] / x[2] + camera_a[2] + 0.5))
        v = int(np.floor(camera_a[1] * x[1] / x[2] + camera_a[3] + 0.5))
        if not (0 <= u < COLUMNS and 0 <= v < ROWS) or not depth_a[v, u] > 0:
            continue
        d = depth_a[v, u]
        p = np.array([(u - camera_a[2]) / camera_a[0], (v - camera_a[3]) / camera_a[1], 1]) * d
        n = normals_a[v, u] / 127.0
        turned = a_from_b[:3, :3] @ normals_b[row, column] / 127.0
        if n @ turned < 0.8 or np.linalg.norm(x - p) > 0.2 + 0.05 * d or abs(n @ (x - p)) > 0.1:
            continue
        rows.append((p, n, own, 0.5 * (z + d)))
    return rows


def fixed_planes(views, motion):
    there, back = twin_rows(*views, motion), twin_rows(*views[::-1], se3.inverse(motion))
    return there, back


def robust_cost(planes, motion, sigma):
    total = 0.0
    for rows, a_from_b in zip(planes, (motion, se3.inverse(motion)), strict=True):
        for p, n, own, depth in rows:
            scale = LOSS_SIGMAS * (sigma[0] + sigma[1] * depth)
            distance = n @ (a_from_b[:3, :3] @ own + a_from_b[:3, 3] - p)
            total += 0.5 * LOSS_SIGMAS**2 * np.log1p((distance / scale) ** 2)
    return total


def test_information_tells_how_far_motions_err_with_noise() -> None:
    """Departures in sigmas, over draws of the noise, are no larger than they say."""
    poses = [look((2.0, 1.8, 1.5), 35, 15), look((2.3, 2.0, 1.55), 43, 10)]
    true, sigmas = se3.inverse(poses[0]) @ poses[1], []
    scan = room_scan(np.stack(poses * 8), boxes=BOXES, noise_m=0.02)
    grids = find_surface_grids(scan, np.arange(16), 8.0, Runtime())
    for k in range(8):
        best = register(grids, 2 * k, 2 * k + 1, true[None])[0]
        seen = observe(grids, 2 * k, 2 * k + 1, best.a_from_b)
        sigmas.append(seen.squared_sigmas(se3.difference(best.a_from_b, true), np.zeros((6, 6))))
    assert np.mean(sigmas) < 9.0  # 6 are expected of exact sigmas


def test_a_view_that_looks_past_the_other_is_contradicted() -> None:
    """Two rooms alike but for their depth: at the same motion one camera sees through the other's wall."""
    near = grids_of([look((3.0, 2.0, 1.5), 0, 10)] * 2, size_m=(6.0, 4.0, 2.6))
    far = grids_of([look((3.0, 2.0, 1.5), 0, 10)] * 2, size_m=(7.5, 4.0, 2.6))
    mixed = replace(
        near,
        depth_m=np.stack([near.depth_m[0], far.depth_m[0]]),
        normals=np.stack([near.normals[0], far.normals[0]]),
    )
    still = [register(g, 0, 1, np.eye(4)[None])[0] for g in (near, mixed)]
    assert still[0].contradicted == 0.0
    assert still[1].contradicted > 0.1


def test_what_two_views_see_counts_for_them_as_far_as_it_agrees() -> None:
    def odds(explained, agreement):
        return Registered(np.eye(4), explained, 0.0, agreement).log_odds

    assert odds(0.4, 0.98) > odds(0.2, 0.98) > 0.0
    assert odds(0.3, 0.95) > odds(0.5, 0.8)  # more of the same surfaces, but less alike
    assert odds(0.5, 0.6) < odds(0.1, 0.6) < 0.0


def test_corridors_that_look_alike_from_door_to_door_have_rivals() -> None:
    room = {"size_m": (40.0, 2.0, 2.6), "boxes": DOORS}
    poses = [look((15.0, 0.6, 1.5), 35, 8), look((15.1, 0.6, 1.5), 33, 8)]
    true, up = se3.inverse(poses[0]) @ poses[1], poses[0][:3, :3].T @ UP
    grids = grids_of(poses, **room)
    sure = register(grids, 0, 1, starts_about(true, up, 0.0, 0.02))
    assert len(sure) == 1
    unsure = register(grids, 0, 1, starts_about(true, up, 0.0, 0.6))
    assert len(unsure) > 1
    assert np.linalg.norm(unsure[0].a_from_b[:3, 3] - true[:3, 3]) < 0.05


def test_starts_reach_as_far_as_the_drift_and_begin_with_what_is_predicted() -> None:
    starts = starts_about(np.eye(4), UP, np.deg2rad(4.0), 0.3)
    assert_array_equal(starts[0], np.eye(4))
    assert_allclose(starts[:, 2, 3], 0.0, atol=1e-12)
    assert len(starts) == 3**3
    assert np.abs(starts[:, :2, 3]).max() >= 0.5
    assert len(starts_about(np.eye(4), UP, 1e-3, 0.02)) == 1


@pytest.fixture(scope="module")
def walk():
    poses = round_walk(N)
    scan = bare(room_scan(poses, boxes=BOXES, noise_m=0.005, fingerprint="surfaces walk"))
    return scan, poses


def found_in(walk, odometry=None, loops_per_frame=2, **constants):
    scan, poses = walk
    options, recorded = (
        matching(loops_per_frame=loops_per_frame),
        make_odometry(poses, OdometryOptions()),
    )
    with with_constants(find, **constants):
        known = measure_surface_neighbours(scan, nothing_matched(), recorded, options, Runtime())
        odometry = odometry or recorded
        return known, find_surface_pairs(scan, odometry, UP, known, options, Runtime())


def test_neighbours_and_revisits_of_a_walk_are_right(walk) -> None:
    known, found = found_in(walk)
    i, j = found.pairs.T
    off = se3.difference(found.a_from_b, se3.inverse(walk[1][i]) @ walk[1][j])
    is_full = found.n_free == 0
    assert known.is_poor.all()
    assert len(known.neighbours) > 60
    assert found.n_loops(4) > 5
    assert is_full.sum() > 20
    squared = np.einsum("pi,pij,pj->p", off, found.information, off)
    assert squared.max() < 36.0  # six sigmas, of what each observes
    assert np.abs(off[is_full, 3:]).max() < 0.05
    assert_array_equal(found.pairs, np.unique(found.pairs, axis=0))
    again = found_in(walk)[1]
    assert_array_equal(found.a_from_b, again.a_from_b)


def test_only_frames_with_few_matches_are_looked_at(walk) -> None:
    pairs = np.array([[i, i + 1] for i in range(N - 1)])
    motions, n = np.tile(np.eye(4), (N - 1, 1, 1)), np.full(N - 1, 100)
    n[19:21] = 20  # frame 20 has only these two, and no good pair spans the steps to it and from it
    matched = RelativePoses(pairs, motions, n)
    poor = [19, 20, 21]
    assert_array_equal(np.flatnonzero(poor_frames(N, matched, matching())), poor)
    with with_constants(find, few_matches=15):
        assert_array_equal(np.flatnonzero(poor_frames(N, matched, matching())), [])
    assert poor_frames(N, matched, matching(use="always")).all()
    assert not poor_frames(N, nothing_matched(), matching(use="never")).any()
    by_default = matching(use="without_colour")
    assert not poor_frames(N, matched, by_default).any()
    assert_array_equal(np.flatnonzero(poor_frames(N, matched, by_default, has_color=False)), poor)
    recorded = make_odometry(walk[1], OdometryOptions())
    known = measure_surface_neighbours(walk[0], matched, recorded, matching(), Runtime())
    assert_array_equal(known.grids.number >= 0, np.isin(np.arange(N), range(16, 25)))
    assert np.isin(known.neighbours.pairs, range(16, 25)).all()
    assert np.isin(known.neighbours.pairs, poor).any(axis=1).all()


def test_a_step_that_a_pair_further_apart_spans_is_not_open(walk) -> None:
    """Frames 9 and 10 do not match each other: poor only where no other pair reaches over the step."""
    pairs = np.array([[i, i + 1] for i in range(N - 1) if i != 9])
    alone = RelativePoses(pairs, np.tile(np.eye(4), (len(pairs), 1, 1)), np.full(len(pairs), 100))
    assert_array_equal(np.flatnonzero(poor_frames(N, alone, matching())), [9, 10])
    over = np.concatenate([pairs, [[8, 11]]])
    spanned = RelativePoses(over, np.tile(np.eye(4), (len(over), 1, 1)), np.full(len(over), 100))
    assert not poor_frames(N, spanned, matching()).any()


@pytest.mark.parametrize(
    ("yaw_deg", "step_m", "turn_deg"), [(2, 0.9, 6), (8, 1.2, 0), (15, 0.9, 0), (15, 1.2, 6)]
)
def test_a_camera_that_walked_on_is_not_taken_for_one_that_stood(yaw_deg, step_m, turn_deg) -> None:
    """Along a corridor a false motion explains more of both views, as it leaves them more in common."""
    ahead = np.deg2rad(yaw_deg)
    at = (2.0 + step_m * np.cos(ahead), 1.0 + 0.3 * step_m * np.sin(ahead), 1.5)
    poses = [look((2.0, 1.0, 1.5), yaw_deg, 8), look(at, yaw_deg + turn_deg, 8)]
    true = se3.inverse(poses[0]) @ poses[1]
    room = {"size_m": (40.0, 2.0, 2.6), "boxes": DOORS, "noise_m": 0.004}
    scan = bare(room_scan(np.stack(poses), fingerprint="", **room))
    known, _ = found_in((scan, scan.world_from_cams))

    def sigmas(motion, information):
        off = se3.difference(true, motion)
        return float(np.sqrt(off @ information @ off))

    starts = np.stack([np.eye(4), true])
    both = register(known.grids, 0, 1, starts, lambda one: one.explained)
    told = observe(known.grids, 0, 1, both[0].a_from_b)
    assert sigmas(both[0].a_from_b, told.information) > 6.0
    assert_array_equal(known.neighbours.pairs, [[0, 1]])
    assert sigmas(known.neighbours.a_from_b[0], known.neighbours.information[0]) < 3.0


def test_a_jump_is_found_where_keypoints_end() -> None:
    """Frames of both sides match their own; over the jump the camera went on as before, and surfaces tell."""
    yaws, jump = 20 + 13.0 * np.arange(8), 4
    poses = np.stack(
        [look((1.6 + 0.28 * k, 1.2 + 0.2 * k, 1.5), yaw, 10) for k, yaw in enumerate(yaws)]
    )
    wrong = poses.copy()
    wrong[jump:] = se3.retract(np.eye(4), np.array([0, 0, 0.35, 2.0, -2.0, 0.0])) @ poses[jump:]
    scan = bare(room_scan(poses, boxes=BOXES, fingerprint=""))
    scan = replace(scan, world_from_cams=wrong)
    pairs = np.array([[i, j] for i in range(8) for j in (i + 1, i + 2) if j < 8])
    pairs = pairs[(pairs[:, 0] >= jump) | (pairs[:, 1] < jump)]
    motions = se3.inverse(poses[pairs[:, 0]]) @ poses[pairs[:, 1]]
    matched = RelativePoses(pairs, motions, np.full(len(pairs), 100))
    odometry = make_odometry(wrong, OdometryOptions())
    known = measure_surface_neighbours(scan, matched, odometry, matching(), Runtime()).neighbours
    i, j = known.pairs.T
    over = (i < jump) & (j >= jump)
    off = se3.difference(known.a_from_b, se3.inverse(poses[i]) @ poses[j])
    squared = np.einsum("pi,pij,pj->p", off, known.information, off)
    assert over.sum() >= 2
    assert squared.max() < 25.0


@pytest.mark.slow
def test_options_of_the_search_reach_it(walk) -> None:
    base = found_in(walk)[1]
    assert (found_in(walk, neighbours=1)[0].neighbours.pairs @ [-1, 1]).max() == 1
    assert found_in(walk, loops_per_frame=0)[1].n_loops(4) == 0
    assert found_in(walk, loops_per_frame=1)[1].n_loops(4) < base.n_loops(4)
    assert len(found_in(walk, min_overlap=0.8)[1]) < len(base)
    near = find_surface_grids(walk[0], np.arange(2), 1.5, Runtime())
    assert np.nanmax(near.depth_m) < 1.6


class Breathing(FilesView):
    """Depth that is bent one way and the other, from frame to frame."""

    def depth(self, frame_idx):
        depth = self.files.depth(frame_idx)
        bend = np.sin(np.linspace(0, 12, depth.shape[1])).astype(np.float32)
        return depth * (1.0 + 0.1 * (-1) ** frame_idx * bend)


def test_depth_that_contradicts_itself_sets_its_own_bar(walk) -> None:
    breathing = replace(walk[0], files=Breathing(walk[0].files), fingerprint="")
    options = {"min_overlap": 0.1, "max_contradicted": 1e-5}
    lenient = found_in((breathing, walk[1]), usual_factor=3.0, **options)[0]
    strict = found_in((breathing, walk[1]), usual_factor=1.0, **options)[0]
    assert strict.max_contradicted < lenient.max_contradicted
    assert len(strict.neighbours) < len(lenient.neighbours)


def test_corners_that_are_alike_after_a_quarter_turn_are_refused() -> None:
    """In a square room no motion at all explains a quarter turn; the recorded one contradicts it."""
    poses = np.stack([look((2.0, 2.0, 1.5), yaw, 10) for yaw in (45, 135, 225, 315)])
    scan = bare(room_scan(poses, size_m=(4.0, 4.0, 2.6), fingerprint="square"))
    known, _ = found_in((scan, poses))
    assert len(known.neighbours) == 0
    still = register(known.grids, 0, 1, np.eye(4)[None])[0]
    assert still.explained > 0.9


def test_motions_that_close_triangles_are_believed_against_the_recorded_ones() -> None:
    """Recorded poses that say nothing: neighbours are found all the same."""
    angle = 2 * np.pi * np.arange(24) / 90
    poses = np.stack(
        [look((3 + 0.8 * np.cos(a), 2 + 0.5 * np.sin(a), 1.5), np.rad2deg(a), 12) for a in angle]
    )
    scan = bare(room_scan(poses, boxes=BOXES, fingerprint=""))
    wrong = replace(scan, world_from_cams=np.tile(np.eye(4), (24, 1, 1)))
    known, _ = found_in((wrong, wrong.world_from_cams))
    i, j = known.neighbours.pairs.T
    off = se3.difference(known.neighbours.a_from_b, se3.inverse(poses[i]) @ poses[j])
    squared = np.einsum("pi,pij,pj->p", off, known.neighbours.information, off)
    assert len(squared) > 20
    assert (squared < 36.0).mean() > 0.9


def test_sigmas_and_observations_reach_the_information(walk) -> None:
    poses = [look((2.0, 1.8, 1.5), 35, 15), look((2.3, 2.0, 1.55), 43, 10)]
    grids, true = grids_of(poses, boxes=BOXES), se3.inverse(poses[0]) @ poses[1]

    def size(**constants):
        with with_constants(register_module, **constants):
            seen = observe(grids, 0, 1, true)
        return np.trace(seen.information)

    assert size(sigma_base_m=0.1) < 0.5 * size()
    assert size(sigma_per_m=0.05) < 0.5 * size()
    assert size(view_observations=2.0) < 0.5 * size()
    assert size(floor_m=0.03) < 0.5 * size()
    assert size(bias=2.0) < 0.5 * size()
    assert size(pairs_alike=6.0) == pytest.approx(0.5 * size())


def test_a_direction_that_little_holds_is_held_little(walk) -> None:
    """By an error that all surfaces share, motion is bent by as much over what of it they observe."""
    poses = [look((2.0, 1.8, 1.5), 35, 15), look((2.3, 2.0, 1.55), 43, 10)]
    grids, true = grids_of(poses, boxes=BOXES), se3.inverse(poses[0]) @ poses[1]

    def sigmas(bias: float) -> np.ndarray:
        with with_constants(register_module, bias=bias, floor_m=0.0, view_observations=1e9):
            return np.sqrt(observe(grids, 0, 1, true).variances)

    by_noise, by_bias = sigmas(0.0), sigmas(1e3)
    held = np.isfinite(by_noise)
    assert by_noise[held].max() > 2 * by_noise[held].min()
    # Of noise, variances are one over what observes; of a bias, sigmas are.
    np.testing.assert_allclose(
        by_bias[held] / by_bias[held].min(), (by_noise[held] / by_noise[held].min()) ** 2, rtol=1e-3
    )


@pytest.mark.slow
def test_rivals_within_the_drift_refuse_a_revisit() -> None:
    """A corridor walked twice: a revisit counts where drift is far below the doors' distance."""
    way = [look((x, 0.6, 1.5), 35, 8) for x in np.arange(12.0, 18.0, 0.4)]
    poses = np.stack([*way, *way[::-1]])
    scan = bare(room_scan(poses, size_m=(40.0, 2.0, 2.6), boxes=DOORS, fingerprint="corridor"))
    sure = make_odometry(poses, OdometryOptions())
    drifted = replace(sure, sigma_translation=np.full(len(poses) - 1, 0.25))
    strict = found_in((scan, poses), drifted)[1]
    lenient = found_in((scan, poses), drifted, clear_odds=Prior(1.0, "Either may be."))[1]
    assert strict.n_loops(4) < lenient.n_loops(4)
    for found in (found_in((scan, poses), sure)[1], strict):
        i, j = found.pairs.T
        off = se3.difference(found.a_from_b, se3.inverse(poses[i]) @ poses[j])
        held = np.einsum("pij,pj->pi", found.information, off)
        assert np.einsum("pi,pi->p", off, held).max() < 36.0  # six sigmas in what is observed


@pytest.mark.parametrize(("name", "value"), [("use", "sometimes"), ("max_depth_m", 0.0)])
def test_option_that_cannot_work_is_refused_by_name(name, value) -> None:
    with pytest.raises(OptionError, match=name):
        SurfaceOptions(**{name: value})
