"""Pictures of plans as offices, agents, scanners and phones make them, drawn for these tests alone.

Nothing here is shared with the readers or with `planfit.synth`: rooms by repeated cuts, walls as one polygon,
drawn with Pillow at twice the size.
"""

import io
import itertools
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from PIL import Image, ImageDraw, ImageFilter, ImageFont
from shapely.geometry.base import BaseGeometry

TWICE = 2


@dataclass(frozen=True)
class House:
    """In metres, y down as in pictures."""

    walls: BaseGeometry
    """With gaps for doors and windows."""
    windows: list[shapely.Polygon]
    doors: list[tuple[np.ndarray, np.ndarray, float]]
    """Hinge, direction of the closed leaf, width."""
    rooms: list[tuple[float, float, float, float]]


def house(rng: np.random.Generator, width_m: float = 13.0, height_m: float = 9.0) -> House:
    """A floor of rooms cut in two again and again; outer walls are thicker; one corner is cut off."""
    outer, inner = float(rng.choice([0.3, 0.36])), float(rng.choice([0.11, 0.15]))
    rooms, cuts = [(0.0, 0.0, width_m, height_m)], []
    while True:
        rooms.sort(key=lambda r: -(r[2] - r[0]) * (r[3] - r[1]))
        x0, y0, x1, y1 = rooms[0]
        if (x1 - x0) * (y1 - y0) < 17.0:
            break
        share = rng.uniform(0.38, 0.62)
        rooms.pop(0)
        if x1 - x0 > y1 - y0:
            x = round(x0 + share * (x1 - x0), 2)
            cuts.append((x, y0, x, y1))
            rooms += [(x0, y0, x, y1), (x, y0, x1, y1)]
        else:
            y = round(y0 + share * (y1 - y0), 2)
            cuts.append((x0, y, x1, y))
            rooms += [(x0, y0, x1, y), (x0, y, x1, y1)]
    slant = 1.8
    around = shapely.Polygon(
        [(0, 0), (width_m, 0), (width_m, height_m), (slant, height_m), (0, height_m - slant)]
    )
    shell = shapely.difference(shapely.buffer(around, outer, join_style="mitre"), around)
    parts = [shapely.LineString([c[:2], c[2:]]).buffer(inner / 2, cap_style="flat") for c in cuts]
    walls = shapely.union_all([shell, shapely.intersection(shapely.union_all(parts), around)])
    doors, holes = [], []
    ends = [c for c in cuts]
    for x0, y0, x1, y1 in ends:
        along = np.array([x1 - x0, y1 - y0])
        length = float(np.hypot(*along))
        along = along / length
        at = np.array([x0, y0]) + rng.uniform(0.25, max(0.26, length - 1.4)) * along
        crossing = shapely.LineString([at - 0.15 * along, at + 1.0 * along])
        others = [c for c in cuts if c != (x0, y0, x1, y1)]
        if any(crossing.distance(shapely.LineString([c[:2], c[2:]])) < inner for c in others):
            continue
        doors.append((at, along, 0.85))
        holes.append(shapely.LineString([at, at + 0.85 * along]).buffer(inner, cap_style="flat"))
    windows = []
    for x0, y0, x1, _ in rooms:
        if y0 == 0.0 and x1 - x0 > 2.2:
            middle = (x0 + x1) / 2
            hole = shapely.box(middle - 0.7, -outer, middle + 0.7, 0.0)
            windows.append(hole)
            holes.append(hole)
    return House(shapely.difference(walls, shapely.union_all(holes)), windows, doors, rooms)


