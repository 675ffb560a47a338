"""Options that cannot work are refused when they are made, by name."""

import pytest

from planfit.adjust.terms.observation_models import ObservationModel
from planfit.alignment import AlignOptions
from planfit.errors import OptionError
from planfit.lsq.robust import Loss, LossKind
from planfit.lsq.solver import SolverOptions
from planfit.pipeline.options import RefineOptions
from planfit.runtime import Runtime, whole_number
from planfit.scan.odometry import OdometryOptions
from planfit.segmentation import SegmentationOptions


@pytest.mark.parametrize(
    ("options", "name", "value"),
    [
        (Loss, "scale", 0.0),
        (SolverOptions, "max_iterations", 0),
        (AlignOptions, "candidate", 0),
        (RefineOptions, "tolerance_m", 0.0),
        (OdometryOptions, "sigma_base_m", float("nan")),
        (SegmentationOptions, "stride_px", 0),
        (Runtime, "workers", 0),
    ],
)
def test_value_is_refused_by_name(options, name, value):
    with pytest.raises(OptionError, match=name):
        options(**{name: value})


def test_a_model_of_observations_is_refused_too():
    for name in ("sigma", "max_observations", "points_per_observation"):
        with pytest.raises(OptionError, match=name):
            ObservationModel(Loss(LossKind.CAUCHY, 2.0), **{name: 0.0})


def test_only_decimal_digits_are_a_whole_number():
    assert [whole_number(word) for word in ("0", "007", "123456789")] == [0, 7, 123_456_789]
    # A superscript counts as a digit in Unicode; Python converts no 5,000 of them.
    for word in ("", "-1", "1.0", " 1", "a", "\u00b2", "9" * 10, "9" * 5000):
        assert whole_number(word) is None
