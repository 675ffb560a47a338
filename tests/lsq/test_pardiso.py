"""MKL's solver gives the steps of the others, and says so where it is absent."""

import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import make_world, nudged
from planfit.adjust import AdjustOptions, close_loops
from planfit.errors import OptionError
from planfit.lsq.linear_solvers import Pardiso
from planfit.lsq.solver import SolverOptions


def test_the_same_poses_as_by_our_own_factorisation(rng):
    try:
        Pardiso()
    except OptionError as error:
        pytest.skip(str(error))
    world = make_world(rng)
    start = nudged(rng, world.plan_from_cams, 1.0, 0.05)
    own, other = (
        close_loops(
            world.measurements, start, AdjustOptions(solver=SolverOptions(linear_solver=name))
        ).target_from_cams
        for name in ("direct", "pardiso")
    )
    assert_allclose(other, own, atol=1e-8)
    assert np.abs(own - start).max() > 0.01


def test_absent_it_is_an_error_with_the_next_step(monkeypatch, rng):
    monkeypatch.setitem(sys.modules, "pypardiso", None)
    world = make_world(rng)
    options = AdjustOptions(solver=SolverOptions(linear_solver="pardiso"))
    with pytest.raises(OptionError, match=r"pip install 'planfit\[fast\]'`, or use auto"):
        close_loops(world.measurements, world.plan_from_cams, options)