@dataclass
class Sheet:
    """A drawing at twice its size."""

    px_per_m: float
    size: tuple[int, int]
    margin_m: float
    paper: tuple[int, int, int] = (255, 255, 255)
    image: Image.Image = field(init=False)
    pen: ImageDraw.ImageDraw = field(init=False)

    def __post_init__(self) -> None:
        self.image = Image.new("RGB", (TWICE * self.size[0], TWICE * self.size[1]), self.paper)
        self.pen = ImageDraw.Draw(self.image)

    def at(self, points: object) -> np.ndarray:
        return (np.asarray(points, float) + self.margin_m) * self.px_per_m * TWICE

    def area(
        self, shape: BaseGeometry, fill: object, outline: object = None, px: float = 0
    ) -> None:
        for part in shapely.get_parts(shape):
            mask = Image.new("L", self.image.size, 0)
            pen = ImageDraw.Draw(mask)
            for k, ring in enumerate([part.exterior, *part.interiors]):
                pen.polygon([tuple(p) for p in self.at(ring.coords)], fill=0 if k else 255)
            if fill is not None:
                self.image.paste(fill, mask=mask)
            if outline is not None:
                for ring in [part.exterior, *part.interiors]:
                    self.line(ring.coords, outline, px)

    def line(self, points: object, colour: object, px: float) -> None:
        flat = [tuple(p) for p in self.at(points)]
        self.pen.line(flat, fill=colour, width=max(round(TWICE * px), 1), joint="curve")

    def text(self, at: tuple[float, float], words: str, colour: object, px: float) -> None:
        font = ImageFont.load_default(size=TWICE * px)
        self.pen.text(tuple(self.at(at)), words, fill=colour, font=font, anchor="mm")

    def arc(self, centre: object, radius: float, low: float, colour: object, px: float) -> None:
        angle = np.deg2rad(np.linspace(low, low + 90, 20))
        self.line(
            np.asarray(centre) + radius * np.stack([np.cos(angle), np.sin(angle)], 1), colour, px
        )

    def done(self) -> np.ndarray:
        return np.asarray(self.image.resize(self.size, Image.Resampling.BOX))[..., ::-1].copy()


@dataclass(frozen=True)
class StrangePicture:
    """A picture and what is wall in it."""

    image: np.ndarray
    """BGR."""
    outline: np.ndarray
    """(n, 2) u, v, about a point a pixel."""
    near_px: float


Draw = Callable[[Sheet, House, np.random.Generator], None]


def _fixtures(sheet: Sheet, plan: House, rng: np.random.Generator, ink: object, px: float) -> None:
    """Doors with swings, windows of three lines, furniture, names of rooms."""
    for hinge, along, width in plan.doors:
        across = np.array([-along[1], along[0]])
        sheet.line([hinge, hinge + width * across], ink, px)
        low = np.rad2deg(np.arctan2(along[1], along[0]))
        sheet.arc(hinge, width, low, ink, px)
    for window in plan.windows:
        x0, y0, x1, y1 = window.bounds
        for y in (y0, (y0 + y1) / 2, y1):
            sheet.line([(x0, y), (x1, y)], ink, px)
    names = ["Bedroom", "Kitchen", "Bath 4.2 qm", "Office", "Living 21 qm", "Hall", "Store"]
    for k, (x0, y0, x1, y1) in enumerate(plan.rooms):
        middle = ((x0 + x1) / 2, (y0 + y1) / 2)
        sheet.text(middle, names[k % len(names)], ink, 0.22 * sheet.px_per_m)
        x, y = x0 + 0.45, y1 - 1.15
        sheet.area(shapely.box(x, y, x + 1.3, y + 0.7), None, ink, px)
        sheet.area(shapely.box(x + 0.1, y + 0.1, x + 0.5, y + 0.6), None, ink, px)
        if rng.random() < 0.5:
            angle = np.linspace(0, 2 * np.pi, 40)
            ring = np.array(middle) + [0.9, 0.6] + 0.4 * np.stack([np.cos(angle), np.sin(angle)], 1)
            sheet.line(ring, ink, px)


