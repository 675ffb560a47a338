"""Pages of plans in many hands: a building by shapely alone, drawn as strokes, areas and words in metres."""

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import shapely
from shapely.affinity import rotate, translate
from shapely.geometry.base import BaseGeometry

Colour = tuple[int, int, int]
BLACK, WHITE = (0, 0, 0), (255, 255, 255)
THIN = 0.015


@dataclass(frozen=True)
class Stroke:
    """A line through points, m."""

    points: np.ndarray
    width: float = THIN
    colour: Colour = BLACK
    is_dashed: bool = False


@dataclass(frozen=True)
class Fill:
    """The area inside an odd number of rings."""

    rings: list[np.ndarray]
    colour: Colour = BLACK


@dataclass(frozen=True)
class Label:
    """Words."""

    text: str
    xy: np.ndarray
    height: float = 0.25


@dataclass
class House:
    """Walls of one floor, m."""

    outside: BaseGeometry
    inside: BaseGeometry
    solid: BaseGeometry
    """Walls with doorways open and windows closed."""
    centre_lines: list[np.ndarray]
    """Of walls, open at doorways."""
    doors: list[tuple[np.ndarray, np.ndarray, float, float]]
    """Middle, direction along the wall, width, thickness of the wall."""
    windows: list[tuple[np.ndarray, np.ndarray, float, float]]
    rooms: list[BaseGeometry]


