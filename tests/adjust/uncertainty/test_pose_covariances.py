"""Covariances of poses beside errors that were put in: walls drawn off, patches, matches and steps that
err."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import faces_plan, look, make_matches, make_structure, make_ties, nudged
from planfit.adjust import AdjustOptions, Measurements, build_problem
from planfit.adjust.association import Association
from planfit.adjust.uncertainty import SharedError, pose_covariances
from planfit.geometry import se3
from planfit.scan.odometry import OdometryOptions, make_odometry

N, N_FACES = 24, 16
PATCH_M, MATCH_M, FLOOR_M = 0.015, 0.01, 0.008
STATED_PATCH_M = 0.05 / 2
"""Standard deviation of a patch's mean by the default options: sigma 5 cm, four effective observations."""


def round_room():
    corner = np.arange(N_FACES) * 2 * np.pi / N_FACES
    return faces_plan(6.0 * np.column_stack([np.cos(corner), np.sin(corner)]))


def noisy_problem(rng, drawn_m, patch_m=PATCH_M, walls=True):
    """Truth, and a problem solved: cameras on a ring look outwards, each at three faces and the floor."""
    plan = round_room()
    angle = np.arange(N) * 360.0 / N
    at = 3.0 * np.column_stack([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))])
    truth = np.stack([look([*p, 1.5], a, 15) for p, a in zip(at, angle, strict=True)])
    offsets_m = drawn_m * rng.normal(size=N_FACES)
    floor, patches, faces = [], [], []
    for i in range(N):
        below = np.array([*at[i], FLOOR_M * rng.normal()])
        floor.append((i, below + rng.uniform([-2, -2, 0], [2, 2, 0], (60, 3))))
        for face in (round(angle[i] / 22.5 - 0.5) + np.arange(-1, 2)) % N_FACES:
            first, last = plan.ends[face]
            xy = first + (last - first) * rng.uniform(0.1, 0.9, (240, 1))
            xy = xy + (offsets_m[face] + patch_m * rng.normal()) * plan.normals[face]
            on_wall = np.column_stack([xy, rng.uniform(0.3, 2.5, 240)])
            patches.append((i, on_wall, plan.normals[face]))
            faces.append(face)
    pairs = sorted(tuple(sorted((i, (i + k) % N))) for i in range(N) for k in (1, 2))
    matches = make_matches(truth, pairs, rng.uniform([-6, -6, 0], [6, 6, 2.5], (40, 3)))
    off = np.repeat(MATCH_M * rng.normal(size=(len(pairs), 3)), 40, axis=0)
    matches = replace(matches, points_b=matches.points_b + off)
    exact = make_odometry(truth, OdometryOptions())
    steps = exact.cam_from_next.copy()
    for k in range(N - 1):
        sigma = [exact.sigma_rotation[k]] * 3 + [exact.sigma_translation[k]] * 3
        steps[k] = se3.retract(steps[k], sigma * rng.normal(size=6))
    odometry = replace(exact, cam_from_next=steps)
    measured = Measurements(matches, make_structure(truth, floor, patches), odometry)
    ties = make_ties(plan, Association(np.array(faces), np.zeros(len(faces))), N)
    start = nudged(rng, truth, 0.05, 0.005)
    problem = build_problem(measured, AdjustOptions(), start, ties if walls else None)
    return truth, replace(problem, unknowns=problem.solve().target_from_cams)


def covariances_of(problem, rng, shared=None, misfit=1.0):
    stretch = np.arange(N) // 6
    idx = np.arange(N)
    return pose_covariances(problem, stretch, np.full(N, misfit), idx, rng, shared)


def errors_of(problem, truth):
    turned = se3.log_so3(problem.unknowns[:, :3, :3] @ np.swapaxes(truth[:, :3, :3], 1, 2))
    return np.concatenate([turned, problem.unknowns[:, :3, 3] - truth[:, :3, 3]], axis=1)


def squares(errors, covariances):
    return np.einsum("ni,ni->n", errors, np.linalg.solve(covariances, errors[:, :, None])[:, :, 0])


@pytest.mark.parametrize("drawn_m", [0.0, 0.015, 0.03])
def test_errors_are_as_large_as_their_covariances_say(drawn_m):
    of_positions, of_poses = [], []
    for seed in range(6):
        rng = np.random.default_rng([7, seed])
        truth, problem = noisy_problem(rng, drawn_m)
        found, _ = covariances_of(problem, rng)
        errors = errors_of(problem, truth)
        of_positions.append(squares(errors[:, 3:], found[:, 3:, 3:]).mean() / 3)
        of_poses.append(squares(errors, found).mean() / 6)
    # Rather wide than narrow: sixteen walls tell little of how walls are drawn.
    assert 0.25 < np.mean(of_positions) < 1.4
    assert 0.25 < np.mean(of_poses) < 1.4