def _dimensions(sheet: Sheet, plan: House, ink: object, px: float) -> None:
    """Chains of lengths along two sides, with ticks and texts."""
    xs = sorted({r[0] for r in plan.rooms} | {r[2] for r in plan.rooms})
    ys = sorted({r[1] for r in plan.rooms} | {r[3] for r in plan.rooms})
    for off in (-1.0, -1.6):
        sheet.line([(xs[0], off), (xs[-1], off)], ink, px)
        sheet.line([(off, ys[0]), (off, ys[-1])], ink, px)
        for a, b in itertools.pairwise(xs):
            sheet.line([(a - 0.12, off + 0.12), (a + 0.12, off - 0.12)], ink, px)
            sheet.line([(a, off + 0.4), (a, off - 0.2)], ink, px)
            sheet.text(((a + b) / 2, off - 0.18), f"{b - a:.2f}", ink, 0.2 * sheet.px_per_m)
        for a in ys:
            sheet.line([(off - 0.12, a + 0.12), (off + 0.12, a - 0.12)], ink, px)


def solid(sheet: Sheet, plan: House, rng: np.random.Generator) -> None:
    sheet.area(plan.walls, (0, 0, 0))
    _fixtures(sheet, plan, rng, (0, 0, 0), 1.2)


def dimensioned(sheet: Sheet, plan: House, rng: np.random.Generator) -> None:
    sheet.area(plan.walls, None, (0, 0, 0), 1.6)
    _fixtures(sheet, plan, rng, (0, 0, 0), 1.0)
    _dimensions(sheet, plan, (0, 0, 0), 1.0)


def coloured_rooms(sheet: Sheet, plan: House, rng: np.random.Generator) -> None:
    """As estate agents have them: a colour a room, dark walls."""
    colours = [(250, 214, 180), (190, 225, 200), (180, 205, 240), (240, 190, 200), (245, 240, 170)]
    for k, room in enumerate(plan.rooms):
        sheet.area(shapely.box(*room), colours[k % 5])
    sheet.area(plan.walls, (40, 40, 40))
    _fixtures(sheet, plan, rng, (60, 60, 60), 1.2)


def coloured_walls(sheet: Sheet, plan: House, rng: np.random.Generator) -> None:
    """Walls in brick red, fittings blue."""
    sheet.area(plan.walls, (190, 60, 45))
    _fixtures(sheet, plan, rng, (40, 70, 160), 1.4)


def middle_grey(sheet: Sheet, plan: House, rng: np.random.Generator) -> None:
    """As portals have them: walls half as dark as black on tinted floors, paler furniture."""
    for k, room in enumerate(plan.rooms):
        sheet.area(shapely.box(*room), [(250, 240, 225), (225, 240, 250), (240, 250, 235)][k % 3])
    sheet.area(plan.walls, (120, 120, 125))
    _fixtures(sheet, plan, rng, (150, 150, 150), 1.2)


def hatched(sheet: Sheet, plan: House, rng: np.random.Generator) -> None:
    _hatch(sheet, plan, 0.09, 1.0)
    sheet.area(plan.walls, None, (0, 0, 0), 1.8)
    _fixtures(sheet, plan, rng, (0, 0, 0), 1.0)
    _dimensions(sheet, plan, (0, 0, 0), 0.8)


def _hatch(sheet: Sheet, plan: House, step: float, px: float) -> None:
    x0, y0, x1, y1 = plan.walls.bounds
    lines = [
        shapely.LineString([(x, y0), (x + (y1 - y0), y1)])
        for x in np.arange(x0 - (y1 - y0), x1, step * 1.414)
    ]
    cut = shapely.intersection(shapely.MultiLineString(lines), plan.walls)
    for part in shapely.get_parts(cut):
        if part.geom_type == "LineString":
            sheet.line(part.coords, (0, 0, 0), px)


