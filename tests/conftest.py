"""Numerical accidents are errors; shapes are checked; seeded randomness; builders live in `builders.py`."""

import numpy as np
import pytest

import shape_checks

shape_checks.install()  # before planfit is imported anywhere


@pytest.fixture(autouse=True)
def no_silent_numerics():
    with np.errstate(divide="raise", invalid="raise", over="raise"):
        yield


@pytest.fixture
def rng():
    return np.random.default_rng(20240607)