def test_residuals_tell_how_walls_were_drawn_and_patches_seen():
    drawn, factors = [], []
    for seed in range(6):
        rng = np.random.default_rng([8, seed])
        _, problem = noisy_problem(rng, 0.02)
        walls = covariances_of(problem, rng)[1]["walls"]
        drawn.append(walls.shared_m)
        factors.append(walls.factor)
    assert np.mean(drawn) == pytest.approx(0.02, rel=0.35)
    assert np.mean(factors) == pytest.approx((PATCH_M / STATED_PATCH_M) ** 2, rel=0.35)


def test_many_patches_of_few_walls_do_not_make_them_sure(rng):
    _, exact = noisy_problem(np.random.default_rng(3), 0.0)
    _, off = noisy_problem(np.random.default_rng(3), 0.03)
    sure, unsure = (
        np.sqrt(np.einsum("nii->n", covariances_of(p, rng)[0][:, 3:, 3:])) for p in (exact, off)
    )
    assert unsure.min() > 1.3 * sure.max()
    # Formal covariances see the same in both: 72 patches, four observations each.
    assert unsure.min() > 0.008


def test_what_all_frames_share_adds_how_poses_follow_it(rng):
    _, problem = noisy_problem(np.random.default_rng(4), 0.0)
    follow = rng.normal(size=(N, 6, 2))
    shared = SharedError(np.diag([0.01, 0.02]) ** 2, follow)
    alone = covariances_of(problem, np.random.default_rng(0))[0]
    both = covariances_of(problem, np.random.default_rng(0), shared)[0]
    assert_allclose(
        both - alone, follow @ shared.covariance @ np.swapaxes(follow, 1, 2), atol=1e-12
    )


def test_steps_worse_than_their_sigmas_widen(rng):
    _, problem = noisy_problem(np.random.default_rng(5), 0.0)
    right, worse = (
        covariances_of(problem, np.random.default_rng(0), None, m)[0] for m in (1.0, 9.0)
    )
    assert np.all(np.linalg.eigvalsh(worse - right) > -1e-12)
    assert np.trace(worse[0]) > np.trace(right[0])


def test_alone_what_one_rigid_motion_mends_is_no_error():
    rng = np.random.default_rng(6)
    truth, problem = noisy_problem(rng, 0.0, walls=False)
    assert problem.gauge is not None
    found, _ = covariances_of(problem, np.random.default_rng(0))
    moved = replace(
        problem, unknowns=se3.yaw_transform(40.0, np.array([3.0, 1.0, 0.0])) @ problem.unknowns
    )
    again, _ = covariances_of(moved, np.random.default_rng(0))
    assert_allclose(np.einsum("nii->n", again), np.einsum("nii->n", found), rtol=0.1)
    # Nothing that moves all positions alike is left.
    assert np.sqrt(np.einsum("nii->n", found[:, 3:, 3:]).mean()) < 0.05
    closer = se3.fit_rigid(problem.unknowns[:, :3, 3], truth[:, :3, 3]) @ problem.unknowns
    errors = errors_of(replace(problem, unknowns=closer), truth)
    assert 0.2 < squares(errors[:, 3:], found[:, 3:, 3:]).mean() / 3 < 2.5


def test_a_height_that_nothing_holds_is_no_error_and_spoils_nothing():
    # Singular equations, solved as they are, gave variances of -0.2 m^2.
    rng = np.random.default_rng(3)
    truth, whole = noisy_problem(rng, 0.015)
    free = replace(whole, floor=None)
    free = replace(free, unknowns=free.solve().target_from_cams)
    found, _ = covariances_of(free, np.random.default_rng(0))
    held, _ = covariances_of(whole, np.random.default_rng(0))
    assert np.linalg.eigvalsh(found).min() > 0
    sigmas, expected = (np.sqrt(np.einsum("nii->ni", c)) for c in (found, held))
    # What walls hold is as sure as it was; heights are those beside each other.
    assert_allclose(sigmas[:, 3:5], expected[:, 3:5], rtol=0.2)
    assert sigmas[:, 5].max() < 0.05
    errors = errors_of(free, truth)
    errors[:, 5] -= errors[:, 5].mean()
    assert 0.1 < squares(errors[:, 3:], found[:, 3:, 3:]).mean() / 3 < 2.0
    lifted = replace(free, unknowns=free.unknowns.copy())
    lifted.unknowns[:, 2, 3] += 40.0
    again, _ = covariances_of(lifted, np.random.default_rng(0))
    assert_allclose(again, found, atol=1e-3 * np.abs(found).max())


def test_faces_with_offsets_of_their_own_stand_behind_the_poses():
    _, problem = noisy_problem(np.random.default_rng(9), 0.02)
    walls = replace(problem.options.walls, offset_sigma_m=0.02)
    options = replace(problem.options, walls=walls)
    poses, ties = problem.unknowns, problem.correspondences
    offset = build_problem(problem.measurements, options, poses, ties)
    assert len(offset.unknowns) == N + N_FACES
    found, spreads = covariances_of(offset, np.random.default_rng(0))
    assert found.shape == (N, 6, 6)
    assert "walls" not in spreads  # an offset that is solved for is shared by no residual
    assert np.all(np.linalg.eigvalsh(found) > 0)
