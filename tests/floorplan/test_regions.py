import numpy as np
import pytest
import shapely

from planfit.floorplan.vector.regions import faces_of_regions


def room(thickness: float) -> shapely.Geometry:
    return shapely.box(0, 0, 6, 4).difference(
        shapely.box(thickness, thickness, 6 - thickness, 4 - thickness)
    )


@pytest.mark.parametrize("thickness", [0.1, 0.24, 0.5])
def test_a_room_has_four_faces_outside_and_four_inside(thickness: float) -> None:
    faces = faces_of_regions(room(thickness), 0.01, 0.3)
    middle = np.array([3.0, 2.0])
    inwards = np.sum((middle - faces.ends.mean(axis=1)) * faces.normals, axis=1) > 0
    assert len(faces.ends) == 8
    assert inwards.sum() == 4
    np.testing.assert_allclose(faces.thickness, thickness, atol=1e-6)
    lengths = np.linalg.norm(faces.ends[:, 1] - faces.ends[:, 0], axis=1)
    expected = [4, 4, 6, 6, 4 - 2 * thickness, 4 - 2 * thickness, 6 - 2 * thickness]
    np.testing.assert_allclose(np.sort(lengths), np.sort([*expected, 6 - 2 * thickness]))


def test_normals_leave_the_wall() -> None:
    faces = faces_of_regions(room(0.3), 0.01, 0.3)
    outside = shapely.points(faces.ends.mean(axis=1) + 0.05 * faces.normals)
    inside = shapely.points(faces.ends.mean(axis=1) - 0.05 * faces.normals)
    assert not shapely.contains(room(0.3), outside).any()
    assert shapely.contains(room(0.3), inside).all()


def test_overlapping_pieces_are_one_wall() -> None:
    pieces = shapely.GeometryCollection([shapely.box(0, 0, 6, 0.2), shapely.box(4, 0, 10, 0.2)])
    faces = faces_of_regions(pieces, 0.01, 0.5)
    assert len(faces.ends) == 2


def test_a_wall_beyond_the_room_does_not_thicken_the_first() -> None:
    walls = shapely.GeometryCollection([shapely.box(0, 0, 6, 0.2), shapely.box(0, 3, 6, 3.5)])
    faces = faces_of_regions(walls, 0.01, 1.0)
    np.testing.assert_allclose(np.sort(faces.thickness), [0.2, 0.2, 0.5, 0.5], atol=1e-6)


def test_short_faces_are_left_out() -> None:
    assert len(faces_of_regions(shapely.box(0, 0, 6, 0.2), 0.01, 0.3).ends) == 2
    assert len(faces_of_regions(shapely.box(0, 0, 6, 0.2), 0.01, 0.1).ends) == 4
    assert len(faces_of_regions(shapely.box(0, 0, 0.1, 0.1), 0.01, 0.3).ends) == 0


def test_nothing_gives_nothing() -> None:
    assert len(faces_of_regions(shapely.GeometryCollection(), 0.01, 0.3).ends) == 0
