"""Covariances of poses beside errors that were put in: walls drawn off, patches, matches and steps that
err."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planfit.adjust import build_problem
from planfit.adjust.uncertainty import SharedError, model_errors, pose_covariances
from planfit.geometry import se3
from ring_of_cameras import N_FACES, PATCH_M, STATED_PATCH_M, N, noisy_problem


def covariances_of(problem, rng, shared=None, misfit=1.0):
    stretch = np.arange(N) // 6
    idx = np.arange(N)
    model = model_errors(problem, stretch, np.full(N, misfit), rng)
    return pose_covariances(model, problem.unknowns, idx, shared), model.spreads


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
    options = replace(problem.options, wall_offset_sigma_m=0.02)
    poses, ties = problem.unknowns, problem.correspondences
    offset = build_problem(problem.measurements, options, poses, ties)
    assert len(offset.unknowns) == N + N_FACES
    found, spreads = covariances_of(offset, np.random.default_rng(0))
    assert found.shape == (N, 6, 6)
    assert "walls" not in spreads  # an offset that is solved for is shared by no residual
    assert np.all(np.linalg.eigvalsh(found) > 0)
