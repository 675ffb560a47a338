"""The fit of a survey to a levelled scan, and mistakes and blunders that it tells."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planfit.errors import OptionError
from planfit.survey.fit import are_apart, are_on_a_line, fit_site, require_fit
from planfit.survey.residuals import find_blunders

YAW = 0.8


@pytest.fixture
def level(rng):
    return rng.uniform([0, 0, 0.2], [30, 20, 2.5], (12, 3))


def as_surveyed(level):
    """The same points in axes of a site, turned and moved."""
    c, s = np.cos(YAW), np.sin(YAW)
    turned = level @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T
    return turned + np.array([40.0, -70.0, 312.0])


def test_the_fit_is_exact_and_forgives_blunders(level):
    site = as_surveyed(level)
    fit = fit_site(level, site)
    assert_allclose(fit.to_level(site), level, atol=1e-9)
    wrong = site.copy()
    wrong[[2, 7]] += (8.0, 3.0, 1.0)
    fit = fit_site(level, wrong)
    assert_allclose(fit.to_level(site), level, atol=1e-6)
    assert (fit.misfit_m > 1).sum() == 2


def test_a_scale_is_fitted_where_it_is_not_known(level):
    site = as_surveyed(level) * (50.0, 50.0, 1.0)
    fit = fit_site(level, site, is_metric=False, has_own_datum=True)
    assert fit.scale == pytest.approx(0.02)
    assert_allclose(fit.to_level(site)[:, :2], level[:, :2], atol=1e-9)


def test_an_unknown_height_takes_no_part(level):
    site = as_surveyed(level)
    site[3, 2] = np.nan
    placed = fit_site(level, site).to_level(site)
    assert np.isnan(placed[3, 2])
    assert_allclose(np.delete(placed, 3, axis=0), np.delete(level, 3, axis=0), atol=1e-9)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda p: p * 1000, "they fit as millimetres: multiply x, y and z by 0.001"),
        (lambda p: p / 0.3048, "they fit as feet: multiply x, y and z by 0.3048"),
        (lambda p: p / 1000, "they fit as kilometres"),
        (
            lambda p: p[:, [1, 0, 2]],
            "x and y swapped, or one of them negated: the axes are left-handed",
        ),
        (lambda p: p * [-1, 1, 1], "the axes are left-handed"),
        (lambda p: p[:, [0, 2, 1]] * [1, 1, -1], "y is up in them; write x, -z, y"),
        (lambda p: p[:, [0, 2, 1]], "left-handed: y is up in them; write x, z, y"),
        (lambda p: np.random.default_rng(3).permutation(p), "check ids, marks, axes and unit"),
    ],
)
@pytest.mark.parametrize("drift", [0.0, 0.03])
def test_one_mistake_in_the_survey_is_named(level, spoil, words, drift):
    """Also where the scan has drifted: bent by 3 % of its length."""
    bent = level + drift * np.column_stack([level[:, 1], 0.5 * level[:, 0], 0 * level[:, 0]])
    site = np.asarray(spoil(as_surveyed(level)), dtype=float)
    fit = fit_site(bent, site)
    with pytest.raises(OptionError) as found:
        require_fit(fit, bent, site)
    assert words in str(found.value)


@pytest.mark.parametrize("bend", [0.0, 0.02, 0.06])
def test_a_right_survey_of_a_drifted_scan_is_no_mistake(level, bend):
    bent = level * (1.0, 1.0 + bend, 1.0) + bend * np.column_stack(
        [level[:, 1], *2 * [0 * level[:, 0]]]
    )
    site = as_surveyed(level)
    require_fit(fit_site(bent, site), bent, site)


def test_lines_and_single_places():
    line = np.column_stack([np.arange(5.0), 2 * np.arange(5.0), np.zeros(5)])
    assert are_on_a_line(line)
    assert are_on_a_line(line[:2])
    assert not are_on_a_line(np.vstack([line, [0, 5, 0]]))
    assert are_apart(line)
    assert not are_apart(0.01 * line)
    assert not are_apart(line[:1])


def walk_of(n=12):
    """Points along a bent walk whose tracker loses 5 % of the way and 1 degree a point."""
    x = np.linspace(0, 60, n)
    site = np.column_stack([x, 6 * np.sin(x / 8), 1 + 0.2 * np.sin(x)])
    yaw = np.deg2rad(1.0) * np.arange(n)
    steps = np.diff(site, axis=0) * (0.95, 0.95, 1.0)
    turned = np.stack(
        [
            np.cos(yaw[1:]) * steps[:, 0] - np.sin(yaw[1:]) * steps[:, 1],
            np.sin(yaw[1:]) * steps[:, 0] + np.cos(yaw[1:]) * steps[:, 1],
            steps[:, 2],
        ],
        axis=1,
    )
    level = np.concatenate([site[:1], site[0] + np.cumsum(turned, axis=0)])
    walked = np.concatenate([[0], np.cumsum(np.linalg.norm(steps, axis=1))])
    return level, site, walked


def test_drift_is_no_blunder():
    level, site, walked = walk_of()
    assert not find_blunders(level, site, walked).any()


@pytest.mark.parametrize("by", [(0, 5, 0), (5, 0, 0), (-4, 4, 0), (0, 0, 3)])
@pytest.mark.parametrize("k", [0, 1, 5, 11])
def test_a_blunder_is_told_wherever_it_is(k, by):
    level, site, walked = walk_of()
    site[k] += by
    assert np.flatnonzero(find_blunders(level, site, walked)).tolist() == [k]


def test_two_blunders_and_too_few_to_tell():
    level, site, walked = walk_of()
    site[3] += (0, 6, 0)
    site[8] += (0, -7, 0)
    assert np.flatnonzero(find_blunders(level, site, walked)).tolist() == [3, 8]
    with pytest.raises(
        OptionError, match="found 3 that contradict each other by more than drift can"
    ):
        find_blunders(level[2:5], site[2:5], walked[2:5])
    assert not find_blunders(level[:1], site[:1], walked[:1]).any()


IN_A_ROW = np.array(
    [[3.15, 3.16, 0.0], [2.05, 4.37, 1.37], [4.47, 10.15, 2.29], [3.22, 6.45, 1.29], [5.1, 4.44, 1.5],
     [6.02, 4.25, 1.34], [5.66, 0.0, 0.84]]
)  # fmt: skip
"""Points of a building: with y and z swapped, four of them fit within drift by the median."""


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda p: p[:, [0, 2, 1]], "found 5 of 7 .* write x, z, y"),
        (lambda p: p[:, [0, 2, 1]] * (1, 1, -1), "found 6 of 7 .* write x, -z, y"),
    ],
)
def test_a_mistake_that_the_median_hides_is_named(spoil, words):
    site = spoil(IN_A_ROW)
    walked = 4.5 * np.arange(7.0)
    require_fit(fit_site(IN_A_ROW, site), IN_A_ROW, site)
    with pytest.raises(OptionError, match=words):
        find_blunders(IN_A_ROW, site, walked)


@pytest.mark.parametrize("seed", range(20))
def test_blunders_are_no_mistake_in_all_points(seed):
    """Whichever points are wrong, and how, no other axes or unit is made of it."""
    rng = np.random.default_rng(seed)
    level = np.column_stack([rng.uniform(0, (9, 11), (7, 2)), rng.uniform(0, 2.3, 7)])
    site = level.copy()
    site[:2] += rng.uniform(-6, 6, (2, 3))
    assert find_blunders(level, site, 4.5 * np.arange(7.0)).any()
