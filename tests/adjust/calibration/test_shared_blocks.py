"""Derivatives by the sensor, the odometry's and the plan's scale, held against differences."""

from dataclasses import replace

import numpy as np
import pytest

from planfit.adjust.calibration.blocks import SHARED, shared_blocks
from planfit.adjust.calibration.reduced import shared_step
from planfit.adjust.problem import AdjustmentProblem
from planfit.adjust.terms.groups import PairGroups, PlaneGroups
from planfit.geometry import se3
from planfit.geometry.calibration import PARAMETERS, SensorCalibration
from planfit.lsq.robust import SQUARES

STEP = 1e-6


class _Planes:
    """A stand-in for a term, with groups given."""
