"""Arguments of the engine that cannot work are refused in a sentence that says what to do."""

import numpy as np
import pytest

from planfit.errors import OptionError
from planfit.lsq import BetweenTerm, PosePriorTerm, Problem, ResidualTerm
from planfit.lsq.term import check_pose_idx, check_poses, check_weight

POSES = np.tile(np.eye(4), (4, 1, 1))


@pytest.mark.parametrize(
    ("given", "shape", "found"),
    [
        (np.array([0, 1]), ("k", "a"), r"shape \(k, a\), found int64 of shape \(2,\)"),
        (np.array([[0.0], [1.0]]), ("k", "a"), r"found float64 of shape \(2, 1\)"),
        (np.array([[True]]), ("k", "a"), "found bool"),
        ([[0], [1]], ("k", "a"), "found a list; give np.array"),
        (np.array([[0, 1, 2]]), ("k", "2"), r"shape \(k, 2\), found int64 of shape \(1, 3\)"),
        (np.array([[0]]), ("k",), r"shape \(k,\), found int64 of shape \(1, 1\)"),
        (np.array([[3, -1]]), ("k", "2"), "found one below 0"),
    ],
)
def test_indices_of_another_kind_are_refused(given, shape, found):
    with pytest.raises(OptionError, match=f"term 'mine': expected indices of poses.*{found}"):
        check_pose_idx("mine", given, shape)


def test_indices_that_can_work_pass():
    check_pose_idx("mine", np.array([[0, 3], [2, 1]], dtype=np.int32), ("k", "2"))
    check_pose_idx("mine", np.zeros((0, 2), dtype=int), ("k", "a"))


@pytest.mark.parametrize("weight", [-1.0, np.nan, np.inf])
def test_a_weight_below_0_is_refused(weight):
    with pytest.raises(
        OptionError, match=r"'mine': expected a weight of 0 or more, found .*switches it off"
    ):
        check_weight("mine", weight)
    rows = np.array([[0, 1]])
    for make in (
        lambda: ResidualTerm(rows, lambda at: at[:, 0, :3, 3], weight=weight),
        lambda: BetweenTerm(rows, POSES[:1], 0.1, weight=weight),
    ):
        with pytest.raises(OptionError, match="expected a weight of 0 or more"):
            make()


@pytest.mark.parametrize(
    ("poses", "n", "found"),
    [
        (np.zeros((0, 4, 4)), None, r"one or more, found \(0, 4, 4\)"),
        (np.eye(4), None, r"found \(4, 4\); stack them"),
        (POSES, 3, r"shape \(3, 4, 4\), found \(4, 4, 4\)"),
        (np.full((2, 4, 4), np.nan), None, "found NaN"),
    ],
)
def test_poses_of_another_shape_are_refused(poses, n, found):
    with pytest.raises(OptionError, match=f"mine: expected poses.*{found}"):
        check_poses("mine: expected poses", poses, n)


def test_a_problem_without_poses_or_without_terms_is_refused():
    with pytest.raises(OptionError, match="expected finite initial poses of shape"):
        Problem([], np.zeros((0, 4, 4)))
    with pytest.raises(OptionError, match="expected at least one term to minimise, found none"):
        Problem([], POSES).solve()


def test_priors_of_another_number_or_sigma_are_refused():
    idx, sigma = np.array([0]), np.full(6, 0.1)
    with pytest.raises(OptionError, match=r"'pose prior': expected sigmas above 0, found \[0"):
        PosePriorTerm(idx, POSES[:1], 0.0 * sigma)
    freed = PosePriorTerm(idx, POSES[:1], np.full(6, np.inf))
    assert Problem([freed], POSES).cost(POSES) == 0.0


def test_a_scalar_sigma_of_a_prior_is_refused_and_says_what_to_write():
    term = object.__new__(PosePriorTerm)  # the annotation alone would refuse it in tests
    for name, value in (("pose_idx", np.array([0])), ("target_from_priors", POSES[:1]),
                        ("sigma", 0.1), ("name", "tripod")):  # fmt: skip
        object.__setattr__(term, name, value)
    with pytest.raises(OptionError, match=r"'tripod': expected six sigmas.*found an.*np.full\(6"):
        term.__post_init__()