def grey_outlined(sheet: Sheet, plan: House, rng: np.random.Generator) -> None:
    """Grey walls in a dark outline over floors of tiles."""
    for x0, y0, x1, y1 in plan.rooms[::2]:
        for x in np.arange(x0, x1, 0.3):
            sheet.line([(x, y0), (x, y1)], (200, 200, 200), 0.8)
        for y in np.arange(y0, y1, 0.3):
            sheet.line([(x0, y), (x1, y)], (200, 200, 200), 0.8)
    sheet.area(plan.walls, (150, 150, 150), (20, 20, 20), 1.6)
    _fixtures(sheet, plan, rng, (60, 60, 60), 1.0)


def parquet(sheet: Sheet, plan: House, rng: np.random.Generator) -> None:
    """Wooden floors in brown tones with joints, black walls."""
    for x0, y0, x1, y1 in plan.rooms:
        for k, y in enumerate(np.arange(y0, y1, 0.18)):
            tone = int(rng.integers(-14, 14))
            board = shapely.box(x0, y, x1, min(y + 0.18, y1))
            sheet.area(board, (205 + tone, 170 + tone, 125 + tone))
            if k % 2:
                sheet.line([(x0, y), (x1, y)], (150, 115, 80), 0.7)
    sheet.area(plan.walls, (25, 25, 25))
    _fixtures(sheet, plan, rng, (70, 60, 50), 1.2)


def watermarked(sheet: Sheet, plan: House, rng: np.random.Generator) -> None:
    for k in range(3):
        sheet.text((6.5, 2.0 + 2.8 * k), "SAMPLE ESTATES", (205, 205, 205), 1.3 * sheet.px_per_m)
    solid(sheet, plan, rng)


def gridded(sheet: Sheet, plan: House, rng: np.random.Generator) -> None:
    """Axes of a grid in dash-dots through the whole sheet, with their letters."""
    for k, x in enumerate(np.arange(0, 13.1, 3.25)):
        for y in np.arange(-2.0, 11.0, 0.6):
            sheet.line([(x, y), (x, y + 0.4)], (120, 120, 120), 0.8)
        sheet.text((x, -2.2), "ABCDE"[k], (0, 0, 0), 0.35 * sheet.px_per_m)
    sheet.area(plan.walls, (90, 90, 90))
    _fixtures(sheet, plan, rng, (0, 0, 0), 1.0)
    _dimensions(sheet, plan, (0, 0, 0), 0.8)


def white_walls(sheet: Sheet, plan: House, rng: np.random.Generator) -> None:
    """Rooms in colours, walls are what is left between them: black outlines around white."""
    for k, room in enumerate(plan.rooms):
        sheet.area(shapely.box(*room), [(225, 235, 250), (250, 235, 215), (225, 245, 225)][k % 3])
    sheet.area(plan.walls, (255, 255, 255), (0, 0, 0), 1.4)
    _fixtures(sheet, plan, rng, (0, 0, 0), 1.0)


def _thick_and_thin(plan: House) -> tuple[House, House]:
    """Outer walls, and partitions."""
    opened = plan.walls.buffer(-0.1, join_style="mitre").buffer(0.1001, join_style="mitre")
    thick = shapely.intersection(opened, plan.walls)
    parts = shapely.get_parts(shapely.difference(plan.walls, thick))
    thin = shapely.union_all(parts[shapely.area(parts) > 1e-4])
    return replace(plan, walls=thick), replace(plan, walls=thin)


def black_and_outlined(sheet: Sheet, plan: House, rng: np.random.Generator) -> None:
    """Bearing walls filled, partitions as two lines."""
    thick, thin = _thick_and_thin(plan)
    sheet.area(thick.walls, (0, 0, 0))
    sheet.area(thin.walls, None, (0, 0, 0), 1.4)
    _fixtures(sheet, plan, rng, (0, 0, 0), 1.0)


