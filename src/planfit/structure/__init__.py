"""What the scan shows of the building: gravity, floor, walls, ceiling and columns."""

from planfit.structure.back_ends import BackEnd as BackEnd
from planfit.structure.gravity import Gravity as Gravity
from planfit.structure.gravity import find_gravity as find_gravity
from planfit.structure.structure import StructureOptions as StructureOptions
from planfit.structure.structure import choose_back_end as choose_back_end
from planfit.structure.structure import extract_structure as extract_structure
from planfit.structure.structure import level_from_world as level_from_world
from planfit.structure.types import LevelPoints as LevelPoints
from planfit.structure.types import Pieces as Pieces
from planfit.structure.types import Structure as Structure
from planfit.structure.types import no_level_points as no_level_points
from planfit.structure.types import no_pieces as no_pieces
