"""Floorplans: the data type, and one reader a format."""

from planfit.floorplan.formats import read_floorplan as read_floorplan
from planfit.floorplan.formats.own_formats import write_floorplan_json as write_floorplan_json
from planfit.floorplan.options import PlanOptions as PlanOptions
from planfit.floorplan.types import Floorplan as Floorplan
from planfit.floorplan.types import PlanSource as PlanSource
