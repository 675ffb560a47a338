"""What departures say of the covariances that recorded steps and matched surfaces were given."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import sparse

from builders import random_transforms
from planfit.adjust.terms.observation_models import ODOMETRY, SURFACES
from planfit.adjust.terms.odometry import OdometryTerm
from planfit.adjust.terms.surfaces import SurfaceTerm
from planfit.adjust.uncertainty.error_model import _of_steps, _of_surfaces
from planfit.adjust.uncertainty.spreads import MIN_MOTION_FACTOR, Probes, find_step_factors
from planfit.geometry import se3
from planfit.lsq.blocks import NormalBlocks
from planfit.lsq.covariance import Factors, factorised
from planfit.lsq.normal_equations import NormalEquations
from planfit.lsq.robust import SQUARES
from planfit.matching import SurfacePairs
from planfit.scan.odometry import Odometry

N, REACH = 30, 4
SIGMAS = np.array([0.004] * 3 + [0.01] * 3)


def solved(term: SurfaceTerm, poses: np.ndarray) -> tuple[np.ndarray, Factors]:
    """Poses of least cost, the first one held, and their normal equations."""
    first = np.zeros(1, dtype=int)
    held = NormalBlocks(first, first, 1e10 * np.eye(6)[None], np.zeros((N, 6)))
    while True:
        part = term.reweight(poses)[0].normal_blocks(poses)
        factors = factorised(NormalEquations([part, held], N))
        step = -factors.solve(part.gradient.reshape(-1, 1)).reshape(N, 6)
        if np.abs(step).max() < 1e-10:
            return poses, factors
        poses = se3.retract(poses, step)


def found_factor(rng, true_over_stated: float, rank: int) -> float:
    """Of pairs whose surfaces leave 6 - rank directions free, each its own ones."""
    poses = random_transforms(rng, N)
    pairs = np.array([(i, j) for i in range(N) for j in range(i + 1, min(i + REACH, N))])
    exact = se3.inverse(poses[pairs[:, 0]]) @ poses[pairs[:, 1]]
    noise = true_over_stated * SIGMAS * rng.normal(size=(len(pairs), 6))
    axes = np.linalg.qr(rng.normal(size=(len(pairs), 6, 6)))[0][:, :, :rank]
    seen = (axes @ np.swapaxes(axes, 1, 2)) / SIGMAS / SIGMAS[:, None]
    unused = np.zeros((len(pairs), 6, 7))
    ones = np.ones(len(pairs))
    measured = SurfacePairs(pairs, se3.retract(exact, noise), seen, ones, unused, ones)
    term = SurfaceTerm(measured, replace(SURFACES, loss=SQUARES))
    best, factors = solved(term, poses)
    return _of_surfaces(term, best, Probes.make(factors, rng))


@pytest.mark.parametrize("rank", [6, 5])
@pytest.mark.parametrize("true_over_stated", [0.7, 1.0, 2.0])
def test_departures_tell_how_far_motions_err(true_over_stated, rank):
    factors = [
        found_factor(np.random.default_rng([k, rank]), true_over_stated, rank) for k in range(4)
    ]
    assert np.mean(factors) == pytest.approx(true_over_stated**2, rel=0.15)


def test_motions_are_not_believed_to_be_far_better_than_they_claim(rng):
    assert found_factor(rng, 0.05, 6) == MIN_MOTION_FACTOR


def test_no_departure_is_left_where_nothing_is_measured_twice(rng):
    """A chain fits any motions exactly: nothing is learnt, and what was stated stands."""
    poses = random_transforms(rng, N)
    pairs = np.stack([np.arange(N - 1), np.arange(1, N)], axis=1)
    exact = se3.inverse(poses[:-1]) @ poses[1:]
    ones, stated = np.ones(N - 1), np.tile(np.diag(1 / SIGMAS**2), (N - 1, 1, 1))
    measured = SurfacePairs(pairs, exact, stated, ones, np.zeros((N - 1, 6, 7)), ones)
    term = SurfaceTerm(measured, replace(SURFACES, loss=SQUARES))
    best, factors = solved(term, poses)
    factor = _of_surfaces(term, best, Probes.make(factors, rng))
    assert factor == pytest.approx(1.0, abs=0.1)


def test_tilt_heading_way_and_height_of_steps_are_told_apart(rng):
    true_over_stated = np.array([0.5, 0.5, 2.0, 1.0, 1.0, 0.1])
    residuals = rng.normal(size=(400, 6)) * true_over_stated * SIGMAS
    information = np.tile(1 / SIGMAS**2, (400, 1))
    nothing_fitted = Probes(np.ones((6, 1)), np.zeros((6, 1)))
    rows = sparse.csr_array((2400, 6))
    factors = find_step_factors(residuals, information, rows, nothing_fitted)
    assert factors[:5] == pytest.approx(true_over_stated[:5] ** 2, rel=0.2)
    assert factors[5] == MIN_MOTION_FACTOR


def test_what_is_up_does_not_depend_on_how_cameras_are_held(rng):
    """The same walk by cameras turned about themselves, each alike: the same pull on the same poses."""
    poses, turned = random_transforms(rng, N), random_transforms(rng, 1)[0]
    turned[:3, 3] = 0.0
    noise = SIGMAS * rng.normal(size=(N - 1, 6)) * [0.2, 0.2, 1.0, 1.0, 1.0, 0.2]
    recorded = se3.retract(poses[1:], noise)
    steps = se3.inverse(poses[:-1]) @ recorded
    found = []
    for camera in (np.eye(4), turned):
        held = poses @ camera
        odometry = Odometry(
            se3.inverse(camera) @ steps @ camera, *np.tile(SIGMAS[[0, 3], None], (1, N - 1))
        )
        term = OdometryTerm(odometry, replace(ODOMETRY, loss=SQUARES))
        first = NormalBlocks(
            np.zeros(1, int), np.zeros(1, int), 1e4 * np.eye(6)[None], np.zeros((N, 6))
        )
        parts = [term.reweight(held)[0].normal_blocks(held), first]
        probes = Probes.make(factorised(NormalEquations(parts, N)), np.random.default_rng(0))
        found.append(NormalEquations([_of_steps(term, held, np.ones(N), probes)], N).matrix)
    one, other = (matrix.toarray() for matrix in found)
    assert_allclose(one, other, atol=1e-6 * np.abs(one).max())
