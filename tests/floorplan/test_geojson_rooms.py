"""Rooms of GeoJSON: kinds in any language, storeys told by any property or by the ground they share."""

import json
from pathlib import Path

import numpy as np
import pytest
import shapely

from planfit.errors import FloorplanError
from planfit.floorplan import PlanOptions, read_floorplan

DEGREES_PER_M = 1 / 111_320
LOW = [shapely.box(0, 0, 5, 4), shapely.box(5, 0, 11, 4), shapely.box(0, 4, 11, 9)]
HIGH = [shapely.box(0, 0, 7, 4), shapely.box(7, 0, 11, 4), shapely.box(0, 4, 8, 9)]


def written(path: Path, rooms: list[tuple[shapely.Polygon, dict]]) -> Path:
    """Near the equator, where a degree is as long in both directions."""
    features = [
        {"type": "Feature", "properties": properties, "geometry": shapely.geometry.mapping(
            shapely.transform(area, lambda xy: xy * DEGREES_PER_M + (8.0, 0.0)))}
        for area, properties in rooms
    ]  # fmt: skip
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def perimeter(rooms: list[shapely.Polygon]) -> float:
    return sum(room.length for room in rooms)


@pytest.mark.parametrize(
    "kinds", [("Büro", "Korridor", "WC"), ("chambre", "séjour", "cuisine"), ("", "", "")]
)
def test_polygons_are_rooms_whatever_their_kind_is_called(
    tmp_path: Path, kinds: tuple[str, ...]
) -> None:
    rooms = [(room, {"type": kind}) for room, kind in zip(LOW, kinds, strict=True)]
    plan = read_floorplan(written(tmp_path / "a.geojson", rooms))
    assert plan.lengths.sum() == pytest.approx(perimeter(LOW), rel=0.01)
    assert plan.source.storeys == ()


@pytest.mark.parametrize(
    "key",
    [
        "level",
        "level_id",
        "floor",
        "floorId",
        "floor_id",
        "storey",
        "story",
        "etage",
        "Geschoss",
        "z",
        "q7",
    ],
)
@pytest.mark.parametrize("values", [(1, 0), ("1", "0"), (3.5, -1.0)])
def test_storeys_told_by_any_property(tmp_path: Path, key: str, values: tuple) -> None:
    """The upper one stands first in the file."""
    rooms = [(room, {"type": "room", key: values[0], "nr": k}) for k, room in enumerate(HIGH)]
    rooms += [(room, {"type": "room", key: values[1], "nr": 9 + k}) for k, room in enumerate(LOW)]
    path = written(tmp_path / "a.geojson", rooms)
    plan = read_floorplan(path)
    names = [f"{float(value):g}" for value in sorted(values)]
    assert [name.split(": ")[-1] for name in plan.source.storeys] == names
    assert plan.lengths.sum() == pytest.approx(perimeter(LOW), rel=0.01)
    upper = read_floorplan(path, PlanOptions(storey=plan.source.storeys[1]))
    assert upper.lengths.sum() == pytest.approx(perimeter(HIGH), rel=0.01)


def test_storeys_by_their_height_where_their_names_have_no_order(tmp_path: Path) -> None:
    rooms = [(room, {"type": "Zimmer", "floorId": "a-obergeschoss", "h": 3.2}) for room in HIGH]
    rooms += [(room, {"type": "Zimmer", "floorId": "b-erdgeschoss", "h": 0}) for room in LOW]
    plan = read_floorplan(written(tmp_path / "a.geojson", rooms))
    assert plan.source.storeys == ("b-erdgeschoss", "a-obergeschoss")


def test_storeys_that_nothing_tells_are_taken_from_the_order_of_the_file(tmp_path: Path) -> None:
    plan = read_floorplan(
        written(tmp_path / "a.geojson", [(room, {"type": "room"}) for room in LOW + HIGH])
    )
    assert len(plan.source.storeys) == 2
    assert plan.lengths.sum() == pytest.approx(perimeter(LOW), rel=0.01)
    assert any("no property tells their storeys" in words for words in plan.source.warnings)


