"""Drawings of programs that keep walls as bodies: openings drawn over them, scale bars, features by kind."""

import json
from pathlib import Path

import numpy as np
import pytest
import shapely
from ezdxf.filemanagement import new as new_dxf

from planfit.floorplan import Floorplan, nearest_faces, read_floorplan
from planfit.geometry import segments

PICTURE = Path(__file__).with_name("flat_by_renovation.png")
SIZE_M = np.array([12.0, 8.0])
BARS = [  # walls: corners
    (0.0, 0.0, 12.0, 0.3), (0.0, 7.7, 12.0, 8.0), (0.0, 0.0, 0.3, 8.0), (11.7, 0.0, 12.0, 8.0),
    (4.0, 0.0, 4.1, 8.0), (4.0, 4.0, 12.0, 4.1), (8.0, 4.1, 8.1, 8.0),
]  # fmt: skip
HOLES = [  # doors and windows, from face to face
    (1.0, 0.0, 1.9, 0.3), (6.0, 0.0, 8.0, 0.3), (2.0, 7.7, 3.0, 8.0), (4.0, 2.0, 4.1, 2.9),
    (5.0, 4.0, 5.9, 4.1), (8.0, 6.0, 8.1, 6.9), (11.7, 1.0, 12.0, 3.5),
]  # fmt: skip


def truth() -> np.ndarray:
    """Faces (n, 2, 2) of the walls with their openings."""
    solid = shapely.union_all(shapely.box(*np.array(BARS).T))
    solid = solid.difference(shapely.union_all(shapely.box(*np.array(HOLES).T)))
    rings = shapely.get_rings(shapely.get_parts(solid))
    corners = [shapely.get_coordinates(ring) for ring in rings]
    return np.concatenate([np.stack([c[:-1], c[1:]], axis=1) for c in corners])


def shares(plan: Floorplan, metres: float = 1.0, near_m: float = 0.03) -> tuple[float, float]:
    """Recall and precision of a plan's faces, both laid with their lower left corner at the origin."""
    found = plan.ends * metres
    found = found - found.reshape(-1, 2).min(axis=0)
    known = truth()
    of_known, _ = segments.sample(known, 0.02)
    of_found, _ = segments.sample(found, 0.02)
    missed = nearest_faces.nearest_distance(of_known, found)
    wrong = nearest_faces.nearest_distance(of_found, known)
    return float((missed < near_m).mean()), float((wrong < near_m).mean())


def corners(box) -> list[tuple[float, float]]:
    """Of a box (x0, y0, x1, y1)."""
    x0, y0, x1, y1 = box
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]


def as_dxf(path: Path, layer: str = "FP_OPENINGS", is_filled: bool = True) -> Path:
    """Walls as filled outlines, openings as outlines over them, in metres."""
    document = new_dxf(units=6)
    space = document.modelspace()
    for box in BARS:
        space.add_lwpolyline(corners(box), close=True, dxfattribs={"layer": "FP_WALLS"})
        if is_filled:
            hatch = space.add_hatch(dxfattribs={"layer": "FP_WALLS"})
            hatch.paths.add_polyline_path(corners(box), is_closed=True)
    for box in HOLES:
        space.add_lwpolyline(corners(box), close=True, dxfattribs={"layer": layer})
    document.saveas(path)
    return path


def svg_rect(box, fill: str, px: float = 50.0) -> str:
    """A rectangle of the plan at so many pixels a metre."""
    x0, y0, x1, y1 = np.array(box) * px
    return (
        f'<rect x="{x0 + 40}" y="{SIZE_M[1] * px + 40 - y1}" width="{x1 - x0}" height="{y1 - y0}" '
        f'fill="{fill}"/>'
    )


def as_svg(path: Path, extra: str = "", px: float = 50.0) -> Path:
    """Walls as dark areas, openings as pale ones over them."""
    walls = "".join(svg_rect(box, "#4A4A4A", px) for box in BARS)
    holes = "".join(svg_rect(box, "#AED6F1", px) for box in HOLES)
    path.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{12 * px + 80}" height="{8 * px + 200}">'
        f'<g id="walls">{walls}</g><g id="openings">{holes}</g>{extra}</svg>'
    )
    return path


def scale_bar(numbers: list[str], step_px: float, unit: str = "m", y: float = 500.0) -> str:
    """Boxes, dark and white, a number at each mark, and the unit beside them."""
    rects = "".join(
        f'<rect x="{60 + k * step_px}" y="{y}" width="{step_px}" height="6" stroke="#111" '
        f'fill="{"#111" if k % 2 == 0 else "#fff"}"/>'
        for k in range(len(numbers) - 1)
    )
    texts = "".join(
        f'<text x="{60 + k * step_px}" y="{y + 16}" text-anchor="middle" font-size="8">{number}</text>'
        for k, number in enumerate(numbers)
    )
    end = 60 + (len(numbers) - 1) * step_px
    beside = f'<text x="{end + 12}" y="{y + 5}" font-size="8">{unit}</text>' if unit else ""
    return f"<g>{rects}{texts}{beside}</g>"


