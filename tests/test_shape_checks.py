"""Annotations are checked in each test, but not at every call of small functions."""

import numpy as np
import pytest
from beartype.roar import BeartypeDecorHintNonpepException
from jaxtyping import TypeCheckError

import shape_checks
from planfit.geometry import segments

FLAT = np.zeros((3, 4))
"""No segments, which are (n, 2, 2); what is asked of it takes any."""


def asked() -> np.ndarray:
    return segments.lengths(FLAT.reshape(3, 2, 2))


def test_the_first_calls_of_each_test_are_checked():
    with pytest.raises(TypeCheckError):
        segments.lengths(FLAT[None])
    for _ in range(shape_checks.MOST_CALLS):
        asked()
    segments.lengths(FLAT[None])
    shape_checks.begin_test()
    with pytest.raises(TypeCheckError):
        segments.lengths(FLAT[None])


def test_each_annotation_can_be_checked():
    """Of functions that no test calls, too, in all modules that the tests of this run have imported."""
    shape_checks.make_checks()
    assert not shape_checks.unchecked

    def broken(x: 3) -> None: ...

    shape_checks.unchecked.append(broken)
    with pytest.raises(BeartypeDecorHintNonpepException):
        shape_checks.make_checks()
