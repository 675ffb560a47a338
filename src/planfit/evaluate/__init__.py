"""How good poses are: against true ones, against the plan, and by how sharp the map is that they make."""

from planfit.evaluate.map_quality import MapQuality as MapQuality
from planfit.evaluate.map_quality import map_quality as map_quality
from planfit.evaluate.trajectory import PositionErrors as PositionErrors
from planfit.evaluate.trajectory import StepErrors as StepErrors
from planfit.evaluate.trajectory import associate_times as associate_times
from planfit.evaluate.trajectory import position_errors as position_errors
from planfit.evaluate.trajectory import step_errors as step_errors