@dataclass
class Page:
    """What is drawn, and the truth."""

    parts: list[Stroke | Fill | Label] = field(default_factory=list)
    faces: np.ndarray = field(default_factory=lambda: np.zeros((0, 2, 2)))
    either: BaseGeometry = field(default_factory=shapely.Polygon)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower left and upper right corner of all but words."""
        points = [p.points if isinstance(p, Stroke) else np.concatenate(p.rings)
                  for p in self.parts if not isinstance(p, Label)]  # fmt: skip
        both = np.concatenate(points)
        return both.min(axis=0), both.max(axis=0)

    def stroke(
        self, *points, width: float = THIN, colour: Colour = BLACK, dashed: bool = False
    ) -> None:
        """Add a line through points."""
        self.parts.append(Stroke(np.array(points, dtype=float), width, colour, dashed))

    def box(self, x, y, w, h, width: float = THIN, colour: Colour = BLACK) -> None:
        """Add the outline of a rectangle."""
        self.stroke(
            (x, y), (x + w, y), (x + w, y + h), (x, y + h), (x, y), width=width, colour=colour
        )

    def circle(
        self, x, y, r, a=0.0, b=2 * np.pi, width: float = THIN, colour: Colour = BLACK
    ) -> None:
        """Add an arc."""
        t = np.linspace(a, b, max(int(abs(b - a) * 8), 5))
        self.stroke(
            *np.stack([x + r * np.cos(t), y + r * np.sin(t)], axis=1), width=width, colour=colour
        )

    def fill(self, area: BaseGeometry, colour: Colour) -> None:
        """Add an area, a part each."""
        for part in shapely.get_parts(area):
            if part.area > 1e-6:
                self.parts.append(
                    Fill([np.array(r.coords) for r in (part.exterior, *part.interiors)], colour)
                )

    def outline(self, area: BaseGeometry, width: float = THIN, colour: Colour = BLACK) -> None:
        """Add the edges of an area."""
        for part in shapely.get_parts(area):
            for ring in (part.exterior, *part.interiors):
                self.stroke(*np.array(ring.coords), width=width, colour=colour)


def _segments(area: BaseGeometry) -> np.ndarray:
    rings = [
        np.array(r.coords) for p in shapely.get_parts(area) for r in (p.exterior, *p.interiors)
    ]
    return np.concatenate([np.stack([r[:-1], r[1:]], axis=1) for r in rings])


def make_house(rng: np.random.Generator, shape: str = "", rooms: int = 0) -> House:
    """A floor: a box, an L, or one with a round bay, cut in rooms; each inner wall has a door or two."""
    w, d = rng.uniform(9, 17), rng.uniform(7, 12)
    outer, inner = rng.uniform(0.24, 0.42), rng.uniform(0.09, 0.18)
    outside: BaseGeometry = shapely.box(0, 0, w, d)
    shape = shape or str(rng.choice(["box", "L"]))
    if shape == "L":
        outside = outside.difference(
            shapely.box(w * rng.uniform(0.5, 0.7), d * rng.uniform(0.5, 0.7), w + 1, d + 1)
        )
    elif shape == "bay":
        outside = outside.union(shapely.Point(w, d / 2).buffer(d * rng.uniform(0.28, 0.45), 24))
    elif shape == "round":
        outside = shapely.Point(w / 2, w / 2).buffer(w / 2, 24)
        d = w
    inside = outside.buffer(-outer, join_style="mitre")
    walls: list[tuple[np.ndarray, np.ndarray]] = []
    _cut(rng, (outer, outer, w - outer, d - outer), rooms or int(rng.integers(4, 8)), walls, shape)
    ring = outside.buffer(-outer / 2, join_style="mitre").exterior
    corners = np.array(ring.coords)
    outer_lines = list(itertools.pairwise(corners))
    boxes = [shapely.LineString(line).buffer(inner / 2, cap_style="flat") for line in walls]
    solid = outside.difference(inside).union(shapely.union_all(boxes).intersection(inside))
    lines = [*outer_lines, *walls]
    doors, windows = [], []
    for k, (a, b) in enumerate(lines):
        is_outer, length = k < len(outer_lines), np.hypot(*(b - a))
        along = (b - a) / max(length, 1e-9)
        wide = rng.uniform(1.0, 1.8) if is_outer else rng.uniform(0.8, 0.95)
        thick = outer if is_outer else inner
        n_wanted = max(int(length / 4), 1) if is_outer else 1
        for s in rng.permutation(np.arange(1.0, length - 1.0, 0.35)):
            at = a + s * along
            if n_wanted and _is_free(at, along, wide, solid, thick, doors + windows):
                is_door = not is_outer or not any(t == outer for *_, t in doors)
                (doors if is_door else windows).append(
                    (at, along, 1.0 if is_door and is_outer else wide, thick)
                )
                n_wanted -= 1
    holes = shapely.union_all([_hole(*door) for door in doors])
    # To the centre line of the outer wall, where the rest is cut off.
    to_rim = [
        np.array([_to_rim(p, q, outer, (w, d)) for p, q in ((a, b), (b, a))]) for a, b in walls
    ]
    centre = shapely.union_all([ring, *[shapely.LineString(line) for line in to_rim]])
    centre = centre.intersection(outside.buffer(-outer / 2 + 1e-6, join_style="mitre")).difference(
        holes
    )
    pieces = [
        np.array(p.coords) for p in shapely.get_parts(shapely.line_merge(centre)) if p.length > 0.02
    ]
    solid = solid.difference(holes)
    rooms_found = [
        p for p in shapely.get_parts(inside.difference(shapely.union_all(boxes))) if p.area > 1
    ]
    return House(outside, inside, solid, pieces, doors, windows, rooms_found)


def _to_rim(end, other, outer, size) -> np.ndarray:
    """An end of a centre line: beyond the face of the outer wall where it lies on that one."""
    is_at_face = min(np.abs(end - outer).min(), np.abs(np.array(size) - outer - end).min()) < 1e-9
    return end + outer * (end - other) / np.hypot(*(end - other)) if is_at_face else end


def _cut(rng, box, n, walls, shape) -> None:
    x0, y0, x1, y1 = box
    w, h = x1 - x0, y1 - y0
    if n <= 1 or max(w, h) < 4.5:
        return
    share = rng.uniform(0.38, 0.62)
    if w > h:
        x = x0 + share * w
        walls.append((np.array([x, y0 - (shape in ("bay", "round"))]), np.array([x, y1])))
        halves = ((x0, y0, x, y1), (x, y0, x1, y1))
    else:
        y = y0 + share * h
        walls.append((np.array([x0, y]), np.array([x1, y])))
        halves = ((x0, y0, x1, y), (x0, y, x1, y1))
    for half, k in zip(halves, (n // 2, n - n // 2), strict=True):
        _cut(rng, half, k, walls, shape)


def _hole(at, along, wide, thick, more=0.0) -> BaseGeometry:
    line = shapely.LineString([at - (wide / 2 + more) * along, at + (wide / 2 + more) * along])
    return line.buffer(thick / 2 + 0.01 + more, cap_style="flat")


def _is_free(at, along, wide, solid, thick, others) -> bool:
    """Whether an opening fits: in one straight piece of wall, away from others and from junctions."""
    hole = _hole(at, along, wide + 0.5, thick)
    across = np.array([-along[1], along[0]])
    sides = [shapely.Point(at + s * (thick / 2 + 0.5) * across).buffer(0.35) for s in (-1, 1)]
    straight = hole.intersection(solid).area > 0.9 * (wide + 0.5) * thick
    clear = sum(side.intersects(solid) for side in sides) == 0
    clear &= hole.buffer(0.1).difference(hole).intersection(solid).area < 0.28 * thick
    apart = all(np.hypot(*(at - other[0])) > 1.6 for other in others)
    return bool(straight and clear and apart)


def _with_truth(page: Page, house: House, as_lines: bool = False) -> Page:
    if as_lines:
        pairs = [np.stack([c[:-1], c[1:]], axis=1) for c in house.centre_lines]
        page.faces = np.concatenate(pairs)
    else:
        page.faces = _segments(house.solid)
    holes = [_hole(*o, more=0.14) for o in house.doors + house.windows]
    page.either = shapely.union_all(holes)
    return page


def _swing(page: Page, door, rng, open_deg: float = 90.0, leaf: float = THIN) -> None:
    at, along, wide, thick = door
    along = along * rng.choice([-1, 1])
    across = np.array([-along[1], along[0]]) * rng.choice([-1, 1])
    hinge = at - wide / 2 * along + thick / 2 * across
    t = np.linspace(0, np.deg2rad(open_deg), max(int(open_deg / 6), 3))
    arc = hinge + wide * (np.cos(t)[:, None] * along + np.sin(t)[:, None] * across)
    page.stroke(*arc)
    if leaf > THIN:
        normal = np.array([-(arc[-1] - hinge)[1], (arc[-1] - hinge)[0]]) / wide * 0.04
        page.stroke(hinge, arc[-1], arc[-1] + normal, hinge + normal, hinge)
    else:
        page.stroke(hinge, arc[-1])


def _window(page: Page, window, colour: Colour = BLACK) -> None:
    at, along, wide, thick = window
    across = np.array([-along[1], along[0]])
    ends = [at - wide / 2 * along, at + wide / 2 * along]
    page.fill(_hole(at, along, wide, thick - 0.02), WHITE)
    for s in (-0.5, 0.0, 0.5):
        page.stroke(*[e + s * thick * across for e in ends], colour=colour)
    for e in ends:
        page.stroke(e - thick / 2 * across, e + thick / 2 * across, colour=colour)


def _furnish(page: Page, house: House, rng) -> None:
    """A few pieces in each room, that stand clear of walls or against them."""
    for room in house.rooms:
        x0, y0, x1, y1 = room.bounds
        for _ in range(int(rng.integers(2, 5))):
            w, h = rng.uniform(0.5, 2.0), rng.uniform(0.4, 0.9)
            w, h = (w, h) if rng.random() < 0.5 else (h, w)
            if x1 - x0 < w + 0.4 or y1 - y0 < h + 0.4:
                continue
            x, y = rng.uniform(x0 + 0.05, x1 - w - 0.05), rng.uniform(y0 + 0.05, y1 - h - 0.05)
            if rng.random() < 0.4:
                x = x0 + 0.02
            if not room.contains(shapely.box(x, y, x + w, y + h)):
                continue
            page.box(x, y, w, h)
            kind = rng.integers(4)
            if kind == 0:
                page.box(x + 0.08, y + 0.08, w - 0.16, h - 0.16)
            elif kind == 1:
                page.circle(x + w / 2, y + h / 2, 0.4 * min(w, h))
            elif kind == 2:
                for k in range(1, int(w / 0.3) + 1):
                    page.stroke((x + 0.3 * k - 0.02, y), (x + 0.3 * k - 0.02, y + h))


def _tiles(page: Page, room: BaseGeometry, step: float) -> None:
    x0, y0, x1, y1 = room.bounds
    for x in np.arange(x0 + step, x1, step):
        page.stroke((x, y0), (x, y1), width=0.006, colour=(150, 150, 150))
    for y in np.arange(y0 + step, y1, step):
        page.stroke((x0, y), (x1, y), width=0.006, colour=(150, 150, 150))


def _labels(page: Page, house: House, rng, height: float = 0.25) -> None:
    for k, room in enumerate(house.rooms):
        word = str(rng.choice(["Room", "Office", "Kitchen", "Hall", "Store", "WC"]))
        page.parts.append(
            Label(f"{word} {k + 1}", np.array(room.representative_point().coords[0]), height)
        )


def _sheet(page: Page, rng, title_block: bool = True) -> None:
    """Frame, title block with rules, and letters."""
    low, high = page.bounds
    low, high = low - rng.uniform(1.5, 2.5, 2), high + rng.uniform(1.5, 2.5, 2)
    w, h = high - low
    page.box(*low, w, h, width=0.05)
    page.box(*(low - 0.4), w + 0.8, h + 0.8)
    if title_block:
        bw, bh = 0.35 * w, 1.3
        x, y = high[0] - bw, low[1]
        page.box(x, y, bw, bh, width=0.03)
        for k in range(1, 4):
            page.stroke((x, y + k * bh / 4), (x + bw, y + k * bh / 4))
        page.stroke((x + bw * 0.4, y), (x + bw * 0.4, y + bh))
        for k in range(4):
            page.parts.append(
                Label("Project A-12 Rev C", np.array([x + 0.1, y + 0.06 + k * bh / 4]), 0.18)
            )


def _dimensions(page: Page, house: House) -> None:
    x0, y0, x1, _ = house.outside.bounds
    cuts = sorted({x0, x1, *[round(float(r.bounds[0]), 2) for r in house.rooms]})
    for off in (0.8, 1.3):
        at = cuts if off < 1 else [x0, x1]
        page.stroke((x0 - 0.2, y0 - off), (x1 + 0.2, y0 - off))
        for x in at:
            page.stroke((x, y0 - off - 0.15), (x, y0 - 0.3))
            page.stroke((x - 0.1, y0 - off - 0.1), (x + 0.1, y0 - off + 0.1), width=0.03)
        for a, b in itertools.pairwise(at):
            page.parts.append(
                Label(f"{b - a:.2f}", np.array([(a + b) / 2 - 0.2, y0 - off + 0.06]), 0.16)
            )


def _axes(page: Page, house: House, rng) -> None:
    x0, y0, x1, y1 = house.outside.bounds
    for k, x in enumerate(np.linspace(x0 + 0.15, x1 - 0.15, int(rng.integers(3, 6)))):
        page.stroke((x, y0 - 2.2), (x, y1 + 1.0), width=0.008, dashed=True)
        page.circle(x, y1 + 1.35, 0.35)
        page.parts.append(Label("ABCDEF"[k], np.array([x - 0.1, y1 + 1.25]), 0.25))


def _escape(rng) -> Page:
    page, house = Page(), make_house(rng)
    grey = int(rng.choice([0, 60, 110]))
    page.fill(house.solid, (grey,) * 3)
    for window in house.windows:
        _window(page, window)
    green = (0, 150, 70)
    route = [np.array(r.centroid.coords[0]) for r in house.rooms[:4]]
    page.stroke(*route, width=0.12, colour=green)
    for at in route:
        page.fill(shapely.box(*(at - 0.3), *(at + 0.3)), green)
        page.fill(translate(shapely.Polygon([(-0.15, -0.15), (0.2, 0), (-0.15, 0.15)]), *at), WHITE)
    for room in house.rooms:
        x, y = np.array(room.bounds[:2]) + 0.35
        page.fill(shapely.box(x, y, x + 0.35, y + 0.35), (220, 20, 30))
    page.fill(shapely.Point(route[-1] + 0.8).buffer(0.2), (20, 60, 200))
    x0, y0, x1, y1 = house.outside.bounds
    for k in range(2):
        x, y = x1 + 1.5, y0 + 4.2 * k
        page.box(x, y, 5, 3.8, width=0.04, colour=green if k else (220, 20, 30))
        page.fill(shapely.box(x, y + 3.2, x + 5, y + 3.8), green if k else (220, 20, 30))
        for j in range(6):
            page.parts.append(
                Label("Keep calm and leave", np.array([x + 0.7, y + 0.2 + 0.5 * j]), 0.22)
            )
            page.fill(shapely.box(x + 0.15, y + 0.2 + 0.5 * j, x + 0.45, y + 0.5 + 0.5 * j), green)
    page.parts.append(Label("ESCAPE PLAN", np.array([x0 + 2, y1 + 0.8]), 0.8))
    _sheet(page, rng, title_block=False)
    return _with_truth(page, house)


def _cad_sheet(rng) -> Page:
    page, house = Page(), make_house(rng)
    page.outline(house.solid, width=0.03)
    for window in house.windows:
        _window(page, window)
    for door in house.doors:
        _swing(page, door, rng, leaf=0.04)
    _labels(page, house, rng)
    _dimensions(page, house)
    _axes(page, house, rng)
    _sheet(page, rng)
    return _with_truth(page, house)


def _furnished(rng) -> Page:
    page, house = Page(), make_house(rng, rooms=6)
    tone = int(rng.choice([0, 40, 90]))
    page.fill(house.solid, (tone,) * 3)
    for window in house.windows:
        _window(page, window)
    for door in house.doors:
        _swing(page, door, rng)
    _furnish(page, house, rng)
    _tiles(page, house.rooms[0], 0.3)
    _labels(page, house, rng)
    return _with_truth(page, house)


def _web(rng) -> Page:
    page, house = Page(), make_house(rng)
    x0, y0, x1, y1 = house.outside.bounds
    page.fill(shapely.box(x0 - 2, y0 - 2, x1 + 2, y1 + 2), (245, 245, 240))
    dark = [(44, 62, 80), (70, 70, 70), (93, 64, 55)][int(rng.integers(3))]
    page.fill(house.inside, (255, 253, 245))
    for room in house.rooms:
        page.fill(room, tuple(int(v) for v in rng.integers(205, 250, 3)))
    page.fill(house.solid, dark)
    for window in house.windows:
        page.fill(_hole(*window[:3], window[3] * 0.4), (150, 200, 240))
    for room in house.rooms:
        x, y = room.representative_point().coords[0]
        page.fill(shapely.Point(x, y + 0.6).buffer(0.3), (52, 152, 219))
    _labels(page, house, rng, 0.3)
    return _with_truth(page, house)


def _museum(rng) -> Page:
    page, house = Page(), make_house(rng, rooms=4)
    x0, y0, x1, y1 = house.outside.bounds
    page.fill(shapely.box(x0 - 3, y0 - 3, x1 + 3, y1 + 3), (214, 230, 205))
    page.fill(house.outside, (250, 240, 215))
    grey = int(rng.choice([80, 120, 150]))
    for line in house.centre_lines:
        page.stroke(*line, width=0.14, colour=(grey,) * 3)
    for k, room in enumerate(house.rooms):
        x, y = room.representative_point().coords[0]
        page.fill(shapely.Point(x, y).buffer(0.45), (170, 40, 50))
        page.parts.append(Label(str(k + 1), np.array([x - 0.1, y - 0.15]), 0.35))
        for s in (-1, 1):
            page.box(x + s * 1.2 - 0.2, y - 0.5, 0.4, 1.0, colour=(90, 90, 90))
    _with_truth(page, house)
    bodies = [
        shapely.LineString(c).buffer(0.07, cap_style="flat", join_style="mitre")
        for c in house.centre_lines
    ]
    page.faces = _segments(shapely.union_all(bodies))
    return page


def _gis(rng) -> Page:
    page, house = Page(), make_house(rng)
    for room in house.rooms:
        page.fill(room, tuple(int(v) for v in rng.integers(190, 245, 3)))
    page.outline(house.outside, width=0.03)
    for room in house.rooms:
        page.outline(room, width=0.02)
    _labels(page, house, rng)
    _with_truth(page, house)
    page.faces = np.concatenate([_segments(house.outside), *[_segments(r) for r in house.rooms]])
    return page


def _half_open(rng) -> Page:
    page, house = Page(), make_house(rng)
    if rng.random() < 0.5:
        page.outline(house.solid, width=0.03)
    else:
        page.fill(house.solid, (70, 70, 70))
    for window in house.windows:
        _window(page, window)
    for door in house.doors:
        _swing(page, door, rng, float(rng.uniform(25, 70)), leaf=float(rng.choice([THIN, 0.04])))
    _furnish(page, house, rng)
    _labels(page, house, rng)
    return _with_truth(page, house)


def _single_line(rng) -> Page:
    page, house = Page(), make_house(rng)
    for line in house.centre_lines:
        page.stroke(*line, width=float(rng.choice([0.02, 0.04])))
    for door in house.doors:
        _swing(page, (*door[:3], 0.0), rng)
    _furnish(page, house, rng)
    _labels(page, house, rng)
    return _with_truth(page, house, as_lines=True)


def _hatched(rng) -> Page:
    page, house = Page(), make_house(rng)
    step, angle = rng.uniform(0.06, 0.14), float(rng.choice([45, 30, 60]))
    x0, y0, x1, y1 = house.outside.bounds
    reach = x1 - x0 + y1 - y0
    centre = shapely.Point((x0 + x1) / 2, (y0 + y1) / 2)
    solid = house.solid.difference(shapely.union_all([_hole(*w) for w in house.windows]))
    rows = [shapely.LineString([(centre.x - reach, centre.y + k), (centre.x + reach, centre.y + k)])
            for k in np.arange(-reach / 2, reach / 2, step)]  # fmt: skip
    for row in rows:
        for piece in shapely.get_parts(rotate(row, angle, origin=centre).intersection(solid)):
            if piece.length > 0.02:
                page.stroke(*np.array(piece.coords), width=0.008)
    page.outline(solid, width=0.03)
    for window in house.windows:
        _window(page, window)
    for door in house.doors:
        _swing(page, door, rng)
    _furnish(page, house, rng)
    _labels(page, house, rng)
    _dimensions(page, house)
    return _with_truth(page, house)


def _white_walls(rng) -> Page:
    page, house = Page(), make_house(rng)
    x0, y0, x1, y1 = house.outside.bounds
    tint = [(200, 210, 220), (225, 215, 195), (120, 140, 160)][int(rng.integers(3))]
    page.fill(shapely.box(x0 - 1.5, y0 - 1.5, x1 + 1.5, y1 + 1.5), tint)
    page.fill(house.solid, WHITE)
    if rng.random() < 0.5:
        page.outline(house.solid, width=0.01, colour=(90, 90, 90))
    for window in house.windows:
        page.fill(_hole(*window[:3], window[3] * 0.3), (90, 160, 220))
    for door in house.doors:
        _swing(page, door, rng)
    _labels(page, house, rng)
    return _with_truth(page, house)


def _curved(rng) -> Page:
    page, house = Page(), make_house(rng, shape=str(rng.choice(["bay", "round"])))
    if rng.random() < 0.5:
        page.fill(house.solid, (50, 50, 50))
    else:
        page.outline(house.solid, width=0.025)
    for window in house.windows:
        _window(page, window)
    for door in house.doors:
        _swing(page, door, rng)
    _furnish(page, house, rng)
    return _with_truth(page, house)


def _grey_outlined(rng) -> Page:
    page, house = Page(), make_house(rng)
    page.fill(house.solid, (int(rng.integers(150, 215)),) * 3)
    page.outline(house.solid, width=0.025)
    for window in house.windows:
        _window(page, window)
    for door in house.doors:
        _swing(page, door, rng, leaf=0.04)
    _furnish(page, house, rng)
    _tiles(page, house.rooms[-1], 0.25)
    _dimensions(page, house)
    _sheet(page, rng)
    return _with_truth(page, house)


def _thick_strokes(rng) -> Page:
    page, house = Page(), make_house(rng)
    thick = {
        True: max(o[3] for o in house.windows + house.doors),
        False: min(o[3] for o in house.doors),
    }
    bodies = []
    for line in house.centre_lines:
        is_outer = shapely.LineString(line).distance(house.outside.exterior) < 0.6 * thick[True]
        is_outer &= shapely.LineString(line).within(
            house.outside.exterior.buffer(0.6 * thick[True])
        )
        page.stroke(*line, width=thick[bool(is_outer)], colour=(30, 30, 30))
        bodies.append(
            shapely.LineString(line).buffer(
                thick[bool(is_outer)] / 2, cap_style="flat", join_style="mitre"
            )
        )
    for door in house.doors:
        _swing(page, door, rng)
    _furnish(page, house, rng)
    _labels(page, house, rng)
    _with_truth(page, house)
    page.faces = _segments(shapely.union_all(bodies))
    return page


def _mixed(rng) -> Page:
    """Any page, walls, doors and clutter of the others together."""
    page, house = Page(), make_house(rng, shape=str(rng.choice(["box", "L", "bay", "round"])))
    x0, y0, x1, y1 = house.outside.bounds
    tint = tuple(int(v) for v in rng.integers(205, 250, 3))
    kind = str(rng.choice(["solid", "outline", "grey", "white"]))
    if kind == "white" or rng.random() < 0.3:
        page.fill(
            shapely.box(x0 - 2, y0 - 2, x1 + 2, y1 + 2),
            (120, 140, 160) if kind == "white" else tint,
        )
    if kind != "white" and rng.random() < 0.3:
        page.fill(house.outside, (252, 248, 238))
    if kind != "white" and rng.random() < 0.3:
        for room in house.rooms:
            page.fill(room, tuple(int(v) for v in rng.integers(205, 250, 3)))
    tones = {"solid": int(rng.integers(0, 100)), "grey": int(rng.integers(140, 200)), "white": 255}
    if kind in tones:
        page.fill(house.solid, (tones[kind],) * 3)
    if kind in ("outline", "grey"):
        page.outline(house.solid, width=float(rng.choice([0.01, 0.025, 0.04])))
    for window in house.windows if kind != "white" else ():
        _window(page, window)
    doors = int(rng.integers(3))
    for door in house.doors if doors else ():
        _swing(
            page,
            door,
            rng,
            90.0 if doors == 1 else float(rng.uniform(25, 80)),
            float(rng.choice([THIN, 0.04])),
        )
    if rng.random() < 0.6:
        _furnish(page, house, rng)
    if rng.random() < 0.3:
        _tiles(page, house.rooms[0], 0.3)
    if rng.random() < 0.5:
        _labels(page, house, rng)
    if kind != "white" and rng.random() < 0.4:
        _dimensions(page, house)
    if kind != "white" and rng.random() < 0.4:
        _sheet(page, rng)
    return _with_truth(page, house)


_MAKERS: dict[str, Callable[[np.random.Generator], Page]] = {
    "escape": _escape,
    "cad_sheet": _cad_sheet,
    "furnished": _furnished,
    "web": _web,
    "museum": _museum,
    "gis": _gis,
    "half_open": _half_open,
    "single_line": _single_line,
    "hatched": _hatched,
    "white_walls": _white_walls,
    "curved": _curved,
    "grey_outlined": _grey_outlined,
    "thick_strokes": _thick_strokes,
    "mixed": _mixed,
}
FAMILIES = tuple(_MAKERS)


def make_page(family: str, seed: int) -> Page:
    """One page of a family."""
    return _MAKERS[family](np.random.default_rng([seed, FAMILIES.index(family)]))
