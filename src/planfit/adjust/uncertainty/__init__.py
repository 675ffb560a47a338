"""How far the poses of an adjustment may be off, by what its residuals say of its sigmas."""

from planfit.adjust.uncertainty.covariances import SharedError as SharedError
from planfit.adjust.uncertainty.covariances import pose_covariances as pose_covariances
from planfit.adjust.uncertainty.covariances import probability_within as probability_within
from planfit.adjust.uncertainty.covariances import radius_95 as radius_95
from planfit.adjust.uncertainty.error_model import ErrorModel as ErrorModel
from planfit.adjust.uncertainty.error_model import model_errors as model_errors
from planfit.adjust.uncertainty.spreads import Spread as Spread
