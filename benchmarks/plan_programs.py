"""Flats whose walls are known, drawn by programs that are not ours: archit-app and renovation.

    pip install "archit-app[io,image,pdf,ifc]==0.7.0" renovation==0.2.0
    python benchmarks/plan_programs.py -o /tmp/programs [--first 0] [--flats 24] [--only png]

Each flat is written as SVG, DXF, PDF, PNG, GeoJSON and IFC by the one and as PDF and PNG by the other, and
read. Recall, precision, wrong and silent are those of benchmarks/foreign_drawings.py.
"""

import argparse
import json
import math
import random
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import shapely
from archit_app import (
    WORLD,
    Building,
    DimensionLine,
    Furniture,
    Level,
    Opening,
    OpeningKind,
    Polygon2D,
    Room,
    Wall,
)
from archit_app.io import image as archit_image
from archit_app.io import pdf as archit_pdf
from archit_app.io import svg as archit_svg
from archit_app.io.dxf import save_level_dxf
from archit_app.io.geojson import save_level_geojson
from archit_app.io.ifc import save_building_ifc
from foreign_drawings import Score, score, summary
from foreign_pages import Page
from renovation.elements import create_elements_registry
from renovation.floor_plan import FloorPlan

A3_POINTS = (1190.55, 841.89)
POINTS_PER_INCH = 72
WINDOWS_M, DOOR_M = (0.8, 1.2, 1.6), 0.9
FURNITURE = ("sofa", "desk", "bed_double", "wardrobe", "bathtub", "round_table", "sink", "toilet")
Point = tuple[float, float]


@dataclass(frozen=True)
class Bar:
    """A wall, m; the first four of a flat are the outer ones."""

    start: Point
    end: Point
    thickness: float

    @property
    def length(self) -> float:
        """Along the axis."""
        return math.dist(self.start, self.end)

    @property
    def along(self) -> np.ndarray:
        """Unit vector."""
        return (np.array(self.end) - self.start) / self.length

    def box(self, begin: float, end: float, grown: float = 0.0) -> shapely.Polygon:
        """The part between two places along the axis, its thickness grown on either side."""
        across = np.array([-self.along[1], self.along[0]]) * (self.thickness / 2 + grown)
        first, last = (np.array(self.start) + at * self.along for at in (begin, end))
        return shapely.Polygon([first - across, last - across, last + across, first + across])


@dataclass(frozen=True)
class Hole:
    """A door or a window in a bar, m."""

    bar: int
    at: float
    width: float
    is_door: bool


@dataclass(frozen=True)
class Flat:
    """A rectangle cut into rooms."""

    size: Point
    bars: list[Bar]
    rooms: list[tuple[float, float, float, float]]
    holes: list[Hole]

    def page(self) -> Page:
        """Faces, open at doors; at doors and windows either is right."""
        solid = shapely.union_all([bar.box(0, bar.length) for bar in self.bars])
        holes = [
            self.bars[h.bar].box(h.at - h.width / 2, h.at + h.width / 2, 0.01) for h in self.holes
        ]
        doors = [area for area, hole in zip(holes, self.holes, strict=True) if hole.is_door]
        rings = shapely.get_rings(shapely.get_parts(solid.difference(shapely.union_all(doors))))
        corners = [shapely.get_coordinates(ring) for ring in rings]
        faces = np.concatenate([np.stack([c[:-1], c[1:]], axis=1) for c in corners])
        return Page(faces=faces, either=shapely.buffer(shapely.union_all(holes), 0.08))


