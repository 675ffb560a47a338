"""What hangs on walls: pictures, notices, sockets and, on outer walls, windows."""

from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

from planfit.geometry import segments
from planfit.synth.box import Box
from planfit.synth.materials import FABRIC_COLORS, WHITE, Material
from planfit.synth.options import BuildingOptions
from planfit.synth.quads import Collector, add_box


def add_hangings(
    ends: Float[np.ndarray, "n 2 2"],
    rooms: Int[np.ndarray, " n"],
    is_outer: Bool[np.ndarray, " n"],
    options: BuildingOptions,
    collector: Collector,
    rng: np.random.Generator,
) -> None:
    """Thin boxes in front of walls, none over another.

    Args:
        ends: m, faces of walls, the free side on the left of the way from the first end to the second.
        rooms: index of the room that each face looks into.
        is_outer: whether nothing but the outside is behind, so that there may be windows.
        options: how many, and how high doors and windows reach.
        collector: takes the boxes.
        rng: source of their kinds, sizes and places.
    """
    lengths = segments.lengths(ends)
    normals = segments.left_normals(ends)
    for i in range(len(ends)):
        yaw = float(np.arctan2(-normals[i, 0], normals[i, 1]))
        count = rng.poisson(options.pictures_per_wall * lengths[i] / 4.0)
        slots = np.linspace(0.12, lengths[i] - 0.12, count + 1)
        for low, high in pairwise(slots):
            boxes = _hanging(bool(is_outer[i]), options.door_height_m, rng)
            half = boxes[0].high[0]
            if high - low < 2 * half + 0.1:
                continue
            at = rng.uniform(low + half, high - half) / lengths[i]
            place = ends[i, 0] * (1 - at) + ends[i, 1] * at
            for box in boxes:
                add_box(box, (float(place[0]), float(place[1])), yaw, int(rooms[i]), collector)


def _hanging(is_outer: bool, top: float, rng: np.random.Generator) -> list[Box]:
    kind = rng.random()
    if is_outer and kind < 0.35:
        return _window(top, rng)
    if kind < 0.55:
        low = 0.3 if rng.random() < 0.6 else 1.05
        return [Box((-0.075, 0.0, low), (0.075, 0.012, low + 0.08), Material.PAINT, WHITE)]
    half, height = rng.uniform(0.18, 0.5), rng.uniform(0.35, 0.75)
    low = rng.uniform(1.0, 1.4)
    front = Material.NOTES if rng.random() < 0.35 else Material.PICTURE
    color = FABRIC_COLORS[int(rng.integers(len(FABRIC_COLORS)))]
    return [Box((-half, 0.0, low), (half, 0.02, low + height), Material.PAINT, color, front)]


def _window(top: float, rng: np.random.Generator) -> list[Box]:
    half = rng.uniform(0.45, 0.75)
    low = rng.uniform(0.85, 1.0)
    sill = Box((-half - 0.05, 0.0, low - 0.03), (half + 0.05, 0.1, low), Material.PAINT, WHITE)
    return [sill, Box((-half, 0.0, low), (half, 0.02, top), Material.PAINT, WHITE, Material.WINDOW)]
