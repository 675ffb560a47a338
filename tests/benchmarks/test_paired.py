"""Seed-paired comparison, by hand and by its laws."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from paper_tables.paired import compare_paired
from planfit.errors import OptionError


def test_by_hand():
    a = {"1": {"ate": 1.0, "nsd": 2.0}, "2": {"ate": 3.0, "nsd": 2.0}, "3": {"ate": 2.0}}
    b = {
        "1": {"ate": 0.5, "nsd": 2.0},
        "2": {"ate": 3.5, "nsd": 1.0},
        "3": {"ate": 0.5},
        "4": {"ate": 9.0},
    }
    ate, nsd = compare_paired(a, b)
    assert (ate.name, ate.n, ate.wins, ate.losses) == ("ate", 3, 2, 1)
    assert (ate.mean_a, ate.mean_b) == (2.0, 1.5)
    assert ate.mean_difference == pytest.approx(-0.5)
    assert ate.sigma == pytest.approx(1.0)
    assert ate.standard_error == pytest.approx(1 / np.sqrt(3))
    assert (nsd.n, nsd.wins, nsd.losses) == (2, 1, 0)


def test_a_difference_that_hides_in_the_variance_of_the_cases_shows_in_pairs(rng):
    hard = rng.uniform(0, 100, 30)
    a = {str(i): {"ate": float(v)} for i, v in enumerate(hard)}
    b = {str(i): {"ate": float(v - 0.1 + 0.05 * rng.normal())} for i, v in enumerate(hard)}
    (row,) = compare_paired(a, b)
    assert row.mean_difference < -4 * row.standard_error
    assert row.wins > 25


values = st.dictionaries(
    st.sampled_from("abcdef"), st.fixed_dictionaries({"x": st.floats(-1e6, 1e6)}), min_size=1
)


@given(a=values, b=values)
def test_the_other_way_round_is_the_opposite(a, b):
    if not set(a) & set(b):
        with pytest.raises(OptionError, match="run both on the same scans and seeds"):
            compare_paired(a, b)
        return
    (there,), (back,) = compare_paired(a, b), compare_paired(b, a)
    assert there.mean_difference == pytest.approx(-back.mean_difference, abs=1e-6)
    assert (there.wins, there.losses) == (back.losses, back.wins)
    assert there.sigma == pytest.approx(back.sigma, nan_ok=True)


def test_one_case_has_no_variance_and_what_could_not_be_taken_is_left_out():
    (row,) = compare_paired({"1": {"x": 1.0, "y": np.nan}}, {"1": {"x": 2.0, "y": 1.0}})
    assert (row.name, row.losses) == ("x", 1)
    assert np.isnan(row.sigma)
