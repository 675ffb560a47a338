"""Lines that close the body of a wall are wall, however thick it is there; furniture along it is not."""

from pathlib import Path

import ezdxf
import numpy as np
import pytest
import shapely

from planfit.floorplan import nearest_faces, read_floorplan
from planfit.geometry import segments

CORNER = shapely.box(0.0, 6.0, 1.5, 8.0)
TABLE = shapely.box(3.0, 0.3, 4.2, 1.4)


def sides(area: shapely.Polygon) -> list[np.ndarray]:
    return [
        np.stack([ring[:-1], ring[1:]], axis=1)
        for ring in map(shapely.get_coordinates, [area.exterior, *area.interiors])
    ]


@pytest.mark.parametrize("turn_deg", [0.0, 17.0])
def test_a_solid_corner_is_wall(tmp_path: Path, turn_deg: float) -> None:
    """Two lines 0.3 m apart all round, and a corner of 1.5 x 2 m, drawn line by line on one layer."""
    room = shapely.box(0.3, 0.3, 9.7, 7.7).difference(CORNER)
    walls = np.concatenate(sides(shapely.box(0, 0, 10, 8).difference(room)))
    turn = np.deg2rad(turn_deg)
    rotation = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    document = ezdxf.new()
    document.header["$INSUNITS"] = 6
    for a, b in np.concatenate([walls, *sides(TABLE)]) @ rotation:
        # Corners meet up to the last digit that a program writes.
        document.modelspace().add_line(np.round(a, 4), np.round(b, 4))
    document.saveas(tmp_path / "plan.dxf")
    plan = read_floorplan(tmp_path / "plan.dxf")
    points, _ = segments.sample(np.ascontiguousarray(walls @ rotation), 0.05)
    assert (nearest_faces.nearest_distance(points, plan.ends) < 0.01).all()
    free = shapely.points((plan.ends.mean(axis=1) + 0.01 * plan.normals) @ rotation.T)
    body = shapely.box(0, 0, 10, 8).difference(room)
    assert not shapely.contains(body, free).any()
    found, _ = segments.sample(plan.ends @ rotation.T, 0.05)
    assert shapely.distance(body, shapely.points(found)).max() < 0.01
