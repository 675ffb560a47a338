"""Rectangles with labels and materials: what synthetic buildings are rendered from."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float, Int, Integer, UInt8

from planfit.scan.types import Label
from planfit.synth.materials import CARDBOARD, Box, Color, Material

X, Y, Z = np.eye(3)


@dataclass(frozen=True)
class Quads:
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

    def take(self, index: Int[np.ndarray, " k"]) -> "Quads":
        """Those of an index."""
        return Quads(**{f.name: getattr(self, f.name)[index] for f in fields(self)})


def join(parts: Sequence[Quads]) -> Quads:
    """One after the other."""
    return Quads(
        **{f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Quads)}
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
    """The sides of a box that one can see: not the one it stands on, when that is the floor.

    Args:
        box: in the frame of its piece.
        centre: where the piece's origin is, building frame, m.
        yaw: of the piece, rad.
        room: index of the room.
        collector: takes the sides.
        seed: of the texture of all sides; without, each has its own.
    """
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
