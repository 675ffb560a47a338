"""What departures say of the covariances that recorded steps and matched surfaces were given."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import sparse

from builders import random_transforms
from planfit.adjust.terms.between import OdometryTerm, SurfaceTerm
from planfit.adjust.terms.observation_models import ODOMETRY, SURFACES
from planfit.adjust.uncertainty.error_model import Steps, _of_surfaces
from planfit.adjust.uncertainty.spreads import MIN_MOTION_FACTOR, Clusters, Probes, Spread
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


def walk_with(rng, departures: np.ndarray) -> tuple[np.ndarray, OdometryTerm]:
    """Right poses, and recorded steps that depart so from them, axes whose z is up."""
    poses = random_transforms(rng, len(departures) + 1)
    sigmas = np.tile(SIGMAS[[0, 3], None], (1, len(departures)))
    steps = se3.inverse(poses[:-1]) @ se3.retract(poses[1:], departures)
    odometry = Odometry(steps, *sigmas)
    return poses, OdometryTerm(odometry, replace(ODOMETRY, loss=SQUARES))


def spreads_of(
    term: OdometryTerm, poses: np.ndarray, stretch: np.ndarray, is_held: np.ndarray, rng
) -> list[tuple[Spread, Clusters]]:
    """Of steps between poses, some of which something else holds."""
    at = np.flatnonzero(is_held)
    n = len(poses)
    held = NormalBlocks(at, at, np.tile(1e10 * np.eye(6), (len(at), 1, 1)), np.zeros((n, 6)))
    factors = factorised(NormalEquations([term.reweight(poses)[0].normal_blocks(poses), held], n))
    return Steps.of(term, poses).spreads(stretch, factors, Probes.make(factors, rng), rng)


def test_tilt_heading_way_and_height_of_steps_are_told_apart(rng):
    true_over_stated = np.array([0.5, 0.5, 2.0, 1.0, 1.0, 0.1])
    poses, term = walk_with(rng, rng.normal(size=(400, 6)) * true_over_stated * SIGMAS)
    found = spreads_of(term, poses, np.arange(401) // 20, np.ones(401, dtype=bool), rng)
    factors = [spread.factor for spread, _ in found]
    assert factors[:3] == pytest.approx([0.25, 4.0, 1.0], rel=0.2)
    assert factors[3] == pytest.approx(0.01, abs=0.01)
    assert all(spread.shared_m < 0.3 for spread, _ in found)
    noise = Steps.of(term, poses).noise(factors, np.ones(401)).blocks
    none = Steps.of(term, poses).noise([*factors[:3], 0.0], np.ones(401)).blocks
    assert_allclose(noise, none)  # not believed to be better than a third of what is stated


def test_what_a_tracker_drifts_alike_for_a_while_is_shared(rng):
    """As sideways by half a sigma a step: over 20 steps 10 sigmas, where white errors come to 4.5."""
    stretch = np.arange(801) // 20
    drift = np.zeros((800, 6))
    drift[:, 3:5] = 0.5 * SIGMAS[3:5] * rng.normal(size=(41, 2))[stretch[:-1]]
    white = rng.normal(size=(800, 6)) * SIGMAS
    poses, term = walk_with(rng, white + drift)
    tilt, heading, way, height = (
        spread.shared_m for spread, _ in spreads_of(term, poses, stretch, np.ones(801, bool), rng)
    )
    assert way == pytest.approx(0.5, abs=0.15)
    assert max(tilt, heading, height) < 0.25


def test_no_drift_is_seen_where_nothing_holds_the_walk(rng):
    departures = np.tile([0.0, 0.0, 0.0, 0.01, 0.0, 0.0], (60, 1))
    poses, term = walk_with(rng, departures)
    walked = [poses[0]]
    for step in term.odometry.cam_from_next:
        walked.append(walked[-1] @ step)
    only_first = np.arange(61) == 0
    found = spreads_of(term, np.array(walked), np.arange(61) // 20, only_first, rng)
    assert [spread.shared_m for spread, _ in found] == pytest.approx([0.0] * 4, abs=1e-6)


def test_what_is_up_does_not_depend_on_how_cameras_are_held(rng):
    """The same walk by cameras turned about themselves, each alike: the same pull on the same poses."""
    poses, turned = random_transforms(rng, N), random_transforms(rng, 1)[0]
    turned[:3, 3] = 0.0
    noise = SIGMAS * rng.normal(size=(N - 1, 6)) * [0.2, 0.2, 1.0, 1.0, 1.0, 0.2]
    recorded = se3.retract(poses[1:], noise)
    steps = se3.inverse(poses[:-1]) @ recorded
    stretch, found = np.arange(N) // 10, []
    for camera in (np.eye(4), turned):
        held = poses @ camera
        odometry = Odometry(
            se3.inverse(camera) @ steps @ camera, *np.tile(SIGMAS[[0, 3], None], (1, N - 1))
        )
        term = OdometryTerm(odometry, replace(ODOMETRY, loss=SQUARES))
        spreads = spreads_of(term, held, stretch, np.arange(N) % 5 == 0, np.random.default_rng(0))
        factors = [spread.factor for spread, _ in spreads]
        noise = Steps.of(term, held).noise(factors, np.ones(N))
        pulls = sparse.hstack([spread.shared_m * each.pull for spread, each in spreads])
        found.append((NormalEquations([noise], N).matrix, pulls))
    for one, other in zip(*found, strict=True):
        assert_allclose(one.toarray(), other.toarray(), atol=1e-6 * np.abs(one).max())
