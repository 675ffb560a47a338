"""Boxes, upright rectangles seen from above, and the rectangles with labels and materials that synthetic
buildings are rendered from."""

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from jaxtyping import Bool, Float, Int, Integer, UInt8

from planfit.floorplan.faces import Rows
from planfit.geometry import segments
from planfit.scan.types import Label


@dataclass(frozen=True)
class Rect:
    """An upright rectangle in the building frame, m."""

    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def size(self) -> Float[np.ndarray, "2"]:
        """Width and height, m."""
        return np.array([self.x1 - self.x0, self.y1 - self.y0])

    @property
    def area(self) -> float:
        """Area, m2."""
        return float(np.prod(self.size))

    @property
    def centre(self) -> Float[np.ndarray, "2"]:
        """Of the rectangle, m."""
        return np.array([self.x0 + self.x1, self.y0 + self.y1]) / 2

    def grown(self, margin: float) -> "Rect":
        """The same, `margin` m larger on every side."""
        return Rect(self.x0 - margin, self.y0 - margin, self.x1 + margin, self.y1 + margin)

    def contains(self, xy: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
        """Which of the points lie inside."""
        x, y = xy[:, 0], xy[:, 1]
        return (x > self.x0) & (x < self.x1) & (y > self.y0) & (y < self.y1)

    def overlaps(self, other: "Rect") -> bool:
        """Whether the two share area."""
        return (
            self.x0 < other.x1 and other.x0 < self.x1 and self.y0 < other.y1 and other.y0 < self.y1
        )


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

X, Y, Z = np.eye(3)


@dataclass(frozen=True)
class Quads(Rows):
    """Rectangles, plan frame: `origin + u * u_axis + v * v_axis`, u and v from 0 to `size`."""

    origin: Float[np.ndarray, "n 3"]
    """Corner where u and v are 0, m."""
    u_axis: Float[np.ndarray, "n 3"]
    """Unit vectors."""
    v_axis: Float[np.ndarray, "n 3"]
    """Unit vectors."""
    size: Float[np.ndarray, "n 2"]
    """Width and height, m."""
    normal: Float[np.ndarray, "n 3"]
    """Unit vectors, towards the side one sees."""
    label: UInt8[np.ndarray, " n"]
    """Values of `Label`."""
    material: Int[np.ndarray, " n"]
    """Values of `Material`."""
    color: Float[np.ndarray, "n 3"]
    """Base colour, 0 to 1."""
    room: Int[np.ndarray, " n"]
    """Index of the room; -1 for the outside."""
    seed: Integer[np.ndarray, " n"]
    """Of the texture: surfaces of one seed, size and colour look alike."""

    def __len__(self) -> int:
        return len(self.origin)

    def turned(self, rotation: Float[np.ndarray, "3 3"]) -> "Quads":
        """The same rotated about the origin."""
        return replace(
            self,
            origin=self.origin @ rotation.T,
            u_axis=self.u_axis @ rotation.T,
            v_axis=self.v_axis @ rotation.T,
            normal=self.normal @ rotation.T,
        )


@dataclass(frozen=True)
class Lights:
    """What shades the rectangles: lamps and the floor under furniture, sorted by room."""

    lamps: Float[np.ndarray, "n 3"]
    """Where lamps hang, m, plan frame."""
    lamp_room: Int[np.ndarray, " n"]
    """Index of the room of each lamp, ascending."""
    footprints: Float[np.ndarray, "m 5"]
    """Centre x y, half size x y (m), yaw (rad), plan frame."""
    footprint_room: Int[np.ndarray, " m"]
    """Index of the room of each, ascending."""


class Collector:
    """Gathers rectangles one at a time."""

    def __init__(self) -> None:
        self.axes: list[np.ndarray] = []
        self.size: list[tuple[float, float]] = []
        self.kind: list[tuple[int, int, int]] = []
        self.color: list[Color] = []
        self.seed: list[int | None] = []

    def add(
        self,
        axes: Float[np.ndarray, "4 3"],
        size: tuple[float, float],
        label: Label,
        material: Material,
        color: Color,
        room: int,
        seed: int | None = None,
    ) -> None:
        """Add one; the rows of `axes` are origin, u, v, normal. Without a seed it gets one of its own."""
        if min(size) <= 1e-9:
            return
        self.axes.append(axes)
        self.size.append(size)
        self.kind.append((label, material, room))
        self.color.append(color)
        self.seed.append(seed)

    def add_level(
        self,
        rect: Rect,
        z: float,
        facing: float,
        label: Label,
        material: Material,
        color: Color,
        room: int,
    ) -> None:
        """Add one that lies at a height (m), seen from above (facing 1) or from below (-1)."""
        axes = np.array([(rect.x0, rect.y0, z), X, Y, facing * Z])
        self.add(axes, (float(rect.size[0]), float(rect.size[1])), label, material, color, room)

    def add_upright(
        self,
        ends: Float[np.ndarray, "2 2"],
        z: tuple[float, float],
        color: Color,
        room: int,
        label: Label = Label.WALL,
    ) -> None:
        """Add plaster that stands on a line from one height (m) to another, seen from the line's left."""
        (along,), (normal,) = segments.directions(ends[None]), segments.left_normals(ends[None])
        axes = np.array([(*ends[0], z[0]), (*along, 0.0), Z, (*normal, 0.0)])
        size = (float(segments.lengths(ends[None])[0]), z[1] - z[0])
        self.add(axes, size, label, Material.PLASTER, color, room)

    def quads(self, rng: np.random.Generator) -> Quads:
        """All that were added, in order; `rng` is the source of the seeds that were not given."""
        axes, kind = np.array(self.axes, dtype=float), np.array(self.kind)
        # One is drawn for each, so that what shares a seed changes no other surface.
        seeds = rng.integers(2**63, size=len(axes), dtype=np.uint64)
        for i, seed in enumerate(self.seed):
            if seed is not None:
                seeds[i] = seed
        return Quads(
            origin=axes[:, 0],
            u_axis=axes[:, 1],
            v_axis=axes[:, 2],
            size=np.array(self.size, dtype=float),
            normal=axes[:, 3],
            label=kind[:, 0].astype(np.uint8),
            material=kind[:, 1],
            color=np.array(self.color, dtype=float),
            room=kind[:, 2],
            seed=seeds,
        )


def add_box(
    box: Box,
    centre: tuple[float, float],
    yaw: float,
    room: int,
    collector: Collector,
    seed: int | None = None,
) -> None:
    """The sides of a box that one can see: not the one it stands on, when that is the floor. Its piece has
    its origin at `centre` (building frame, m), turned by `yaw` (rad); without a seed each side has its own
    texture."""
    c, s = np.cos(yaw), np.sin(yaw)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    low, high = np.array(box.low), np.array(box.high)
    for axis in range(3):
        for facing in (-1, 1):
            if axis == 2 and facing < 0 and low[2] <= 0.0:
                continue
            u, v = ((1, 2), (0, 2), (0, 1))[axis]
            origin = low.copy()
            if facing > 0:
                origin[axis] = high[axis]
            normal = np.zeros(3)
            normal[axis] = facing
            is_front = axis == 1 and facing > 0 and box.front is not None
            material = box.front if is_front and box.front is not None else box.material
            axes = np.array([origin, np.eye(3)[u], np.eye(3)[v], normal]) @ rotation.T
            axes[0, :2] += centre
            size = (float(high[u] - low[u]), float(high[v] - low[v]))
            color = CARDBOARD if material == Material.CARDBOARD else box.color
            collector.add(axes, size, Label.OTHER, material, color, room, seed)
