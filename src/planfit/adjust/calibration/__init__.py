"""What all frames share, solved for with the poses: the sensor, and scales of odometry and plan."""

from planfit.adjust.calibration.blocks import ODOMETRY as ODOMETRY
from planfit.adjust.calibration.blocks import PLAN as PLAN
from planfit.adjust.calibration.blocks import SHARED as SHARED
from planfit.adjust.calibration.correct import corrected_matches as corrected_matches
from planfit.adjust.calibration.correct import corrected_measurements as corrected_measurements
from planfit.adjust.calibration.correct import corrected_structure as corrected_structure
from planfit.adjust.calibration.estimate import NOT_CALIBRATED as NOT_CALIBRATED
from planfit.adjust.calibration.estimate import PRIORS as PRIORS
from planfit.adjust.calibration.estimate import Calibration as Calibration
from planfit.adjust.calibration.estimate import CalibrationOptions as CalibrationOptions
from planfit.adjust.calibration.estimate import CalibrationPriors as CalibrationPriors
from planfit.adjust.calibration.estimate import estimate as estimate
from planfit.adjust.calibration.estimate import estimate_without_plan as estimate_without_plan
from planfit.adjust.calibration.reduced import shared_step as shared_step
