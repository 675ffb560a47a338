"""The radius of 95 %, beside draws from the distribution."""

import numpy as np
import pytest

from planfit.adjust.uncertainty import radius_95


@pytest.mark.parametrize(
    "sigmas", [(1.0, 1.0, 1.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.3, 1.0, 0.1)]
)
def test_95_of_100_lie_within(sigmas, rng):
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    covariance = axes @ np.diag(np.square(sigmas)) @ axes.T
    drawn = rng.normal(size=(200_000, 3)) * sigmas
    true = np.quantile(np.linalg.norm(drawn, axis=1), 0.95)
    assert radius_95(covariance[None])[0] == pytest.approx(true, rel=0.025)


def test_nothing_open_is_no_radius():
    assert radius_95(np.zeros((2, 3, 3))).tolist() == [0.0, 0.0]
