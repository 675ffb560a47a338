"""What the scan shows of the building: gravity, floor, walls, ceiling and columns."""

from planfit.segmentation.back_ends import ArrayBackEnd as ArrayBackEnd
from planfit.segmentation.back_ends import BackEnd as BackEnd
from planfit.segmentation.gravity import Gravity as Gravity
from planfit.segmentation.gravity import find_gravity as find_gravity
from planfit.segmentation.gravity import most_common_upright as most_common_upright
from planfit.segmentation.gravity import oriented_points as oriented_points
from planfit.segmentation.segment import SegmentationOptions as SegmentationOptions
from planfit.segmentation.segment import choose_back_end as choose_back_end
from planfit.segmentation.segment import level_from_world as level_from_world
from planfit.segmentation.segment import segment_scan as segment_scan
from planfit.segmentation.storeys import number_storeys as number_storeys
from planfit.segmentation.types import NO_STOREY as NO_STOREY
from planfit.segmentation.types import LevelPoints as LevelPoints
from planfit.segmentation.types import Structure as Structure
from planfit.segmentation.types import WallPatches as WallPatches
from planfit.segmentation.types import no_level_points as no_level_points
from planfit.segmentation.types import no_structure as no_structure
from planfit.segmentation.types import no_wall_patches as no_wall_patches
