"""What is on a plan besides walls: doors, windows, names, furniture, dimensions, a title block."""

import itertools

import numpy as np
from jaxtyping import Float

from drawn_plans.pen import Pen
from planfit.synth.building import Building
from planfit.synth.layout import Door
from planfit.synth.options import OUTER_WALL_M
from planfit.synth.quads import Rect

ROOM_NAMES = ("BEDROOM", "KITCHEN", "Bath", "LIVING ROOM", "Office 12", "Hall", "Store", "WC")


def draw_fittings(
    pen: Pen, building: Building, windows: list[Rect], line_px: float, rng: np.random.Generator
) -> None:
    """Door leaves and arcs, window lines, room names: no plan is without."""
    for door in building.layout.doors:
        _draw_door(pen, door, line_px, bool(rng.integers(2)), bool(rng.integers(2)))
    for window in windows:
        low, high = np.array([window.x0, window.y0]), np.array([window.x1, window.y1])
        pen.box(low, high, line_px)
        for share in rng.choice([(0.5, 0.5), (0.35, 0.65)]):
            y = window.y0 + share * (window.y1 - window.y0)
            pen.line(np.array([[window.x0, y], [window.x1, y]]), line_px)
    for i, room in enumerate(building.layout.rooms):
        name = ROOM_NAMES[int(rng.integers(len(ROOM_NAMES)))]
        height = rng.uniform(0.18, 0.28)
        at = room.centre + np.array([0, 0.3])
        pen.text(at, name, height, 1.4 * line_px)
        pen.text(
            at - np.array([0, 1.6 * height]), f"{room.area:.1f} m2 ({i + 1})", 0.8 * height, line_px
        )


def _draw_door(pen: Pen, door: Door, line_px: float, is_high: bool, is_first: bool) -> None:
    """An open leaf and its arc."""
    rect = door.rect
    if door.is_across_x:
        width = rect.y1 - rect.y0
        hinge = np.array([rect.x1 if is_high else rect.x0, rect.y0 if is_first else rect.y1])
        out, along = (0.0 if is_high else np.pi), (np.pi / 2 if is_first else -np.pi / 2)
    else:
        width = rect.x1 - rect.x0
        hinge = np.array([rect.x0 if is_first else rect.x1, rect.y1 if is_high else rect.y0])
        out, along = (np.pi / 2 if is_high else -np.pi / 2), (0.0 if is_first else np.pi)
    swing = (along - out + np.pi) % (2 * np.pi) - np.pi
    tip = hinge + width * np.array([np.cos(out), np.sin(out)])
    across = 0.04 * np.array([np.cos(out + swing), np.sin(out + swing)])
    pen.line(np.array([hinge, tip, tip + across, hinge + across]), line_px)
    pen.arc(hinge, width, out, out + swing, line_px)


def draw_clutter(pen: Pen, building: Building, line_px: float, rng: np.random.Generator) -> None:
    """Furniture, tiles, stairs, dimension lines, north arrow, title block."""
    for piece in building.furniture:
        foot = piece.footprint
        c, s = np.cos(foot.yaw), np.sin(foot.yaw)
        rotation = np.array([[c, -s], [s, c]])
        for grow in (1.0, 0.8) if rng.random() < 0.5 else (1.0,):
            half = np.array(foot.half) * grow
            corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * half
            pen.line(corners @ rotation.T + foot.centre, line_px)
    rooms = building.layout.rooms
    order = rng.permutation(len(rooms))
    _draw_tiles(pen, rooms[order[0]], line_px)
    if len(rooms) > 2:
        _draw_stairs(pen, rooms[order[1]], line_px)
    low = np.min([[r.x0, r.y0] for r in rooms], axis=0) - OUTER_WALL_M
    high = np.max([[r.x1, r.y1] for r in rooms], axis=0) + OUTER_WALL_M
    cuts = np.unique(np.round([v for r in rooms for v in (r.x0, r.x1)], 2))
    _draw_dimension(pen, cuts, float(high[1]) + 0.8, line_px)
    _draw_dimension(pen, np.array([low[0], high[0]]), float(high[1]) + 1.4, line_px)
    _draw_title_block(pen, high, low, line_px)


def _draw_tiles(pen: Pen, room: Rect, line_px: float) -> None:
    """Tiles over half of a room."""
    x1 = (room.x0 + room.x1) / 2
    for x in np.arange(room.x0 + 0.3, x1, 0.3):
        pen.line(np.array([[x, room.y0], [x, room.y1]]), line_px, 0.5)
    for y in np.arange(room.y0 + 0.3, room.y1, 0.3):
        pen.line(np.array([[room.x0, y], [x1, y]]), line_px, 0.5)


def _draw_stairs(pen: Pen, room: Rect, line_px: float) -> None:
    """A flight of stairs along one wall, with its arrow."""
    width = min(1.0, 0.4 * (room.x1 - room.x0))
    steps = np.arange(room.y0 + 0.3, room.y1 - 0.4, 0.28)
    for y in steps:
        pen.line(np.array([[room.x1 - width, y], [room.x1, y]]), line_px)
    pen.line(np.array([[room.x1 - width, steps[0]], [room.x1 - width, steps[-1]]]), line_px)
    x = room.x1 - width / 2
    pen.line(np.array([[x, steps[0]], [x, steps[-1]]]), line_px)
    pen.line(np.array([[x - 0.1, steps[-1] - 0.15], [x, steps[-1]], [x + 0.1, steps[-1] - 0.15]]),
             line_px)  # fmt: skip


def _draw_dimension(pen: Pen, cuts: Float[np.ndarray, " n"], y: float, line_px: float) -> None:
    """A line of dimensions with ticks, extension lines and numbers."""
    pen.line(np.array([[cuts[0] - 0.15, y], [cuts[-1] + 0.15, y]]), line_px)
    for x in cuts:
        pen.line(np.array([[x - 0.08, y - 0.08], [x + 0.08, y + 0.08]]), line_px)
        pen.line(np.array([[x, y - 0.5], [x, y + 0.1]]), line_px)
    for a, b in itertools.pairwise(cuts):
        if b - a > 0.6:
            pen.text(np.array([(a + b) / 2, y + 0.14]), f"{b - a:.2f}", 0.16, line_px)


def _draw_title_block(
    pen: Pen, high: Float[np.ndarray, "2"], low: Float[np.ndarray, "2"], line_px: float
) -> None:
    """A frame around the sheet, a table of words at the bottom right, a north arrow."""
    margin = 2.2
    pen.box(low - margin, high + margin, 1.5 * line_px)
    corner = np.array([high[0] + margin, low[1] - margin])
    pen.box(corner + np.array([-4.2, 0.0]), corner + np.array([0.0, 1.5]), line_px)
    for k, words in enumerate(("Ground floor 1:100", "Drawn 12.03.24", "Project 0417")):
        at = corner + np.array([-2.1, 0.25 + 0.5 * k])
        pen.text(at, words, 0.2, line_px)
        pen.line(np.array([at + np.array([-2.1, 0.25]), at + np.array([2.1, 0.25])]), line_px)
    at = np.array([low[0] - 1.2, low[1] - 1.2])
    pen.arc(at, 0.5, 0.0, 2 * np.pi, line_px)
    pen.line(
        np.array([at - np.array([0, 0.5]), at + np.array([0, 0.7]), at + np.array([0.15, 0.3])]),
        line_px,
    )
