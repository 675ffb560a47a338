"""Plans that are pictures: from pixels to wall faces, by classical vision."""

from planfit.floorplan.raster.picture import MAX_PIXELS as MAX_PIXELS
from planfit.floorplan.raster.picture import check_size as check_size
from planfit.floorplan.raster.picture import shrink_for_reading as shrink_for_reading
from planfit.floorplan.raster.plan import plan_of_picture as plan_of_picture
