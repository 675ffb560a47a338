"""Pictures of walls and little else: of a site, as mapping programs give them, and of a flat with doors."""

import itertools
from dataclasses import dataclass

import cv2
import numpy as np
import shapely

from planfit.geometry import segments


@dataclass(frozen=True)
class Mask:
    """A wall mask, and points along its true outline."""

    image: np.ndarray
    outline: np.ndarray
    """(n, 2) u, v."""


def site(px_per_m: float = 40.0, angle_deg: float = 0.0, margin_m: float = 3.0) -> Mask:
    """An office floor: a facade of thick piers, slanted at one corner, a core of walls of 0.3 m, partitions
    of 0.12 m, a round wall, columns."""
    walls = []
    path = [(0, 0), (40, 0), (40, 25), (8, 25), (0, 17), (0, 0)]
    for (x0, y0), (x1, y1) in itertools.pairwise(path):
        length = np.hypot(x1 - x0, y1 - y0)
        along = np.array([x1 - x0, y1 - y0]) / length
        for at in np.arange(1.0, length - 0.9, 2.0):
            a, b = (np.array([x0, y0]) + (at + s) * along for s in (-0.45, 0.45))
            walls.append(shapely.LineString([a, b]).buffer(0.25, cap_style="flat"))
    core = [[(14, 10), (24, 10), (24, 15), (14, 15), (14, 11.2)], [(17, 10), (17, 15)]]
    walls += [shapely.LineString(line).buffer(0.15, cap_style="square") for line in core]
    partitions = [[(10, 0.3), (10, 6), (16, 6)], [(17, 6), (22, 6), (22, 0.3)],
                  [(28, 24.7), (28, 19), (34, 19)], [(35.2, 19), (39.7, 19)],
                  [(30, 0.3), (30, 5)]]  # fmt: skip
    walls += [shapely.LineString(line).buffer(0.06, cap_style="flat") for line in partitions]
    round_corner = (
        shapely.Point(30, 9).buffer(4.0, 64).boundary.intersection(shapely.box(30, 9, 40, 20))
    )
    walls.append(round_corner.buffer(0.1, cap_style="flat"))
    walls += [shapely.box(x, y, x + 0.5, y + 0.5) for x in (6, 33) for y in (12, 16)]
    solid = shapely.affinity.rotate(shapely.union_all(walls), angle_deg, origin=(20, 12))
    low, high = np.array(solid.bounds[:2]) - margin_m, np.array(solid.bounds[2:]) + margin_m
    width, height = np.ceil((high - low) * px_per_m).astype(int)
    image = np.full((2 * height, 2 * width), 255, np.uint8)
    outline = []
    for part in shapely.get_parts(solid):
        rings = [
            (np.asarray(ring.coords) - low) * px_per_m - 0.5
            for ring in (part.exterior, *part.interiors)
        ]
        corners = [np.round((2 * ring + 0.5) * 16).astype(np.int32) for ring in rings]
        cv2.fillPoly(image, corners, 0, cv2.LINE_8, shift=4)
        outline += [segments.sample(np.stack([r[:-1], r[1:]], axis=1), 1.0)[0] for r in rings]
    image = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
    return Mask(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), np.concatenate(outline))


def flat(outer_px: int = 14, partition_px: int = 6, pen_px: int = 0, doors: int = 4) -> np.ndarray:
    """Ink (900, 900) of outer walls and two partitions, with doors whose leaves and swings a pen drew; none
    where it has no width."""
    ink = np.zeros((900, 900), np.uint8)
    cv2.rectangle(ink, (50, 50), (849, 849), 1, -1)
    cv2.rectangle(ink, (50 + outer_px, 50 + outer_px), (849 - outer_px, 849 - outer_px), 0, -1)
    for at in (320, 590):
        ink[at : at + partition_px, 50:850] = 1
    for k in range(doors):
        at, u = (320, 590)[k % 2], 130 + 180 * k
        ink[at : at + partition_px, u : u + 60] = 0
        if pen_px:
            cv2.ellipse(ink, (u, at), (60, 60), 0, 270, 360, 1, pen_px)
            ink[at - 60 : at, u : u + pen_px] = 1
    return ink


def as_picture(ink: np.ndarray) -> np.ndarray:
    """(h, w, 3), black where there is ink."""
    return np.repeat((255 - 255 * ink)[..., None], 3, axis=2).astype(np.uint8)