def black_with_cupboards(sheet: Sheet, plan: House, rng: np.random.Generator) -> None:
    """Filled walls; along them rows of cupboards and shelves, which are as long and thin as walls."""
    sheet.area(plan.walls, (0, 0, 0))
    for k, (x0, y0, x1, y1) in enumerate(plan.rooms):
        deep = 0.6 if k % 2 else 0.3
        rows = [
            shapely.box(x0 + 0.08, y1 - 0.08 - deep, x1 - 1.0, y1 - 0.08),
            shapely.box(x0 + 0.08, y0 + 0.08, x0 + 0.08 + deep, y1 - 1.2),
        ]
        for row in rows:
            sheet.area(shapely.difference(row, plan.walls), None, (0, 0, 0), 1.2)
    _fixtures(sheet, plan, rng, (0, 0, 0), 1.0)


def outlined_and_black(sheet: Sheet, plan: House, rng: np.random.Generator) -> None:
    thick, thin = _thick_and_thin(plan)
    sheet.area(thick.walls, None, (0, 0, 0), 1.6)
    sheet.area(thin.walls, (0, 0, 0))
    _fixtures(sheet, plan, rng, (0, 0, 0), 1.0)


def black_and_grey(sheet: Sheet, plan: House, rng: np.random.Generator) -> None:
    """Old walls black, new ones grey."""
    thick, thin = _thick_and_thin(plan)
    sheet.area(thin.walls, (150, 150, 150))
    sheet.area(thick.walls, (0, 0, 0))
    _fixtures(sheet, plan, rng, (0, 0, 0), 1.0)


def grey_and_black(sheet: Sheet, plan: House, rng: np.random.Generator) -> None:
    thick, thin = _thick_and_thin(plan)
    sheet.area(thick.walls, (150, 150, 150), (20, 20, 20), 1.6)
    sheet.area(thin.walls, (0, 0, 0))
    _fixtures(sheet, plan, rng, (0, 0, 0), 1.0)


def hatched_and_black(sheet: Sheet, plan: House, rng: np.random.Generator) -> None:
    """Masonry hatched, dry walls filled."""
    thick, thin = _thick_and_thin(plan)
    _hatch(sheet, thick, 0.09, 1.0)
    sheet.area(thick.walls, None, (0, 0, 0), 1.8)
    sheet.area(thin.walls, (0, 0, 0))
    _fixtures(sheet, plan, rng, (0, 0, 0), 1.0)


def hatched_and_outlined(sheet: Sheet, plan: House, rng: np.random.Generator) -> None:
    thick, thin = _thick_and_thin(plan)
    _hatch(sheet, thick, 0.09, 1.0)
    sheet.area(thick.walls, None, (0, 0, 0), 1.8)
    sheet.area(thin.walls, None, (0, 0, 0), 1.4)
    _fixtures(sheet, plan, rng, (0, 0, 0), 1.0)


def as_it_is(image: np.ndarray, _rng: np.random.Generator) -> np.ndarray:
    return image


