"""Plans that are pictures: from pixels to wall faces, by classical vision."""

from planfit.floorplan.raster.read import read_picture as read_picture
from planfit.floorplan.raster.read import read_raster as read_raster
