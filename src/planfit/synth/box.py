"""Boxes: what furniture, hangings and stairs are made of."""

from dataclasses import dataclass

from planfit.synth.materials import Color, Material


@dataclass(frozen=True)
class Box:
    """A box in the frame of its piece: x along the wall, y into the room, z up, m."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    material: Material
    color: Color
    front: Material | None = None
    """Material of the side towards the room, where it differs."""
