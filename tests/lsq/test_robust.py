"""Losses: the weight is the slope of the cost, and weighted squares lie above it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planfit.lsq.robust import Loss, LossKind, loss_curvature, loss_value

LOSSES = [Loss(kind, scale) for kind in LossKind for scale in (0.5, 2.0)]
SQUARES = np.concatenate([[0.0], np.geomspace(1e-6, 1e4, 60)])


@pytest.mark.parametrize("loss", LOSSES)
def test_weight_is_the_derivative_of_the_cost(loss):
    s = SQUARES[1:]
    s = s[np.abs(s - loss.scale**2) > 1e-3]  # Huber's knee has no second derivative
    s = s[s > 1e-4]  # below, the difference of costs is rounding
    high, low = loss_value(s * (1 + 1e-6), loss)[0], loss_value(s * (1 - 1e-6), loss)[0]
    assert_allclose((high - low) / (2e-6 * s), loss_value(s, loss)[1], rtol=1e-4, atol=1e-8)


@pytest.mark.parametrize("loss", [loss for loss in LOSSES if loss.kind != LossKind.NORM])
def test_begins_as_the_square(loss):
    rho, weight = loss_value(np.array([0.0, 1e-8]), loss)
    assert_allclose(rho, [0.0, 1e-8], rtol=1e-6)
    assert_allclose(weight, 1.0, rtol=1e-6)


@pytest.mark.parametrize("loss", LOSSES)
def test_weighted_squares_lie_above_the_cost_and_touch_it(loss):
    rho, weight = loss_value(SQUARES, loss)
    for at in range(len(SQUARES)):
        above = rho[at] + weight[at] * (SQUARES - SQUARES[at])
        assert np.all(above >= rho - 1e-9 * (1 + rho))


@pytest.mark.parametrize("loss", LOSSES)
def test_weights_fall_and_costs_rise(loss):
    rho, weight = loss_value(SQUARES, loss)
    assert np.all(np.diff(rho) > 0)
    assert np.all(np.diff(weight) <= 0)
    assert np.all(weight > 0)


def test_squared_weighs_all_alike():
    rho, weight = loss_value(SQUARES, Loss(LossKind.SQUARED))
    assert_array_equal(rho, SQUARES)
    assert_array_equal(weight, 1.0)


def test_huber_is_continuous_at_its_scale_and_linear_beyond():
    loss = Loss(LossKind.HUBER, 2.0)
    rho, weight = loss_value(np.array([4.0, 4.0 + 1e-9, 100.0]), loss)
    assert_allclose(rho, [4.0, 4.0, 2 * 2.0 * 10 - 4.0])
    assert_allclose(weight, [1.0, 1.0, 0.2])


def test_geman_mcclure_levels_off_at_the_square_of_its_scale():
    rho, weight = loss_value(np.array([1e12]), Loss(LossKind.GEMAN_MCCLURE, 3.0))
    assert_allclose(rho, 9.0, rtol=1e-9)
    assert weight[0] < 1e-20


def test_outliers_weigh_in_the_order_of_the_losses():
    s = np.array([400.0])
    kinds = [kind for kind in LossKind if kind != LossKind.NORM]
    weight = [loss_value(s, Loss(kind, 2.0))[1][0] for kind in kinds]
    assert weight == sorted(weight, reverse=True)
    assert len(set(weight)) == 4


def test_norm_costs_twice_the_distance_beyond_its_rounding():
    rho, weight = loss_value(np.array([0.0, 4.0, 100.0]), Loss(LossKind.NORM, 1e-6))
    assert_allclose(rho, [0.0, 4.0, 20.0], atol=1e-5)
    assert_allclose(weight[1:], [0.5, 0.1], rtol=1e-9)
    assert np.isfinite(weight[0])


@pytest.mark.parametrize("kind", list(LossKind))
@pytest.mark.parametrize("dims", [1, 3])
def test_curvature_is_how_fast_the_pull_grows(kind, dims, rng):
    loss = Loss(kind, 0.7)
    residuals = rng.normal(size=(200, dims)) * 1.3
    directions = np.eye(dims)

    def pull(r):
        return loss_value(np.sum(r**2, axis=1), loss)[1][:, None] * r

    h = 1e-6
    growth = sum(
        (pull(residuals + h * e) - pull(residuals - h * e)) @ e / (2 * h) for e in directions
    )
    found = loss_curvature(np.sum(residuals**2, axis=1), loss, dims)
    assert_allclose(found, growth / dims, rtol=1e-4, atol=1e-6)