def test_outlines_and_furniture_are_no_rooms(tmp_path: Path) -> None:
    rooms = [(room, {"type": "Zimmer"}) for room in LOW]
    others = [(shapely.box(0, 0, 11, 9), {"type": "Geschossfläche"}),
              (shapely.box(1, 1, 3, 2), {"type": "Tisch"})]  # fmt: skip
    plan = read_floorplan(written(tmp_path / "a.geojson", [*others, *rooms]))
    assert plan.lengths.sum() == pytest.approx(perimeter(LOW), rel=0.01)


def test_chosen_kinds_are_rooms_where_they_are_wide_and_walls_where_they_are_thin(
    tmp_path: Path,
) -> None:
    rooms = [
        (room, {"type": kind}) for room, kind in zip(LOW, ("Lager", "WC", "Gang"), strict=True)
    ]
    rooms.append((shapely.box(-0.3, -0.3, 11.3, 0.0), {"type": "Mauerwerksteil"}))
    path = written(tmp_path / "a.geojson", rooms)
    plan = read_floorplan(path, PlanOptions(layers=("Lager", "w*")))
    assert plan.lengths.sum() == pytest.approx(perimeter(LOW[:2]), rel=0.01)
    assert plan.thickness is None or np.isnan(plan.thickness).all()
    wall = read_floorplan(path, PlanOptions(layers=("Mauerwerksteil",)))
    assert wall.thickness is not None
    np.testing.assert_allclose(np.nanmin(wall.thickness), 0.3, rtol=0.02)
    with pytest.raises(FloorplanError, match="Lager"):
        read_floorplan(path, PlanOptions(layers=("none",)))


@pytest.mark.parametrize(
    ("shaft", "levels"),
    [
        ("0;1", "0 1"),
        ("-1-1", "-1 0 1"),
        ("0; 2", "0 1 2"),
        ("a-b", "0 1 a-b"),
        ("-300-300", "-300-300 0 1"),  # no building, but much memory where all features say so
    ],
)
def test_levels_of_openstreetmap_are_lists_and_ranges(
    tmp_path: Path, shaft: str, levels: str
) -> None:
    rooms = [(room, {"indoor": "room", "level": "0"}) for room in LOW]
    rooms += [(room, {"indoor": "room", "level": "1"}) for room in HIGH]
    rooms.append((shapely.box(20, 0, 22, 2), {"indoor": "room", "level": shaft}))
    path = written(tmp_path / "a.geojson", rooms)
    for number, own in (("0", LOW), ("1", HIGH)):
        plan = read_floorplan(path, PlanOptions(storey=number))
        assert plan.source.storeys == tuple(levels.split())
        is_here = number in {"0;1": "01", "-1-1": "01", "0; 2": "0"}.get(shaft, "")
        assert plan.lengths.sum() == pytest.approx(perimeter(own) + 8 * is_here, rel=0.01)


@pytest.mark.parametrize("is_line", [True, False])
def test_a_wall_beside_rooms_does_not_stand_for_them(tmp_path: Path, is_line: bool) -> None:
    """It used to be all that was read, without a word."""
    wall = shapely.LineString([(2, 5), (2, 8)])
    rooms = [(room, {"indoor": "room"}) for room in LOW]
    rooms.append((wall if is_line else wall.buffer(0.1), {"indoor": "wall"}))
    plan = read_floorplan(written(tmp_path / "a.geojson", rooms))
    assert plan.lengths.sum() == pytest.approx(perimeter(LOW), rel=0.01)
    assert any("what is named wall is left out" in words for words in plan.source.warnings)
    # Walls around all rooms bound the plan as before.
    around = [(shapely.boundary(room).buffer(0.1), {"indoor": "wall"}) for room in LOW]
    plan = read_floorplan(written(tmp_path / "b.geojson", rooms[:3] + around))
    assert plan.source.layers == ("wall",)
