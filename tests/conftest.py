"""Numerical accidents are errors; shapes are checked; seeded randomness; builders live in `builders.py`."""

import signal

import numpy as np
import pytest

import shape_checks

shape_checks.install()  # before planfit is imported anywhere
# Of a shell's background job Ctrl-C is ignored, which every program that a test starts would inherit: those
# that a test ends by it would run on, and the test with them.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True)
def checked_shapes():
    shape_checks.begin_test()


@pytest.fixture(autouse=True)
def no_silent_numerics():
    with np.errstate(divide="raise", invalid="raise", over="raise"):
        yield


@pytest.fixture
def rng():
    return np.random.default_rng(20240607)
