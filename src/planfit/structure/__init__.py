"""What the scan shows of the building: gravity, floor points, flat pieces of wall."""

from planfit.structure.gravity import Gravity as Gravity
from planfit.structure.gravity import find_gravity as find_gravity
from planfit.structure.structure import Structure as Structure
from planfit.structure.structure import StructureOptions as StructureOptions
from planfit.structure.structure import extract_structure as extract_structure
from planfit.structure.structure import level_from_world as level_from_world