@pytest.mark.parametrize("is_filled", [True, False])
def test_openings_drawn_over_walls_are_cut_out(tmp_path, is_filled):
    plan = read_floorplan(as_dxf(tmp_path / "flat.dxf", is_filled=is_filled))
    recall, precision = shares(plan)
    assert recall > 0.99
    assert precision > 0.99
    assert not plan.source.warnings
    assert plan.openings is not None
    assert len(plan.openings) == 2 * len(HOLES)


def test_outlines_of_other_layers_do_not_cut_walls(tmp_path):
    plan = read_floorplan(as_dxf(tmp_path / "flat.dxf", layer="NOTES"))
    body = shapely.union_all(shapely.box(*np.array(BARS).T))
    total = sum(ring.length for ring in shapely.get_rings(body))
    assert segments.lengths(plan.ends).sum() == pytest.approx(total, rel=0.02)


def test_areas_of_openings_are_cut_out_of_walls_in_svg(tmp_path):
    recall, precision = shares(read_floorplan(as_svg(tmp_path / "flat.svg")), 1 / 50)
    assert recall > 0.99
    assert precision > 0.99


@pytest.mark.parametrize(
    ("numbers", "unit", "metres_per_step"),
    [
        (["0", "1", "2", "3"], "m", 1.0),
        (["0", "1", "2"], "Meter", 1.0),
        (["0", "2", "4", "6"], "ft", 0.6096),
        (["0", "1,5", "3 m"], "", 1.5),
    ],
)
def test_a_scale_bar_tells_the_unit_and_is_no_wall(tmp_path, numbers, unit, metres_per_step):
    bar = scale_bar(numbers, 50.0 * metres_per_step, unit)
    plan = read_floorplan(as_svg(tmp_path / "flat.svg", bar))
    assert plan.is_metric
    np.testing.assert_allclose(np.ptp(plan.ends.reshape(-1, 2), axis=0), SIZE_M, rtol=2e-3)
    assert min(shares(plan)) > 0.99


@pytest.mark.parametrize(
    "bar",
    [
        scale_bar(["1", "2", "3", "4"], 50.0),  # numbers of rooms
        scale_bar(["0", "1", "5", "6"], 50.0),  # not even
        scale_bar(["0", "1", "2", "3"], 50.0) + scale_bar(["0", "2", "4", "6"], 50.0, y=540.0),
        "".join(f'<text x="{60 + 50 * k}" y="500" font-size="8">{k}</text>' for k in range(4))
        + '<text x="240" y="500" font-size="8">m</text>',  # nothing drawn beside them
    ],
)
def test_other_rows_of_numbers_tell_no_unit(tmp_path, bar):
    assert not read_floorplan(as_svg(tmp_path / "flat.svg", bar)).is_metric


def feature(box, element_type: str, **more) -> dict:
    """A GeoJSON feature whose kind is told as some programs do."""
    ring = [*corners(box), corners(box)[0]]
    return {
        "type": "Feature",
        "geometry": {"type": "Polygon", "coordinates": [ring]},
        "properties": {"element_type": element_type, "layer": "default", "level_index": 0, **more},
    }


def test_geojson_kinds_are_found_by_their_values(tmp_path):
    rooms = [(0.15, 0.15, 4.05, 7.85), (4.05, 0.15, 11.85, 4.05), (4.05, 4.05, 8.05, 7.85)]
    features = [feature(box, "room", name="Office") for box in rooms]
    features += [feature(box, "wall", material="concrete") for box in BARS]
    features += [feature(box, "opening", kind="door") for box in HOLES]
    path = tmp_path / "flat.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    plan = read_floorplan(path)
    assert not plan.source.storeys
    body = shapely.union_all(shapely.box(*np.array(BARS).T))
    total = sum(ring.length for ring in shapely.get_rings(body))
    assert segments.lengths(plan.ends).sum() == pytest.approx(total, rel=0.02)


def test_walls_that_cross_are_no_second_storey(tmp_path):
    """A wall of 0.3 m across a short one shares a tenth of it."""
    features = [feature(box, "wall") for box in BARS]
    features += [feature((0.0, 3.9, 1.0, 4.1), "wall"), feature((0.15, 0.15, 4.05, 7.85), "room")]
    path = tmp_path / "flat.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    assert not read_floorplan(path).source.storeys


def test_partitions_stay_where_hardly_anything_else_is_drawn():
    """A flat drawn by renovation 0.2.0: partitions of 3 pixels are its usual line."""
    told = json.loads(PICTURE.with_suffix(".json").read_text())
    faces, metres_from_px = np.array(told["faces"]), np.array(told["metres_from_px"])
    plan = read_floorplan(PICTURE)
    found = plan.ends * (1.0, -1.0) @ metres_from_px[:2, :2].T + metres_from_px[:2, 2]
    points, _ = segments.sample(faces, 0.05)
    # Windows are faces in that truth, and openings in the plan.
    assert (nearest_faces.nearest_distance(points, found) < 0.06).mean() > 0.8