def make_flat(rng: random.Random) -> Flat:
    """Three to nine rooms, windows outside and a door in each wall within."""
    w, h = rng.uniform(9, 22), rng.uniform(7, 14)
    outer, inner = rng.choice([0.2, 0.25, 0.3, 0.4]), rng.choice([0.08, 0.1, 0.12, 0.15])
    corners = [(0.0, 0.0), (w, 0.0), (w, h), (0.0, h)]
    bars = [Bar(corners[k], corners[(k + 1) % 4], outer) for k in range(4)]
    rooms: list[tuple[float, float, float, float]] = []

    def cut(x0: float, y0: float, x1: float, y1: float, n: int) -> None:
        if n <= 1 or max(x1 - x0, y1 - y0) < 4.2:
            rooms.append((x0, y0, x1, y1))
            return
        share = rng.uniform(0.38, 0.62)
        if x1 - x0 > y1 - y0:
            x = x0 + share * (x1 - x0)
            bars.append(Bar((x, y0), (x, y1), inner))
            halves = ((x0, y0, x, y1), (x, y0, x1, y1))
        else:
            y = y0 + share * (y1 - y0)
            bars.append(Bar((x0, y), (x1, y), inner))
            halves = ((x0, y0, x1, y), (x0, y, x1, y1))
        for half, k in zip(halves, (n // 2, n - n // 2), strict=True):
            cut(*half, k)

    cut(0.0, 0.0, w, h, rng.randint(3, 9))
    return Flat((w, h), bars, rooms, _holes(rng, bars))


def _holes(rng: random.Random, bars: list[Bar]) -> list[Hole]:
    found: list[Hole] = []
    for k, bar in enumerate(bars):
        spots = [bar.length / 2]
        if k < 4:
            spots = list(np.arange(1.5, bar.length - 1.2, rng.uniform(2.2, 4.0)))
        for j, spot in enumerate(spots):
            is_door = k >= 4 or (k == 0 and j == 0)
            width, at = DOOR_M if is_door else rng.choice(WINDOWS_M), float(spot)
            others = [shapely.LineString([b.start, b.end]) for b in bars if b is not bar]
            for _ in range(12):
                reach = np.array([[at - width / 2], [at + width / 2]])
                part = shapely.LineString(bar.start + reach * bar.along)
                if min(part.distance(other) for other in others) > 0.35:
                    break
                at = rng.uniform(0.8, bar.length - 0.8)
            else:
                continue
            if all(o.bar != k or abs(o.at - at) > (o.width + width) / 2 + 0.3 for o in found):
                found.append(Hole(k, at, width, is_door))
    return found


def _page_from(file_from_page: Callable[[float, float], Point]) -> list[list[float]]:
    """Back from an affine map given by what it does."""
    o, x, y = (np.array(file_from_page(*p)) for p in ((0, 0), (1, 0), (0, 1)))
    affine = np.array([[*(x - o)[:1], (y - o)[0], o[0]], [(x - o)[1], (y - o)[1], o[1]], [0, 0, 1]])
    return np.linalg.inv(affine).tolist()


def write_by_archit_app(flat: Flat, base: Path, rng: random.Random) -> list[Path]:
    """All formats of archit-app, each beside its way back to metres (FILE.json)."""
    walls = [Wall.straight(*bar.start, *bar.end, thickness=bar.thickness) for bar in flat.bars]
    for hole in flat.holes:
        kind = OpeningKind.DOOR if hole.is_door else OpeningKind.WINDOW
        share = hole.at / flat.bars[hole.bar].length
        wall = walls[hole.bar]
        opening = Opening.on_wall(wall, kind=kind, position_along_wall=share, width=hole.width)
        walls[hole.bar] = wall.add_opening(opening)
    level = Level(index=0, elevation=0.0, floor_height=3.0, name="Ground Floor")
    for x0, y0, x1, y1 in flat.rooms:
        area = Polygon2D.rectangle(x0, y0, x1 - x0, y1 - y0, crs=WORLD)
        level = level.add_room(Room(boundary=area, name="Office", program="living"))
        piece = getattr(Furniture, rng.choice(FURNITURE))(
            rng.uniform(x0 + 0.3, x1 - 1.2), rng.uniform(y0 + 0.3, y1 - 1.2)
        )
        corner = piece.bounding_box().max_corner
        if corner.x < x1 - 0.2 and corner.y < y1 - 0.2:
            level = level.add_furniture(piece)
    for wall in walls:
        level = level.add_wall(wall)
    if rng.random() < 0.6:
        level = level.add_dimension(DimensionLine.horizontal(x1=0, x2=flat.size[0], y=-0.9))
    px, box = rng.choice([30, 50, 80]), level.bounding_box
    assert box is not None
    page = A3_POINTS if box.width > box.height else A3_POINTS[::-1]
    archit_svg.save_level_svg(level, f"{base}.svg", pixels_per_meter=px)
    archit_image.save_level_png(level, f"{base}.png", pixels_per_meter=px)
    archit_pdf.save_level_pdf(level, f"{base}.pdf")
    save_level_dxf(level, f"{base}.dxf")
    save_level_geojson(level, f"{base}.geojson")
    save_building_ifc(Building().add_level(level), f"{base}.ifc")
    ways: dict[str, Callable[[float, float], Point]] = {
        "svg": _shown_by_svg(Path(f"{base}.svg"), flat.bars[0].thickness / 2, px),
        "png": archit_image._VT(box, px, archit_image._MARGIN),
        "pdf": archit_pdf._VT(box, *page, archit_pdf._MARGIN_PT),
        **dict.fromkeys(("dxf", "geojson", "ifc"), lambda x, y: (x, y)),
    }
    return [_with_way(base.with_name(f"{base.name}.{kind}"), way) for kind, way in ways.items()]


def _shown_by_svg(path: Path, half_m: float, px: float) -> Callable[[float, float], Point]:
    """Margins depend on what else is on the sheet: the first corner of the first wall, at (0, half_m), tells
    where the plan is."""
    first = re.search(r'<g id="walls">\s*<path d="M ([\d.]+) ([\d.]+)', path.read_text())
    assert first is not None
    u, v = float(first[1]), float(first[2]) + half_m * px
    return lambda x, y: (u + px * x, v - px * y)


def write_by_renovation(flat: Flat, base: Path, rng: random.Random) -> list[Path]:
    """PDF and PNG of renovation, which draws walls, windows and doors one by one."""
    kinds, grid = create_elements_registry(), (1, 0.2) if rng.random() < 0.5 else (None, None)
    size, scale = np.array(flat.size), rng.choice([50, 100])
    plan = FloorPlan((-2, -2), tuple(size + 2), 1, scale, *grid)
    plan.add_title("plan", 14)
    for k, bar in enumerate(flat.bars):
        angle = math.degrees(math.atan2(bar.along[1], bar.along[0]))
        # Outer walls meet at their corners, beyond the ends of their axes.
        at = -bar.thickness / 2 if k < 4 else 0.0
        end = bar.length - at
        side = np.array(bar.start) - np.array([-bar.along[1], bar.along[0]]) * bar.thickness / 2
        own = sorted((h for h in flat.holes if h.bar == k), key=lambda h: h.at)
        for hole in [*own, None]:
            stop = end if hole is None else hole.at - hole.width / 2
            common = {"orientation_angle": angle}
            plan.add_element(kinds["wall"], {**common, "pivot_point": tuple(side + at * bar.along),
                             "thickness": bar.thickness, "length": stop - at})  # fmt: skip
            if hole is None:
                break
            common["pivot_point"] = tuple(side + stop * bar.along)
            if hole.is_door:
                plan.add_element(kinds["door"], {**common, "thickness": 0.05,
                                 "doorway_width": hole.width, "door_width": hole.width - 0.06,
                                 "to_the_right": rng.random() < 0.5})  # fmt: skip
            else:
                plan.add_element(kinds["window"], {**common, "overall_thickness": bar.thickness,
                                 "single_line_thickness": 0.03, "length": hole.width})  # fmt: skip
            at = stop + hole.width
    dpi, figure = rng.choice([100, 200]), plan.fig
    figure.canvas.draw()
    shown = plan.ax.transData.transform
    points, height = POINTS_PER_INCH / figure.dpi, figure.bbox.height
    pdf, png = (base.with_name(f"{base.name}.{kind}") for kind in ("pdf", "png"))
    for path in (pdf, png):
        figure.savefig(path, dpi=dpi)
    ways = [
        _with_way(pdf, lambda x, y: tuple(shown((x, y)) * points)),
        _with_way(png, lambda x, y: tuple((shown((x, y)) * (1, -1) + (0, height)) * dpi / figure.dpi)),
    ]  # fmt: skip
    plt.close(figure)
    return ways


def _with_way(path: Path, file_from_page: Callable[[float, float], Point]) -> Path:
    path.with_suffix(path.suffix + ".json").write_text(json.dumps(_page_from(file_from_page)))
    return path


def main(folder: Path, seeds: range, only: str) -> None:
    """Print a line for each file and a summary for each program and format."""
    folder.mkdir(parents=True, exist_ok=True)
    found: dict[str, list[Score]] = {}
    for seed in seeds:
        rng = random.Random(seed)
        flat = make_flat(rng)
        for program, write in (
            ("archit", write_by_archit_app),
            ("renovation", write_by_renovation),
        ):
            for path in write(flat, folder / f"{program}_{seed}", rng):
                if only in path.suffix:
                    one = score(path, flat.page())
                    found.setdefault(f"{program} {path.suffix[1:]}", []).append(one)
                    state = "right" if one.is_right else "SILENT" if one.is_silent else "wrong"
                    print(f"{one.name:24} recall {one.recall:.3f} precision {one.precision:.3f} {state:6} "
                          f"{'; '.join(words[:60] for words in one.doubts)}", flush=True)  # fmt: skip
    for name, scores in found.items():
        shares = np.array([(one.recall, one.precision) for one in scores])
        least, middle = shares.min(axis=1).min(), np.median(shares, axis=0)
        print(
            f"{name:16} {summary(scores)}; median {middle[0]:.3f} {middle[1]:.3f}, least {least:.2f}"
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder for the drawings")
    parser.add_argument("--first", type=int, default=0, help="seed of the first flat")
    parser.add_argument("--flats", type=int, default=24)
    parser.add_argument("--only", default="", help="formats that contain this")
    arguments = parser.parse_args()
    main(
        arguments.output, range(arguments.first, arguments.first + arguments.flats), arguments.only
    )
