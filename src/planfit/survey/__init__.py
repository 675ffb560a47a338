"""Surveyed points: known coordinates of things that a scan sees. Control points hold the poses, check points
judge them (docs/adr/0023-control-and-check-points.md)."""

from planfit.survey.fit import PlacedPoints as PlacedPoints
from planfit.survey.fit import SiteFit as SiteFit
from planfit.survey.fit import fit_site as fit_site
from planfit.survey.fit import place_points as place_points
from planfit.survey.marks import FAMILIES as FAMILIES
from planfit.survey.marks import find_marks as find_marks
from planfit.survey.read import LiftedMarks as LiftedMarks
from planfit.survey.read import Mark as Mark
from planfit.survey.read import Survey as Survey
from planfit.survey.read import SurveyAxes as SurveyAxes
from planfit.survey.read import SurveyPoint as SurveyPoint
from planfit.survey.read import read_marks as read_marks
from planfit.survey.read import read_points as read_points
from planfit.survey.residuals import PointResidual as PointResidual
from planfit.survey.residuals import RoleResiduals as RoleResiduals
from planfit.survey.residuals import SurveyResiduals as SurveyResiduals
from planfit.survey.residuals import measure_residuals as measure_residuals
from planfit.survey.residuals import with_swaps as with_swaps
