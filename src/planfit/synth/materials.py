"""Names of the procedural textures, the colours they come in, and boxes made of them."""

from dataclasses import dataclass
from enum import IntEnum


class Material(IntEnum):
    """What a surface is made of; `texture.py` paints each."""

    PLASTER = 0
    CEILING = 1
    PLANKS = 2
    TILES = 3
    CARPET = 4
    WOOD = 5
    FABRIC = 6
    BOOKS = 7
    PICTURE = 8
    NOTES = 9
    WINDOW = 10
    CABINET = 11
    PAINT = 12
    LAMP = 13
    CARDBOARD = 14
    EVEN = 15


Color = tuple[float, float, float]
"""Linear red, green, blue from 0 to 1."""


@dataclass(frozen=True)
class Box:
    """A box in the frame of its piece: x along the wall, y into the room, z up, m."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    material: Material
    color: Color
    front: Material | None = None
    """Material of the side towards the room, where it differs."""


WALL_COLORS: tuple[Color, ...] = (
    (0.72, 0.70, 0.65),
    (0.66, 0.69, 0.70),
    (0.70, 0.64, 0.54),
    (0.60, 0.67, 0.60),
    (0.72, 0.62, 0.58),
    (0.58, 0.63, 0.71),
)
FLOORS: tuple[tuple[Material, Color], ...] = (
    (Material.PLANKS, (0.50, 0.34, 0.21)),
    (Material.TILES, (0.58, 0.56, 0.52)),
    (Material.PLANKS, (0.38, 0.27, 0.18)),
    (Material.CARPET, (0.36, 0.38, 0.44)),
    (Material.TILES, (0.46, 0.45, 0.46)),
)
WOOD_COLORS: tuple[Color, ...] = (
    (0.55, 0.39, 0.24),
    (0.36, 0.23, 0.15),
    (0.68, 0.55, 0.38),
    (0.72, 0.70, 0.67),
)
FABRIC_COLORS: tuple[Color, ...] = (
    (0.42, 0.20, 0.18),
    (0.22, 0.33, 0.42),
    (0.45, 0.43, 0.38),
    (0.28, 0.38, 0.26),
    (0.52, 0.42, 0.22),
)
CARDBOARD: Color = (0.58, 0.44, 0.29)
WHITE: Color = (0.78, 0.77, 0.74)
DARK: Color = (0.10, 0.10, 0.11)
METAL: Color = (0.45, 0.46, 0.48)