def scanned(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Grey, uneven paper, grain, dust."""
    h, w = image.shape[:2]
    paper = 205 + 18 * np.sin(np.linspace(0, 3, w))[None] - 14 * np.linspace(0, 1, h)[:, None]
    soft = np.asarray(Image.fromarray(image).filter(ImageFilter.GaussianBlur(0.7)), float)
    result = soft / 255 * paper[..., None] + rng.normal(size=(h, w, 1)) * 7 + 12
    for _ in range(150):
        v, u = rng.integers(0, h - 3), rng.integers(0, w - 3)
        result[v : v + 2, u : u + 2] = 70
    return np.clip(result, 0, 255).astype(np.uint8)


def jpeg(image: np.ndarray, _rng: np.random.Generator) -> np.ndarray:
    buffer = io.BytesIO()
    Image.fromarray(image[..., ::-1]).save(buffer, "JPEG", quality=22)
    return np.asarray(Image.open(buffer).convert("RGB"))[..., ::-1].copy()


def inverted(image: np.ndarray, _rng: np.random.Generator) -> np.ndarray:
    """White on the blue of old prints."""
    share = image.mean(axis=2, keepdims=True) / 255
    blue = np.array([150.0, 70.0, 25.0])
    return np.clip(share * blue + (1 - share) * 240, 0, 255).astype(np.uint8)


def dark_mode(image: np.ndarray, _rng: np.random.Generator) -> np.ndarray:
    """A screen of a dark program: light grey on nearly black."""
    share = image.mean(axis=2, keepdims=True) / 255
    return np.repeat((30 + (1 - share) * 170).astype(np.uint8), 3, axis=2)


def sepia(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Faded brown ink on yellow paper with stains."""
    h, w = image.shape[:2]
    share = image.mean(axis=2, keepdims=True) / 255
    stains = np.asarray(
        Image.fromarray((rng.random((h // 40 + 1, w // 40 + 1)) * 40).astype(np.uint8)).resize(
            (w, h)
        )
    )
    paper, ink = np.array([165.0, 210, 228]), np.array([60.0, 85, 110])
    result = share * paper + (1 - share) * ink - stains[..., None] * 0.6
    return np.clip(result + rng.normal(size=(h, w, 1)) * 4, 0, 255).astype(np.uint8)


STYLES: dict[str, tuple[Draw, Callable[..., np.ndarray]]] = {
    "solid": (solid, as_it_is),
    "solid, scanned": (solid, scanned),
    "solid, JPEG": (solid, jpeg),
    "solid, blueprint": (solid, inverted),
    "solid, dark screen": (solid, dark_mode),
    "solid, sepia": (solid, sepia),
    "dimensioned": (dimensioned, as_it_is),
    "dimensioned, scanned": (dimensioned, scanned),
    "dimensioned, blueprint": (dimensioned, inverted),
    "coloured rooms": (coloured_rooms, as_it_is),
    "coloured rooms, JPEG": (coloured_rooms, jpeg),
    "coloured walls": (coloured_walls, as_it_is),
    "middle grey, JPEG": (middle_grey, jpeg),
    "hatched": (hatched, as_it_is),
    "hatched, scanned": (hatched, scanned),
    "grey, outlined": (grey_outlined, as_it_is),
    "grey, outlined, dark screen": (grey_outlined, dark_mode),
    "parquet": (parquet, as_it_is),
    "watermarked": (watermarked, as_it_is),
    "gridded": (gridded, as_it_is),
    "gridded, JPEG": (gridded, jpeg),
    "white walls": (white_walls, as_it_is),
    "black and outlined": (black_and_outlined, as_it_is),
    "black with cupboards": (black_with_cupboards, as_it_is),
    "outlined and black": (outlined_and_black, as_it_is),
    "black and grey": (black_and_grey, as_it_is),
    "grey and black": (grey_and_black, as_it_is),
    "hatched and black": (hatched_and_black, as_it_is),
    "hatched and outlined": (hatched_and_outlined, as_it_is),
    "black and outlined, scanned": (black_and_outlined, scanned),
    "black and outlined, JPEG": (black_and_outlined, jpeg),
    "hatched and black, JPEG": (hatched_and_black, jpeg),
}


def strange_picture(style: str, seed: int, px_per_m: float = 60.0) -> StrangePicture:
    """A picture in one of `STYLES`."""
    rng = np.random.default_rng(seed)
    plan = house(rng)
    margin = 2.8
    size = tuple(int((side + 2 * margin) * px_per_m) for side in (13.0, 9.0))
    sheet = Sheet(px_per_m, size, margin)  # type: ignore[arg-type]
    draw, finish = STYLES[style]
    draw(sheet, plan, rng)
    rings = []
    for part in shapely.get_parts(plan.walls):
        for ring in (part.exterior, *part.interiors):
            n = max(int(ring.length * px_per_m), 4)
            rings.append(
                shapely.get_coordinates(
                    shapely.line_interpolate_point(ring, np.arange(n) / n, normalized=True)
                )
            )
    outline = (np.concatenate(rings) + margin) * px_per_m - 0.5
    near = max(0.01 * float(np.ptp(outline, axis=0).max()) / 1.6, 3.0)
    return StrangePicture(finish(sheet.done(), rng), outline, near)
