"""Where points of a plan's, a file's, a map's axes lie on the plan, to the micrometre, and which cannot."""

import os
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from builders import room_plan
from planfit.errors import OptionError
from planfit.floorplan import read_floorplan
from planfit.floorplan.formats.georeference import MapConversion
from planfit.survey import Survey, SurveyPoint, place_points

SHARED = Path(os.environ.get("PLANFIT_SHARED", Path(__file__).parents[3] / "shared" / "data"))
CORNERS = np.array([[0.5, 0.5, 1.0], [5.5, 0.5, 1.2], [5.5, 3.5, 0.3], [0.5, 3.5, 2.0]])


def survey_at(xyz, axes="plan"):
    points = tuple(SurveyPoint(f"P{k}", np.asarray(p, dtype=float)) for k, p in enumerate(xyz))
    return Survey(points, axes=axes)


def plan_in(file_from_plan, map_from_file=None):
    plan = room_plan()
    source = replace(plan.source, file_from_plan=file_from_plan, map_from_file=map_from_file)
    return replace(plan, source=source)


def affine(scale, yaw, x, y):
    c, s = scale * np.cos(yaw), scale * np.sin(yaw)
    return np.array([[c, -s, x], [s, c, y], [0, 0, 1.0]])


def test_the_plans_own_axes():
    placed = place_points(survey_at(CORNERS), room_plan())
    assert_allclose(placed.xyz, CORNERS)
    assert not placed.has_own_datum


def test_axes_of_the_file_and_of_the_map_lose_nothing():
    """A drawing in millimetres, turned and far off; a map on which it is turned again."""
    file_from_plan = affine(1000.0, 0.3, 5.1e9, -4.9e9)
    map_from_file = affine(0.001, -1.1, 2_612_345.678, 1_223_456.789)
    plan = plan_in(file_from_plan, map_from_file)
    in_file = CORNERS[:, :2] @ file_from_plan[:2, :2].T + file_from_plan[:2, 2]
    on_map = in_file @ map_from_file[:2, :2].T + map_from_file[:2, 2]
    for axes, xy in (("file", in_file), ("map", on_map)):
        placed = place_points(survey_at(np.column_stack([xy, CORNERS[:, 2] + 400]), axes), plan)
        # 5.1e9 mm have digits of 1e-6 mm; the map's of the drawing's size again, 5e6 m, 1e-9 m.
        assert_allclose(placed.xyz[:, :2], CORNERS[:, :2], atol=2e-8)
        assert_allclose(placed.xyz[:, 2], CORNERS[:, 2] + 400)
        assert placed.has_own_datum


def test_a_world_file_is_honoured(tmp_path: Path):
    image = np.full((400, 700, 3), 255, np.uint8)
    image[50:350, 50:650] = 0
    image[70:330, 70:630] = 255
    cv2.imwrite(str(tmp_path / "room.png"), image)
    # 2 cm a pixel, north up, the middle of the first pixel far away.
    (tmp_path / "room.pgw").write_text("0.02\n0\n0\n-0.02\n2612345.01\n1223456.99\n")
    plan = read_floorplan(tmp_path / "room.png")
    pixel = np.array([[100.0, 120.0], [600.0, 300.0]])
    on_map = np.array([2612345.01, 1223456.99]) + pixel * (0.02, -0.02)
    by_map = place_points(survey_at(np.column_stack([on_map, [3.0, 4.0]]), "map"), plan)
    by_pixel = place_points(survey_at(np.column_stack([pixel, [3.0, 4.0]]), "plan"), plan)
    assert_allclose(by_map.xyz, by_pixel.xyz, atol=1e-8)
    corner = plan.ends.reshape(-1, 2).min(axis=0)
    assert (np.abs(by_map.xyz[:, :2] - corner) < 20).all()


@pytest.mark.shared
@pytest.mark.skipif(
    not SHARED.is_dir(), reason="no real models: set PLANFIT_SHARED to their folder"
)
def test_the_map_conversion_of_a_real_model_is_honoured():
    """Its origin is at (76670, 77179) in EPSG:9897, its x turned by 71 degrees."""
    pytest.importorskip("ifcopenshell")
    path = SHARED / "real_files" / "ifc_georef" / "Duplex_A_20110907_georeferenced.ifczip"
    plan = read_floorplan(path)
    corners = plan.ends.reshape(-1, 2)
    c, s = np.cos(np.deg2rad(71.0)), np.sin(np.deg2rad(71.0))
    on_map = corners @ np.array([[c, s], [-s, c]]) + np.array([76670.0, 77179.0])
    survey = survey_at(np.column_stack([on_map, np.full(len(corners), 12.0)]), "map")
    assert_allclose(place_points(survey, plan).xyz[:, :2], corners, atol=0.02)


@pytest.mark.parametrize(
    ("scale", "unit_scale", "metres"),
    [
        (1.0, 1.0, 1.0),
        (0.001, 0.001, 0.001),
        (1.0, 0.001, 0.001),
        (0.9996, 1.0, 0.9996),
        (0.3, 1.0, None),
    ],
)
def test_scales_of_a_map_conversion(scale, unit_scale, metres):
    found = MapConversion(2e6, 1e6, np.deg2rad(90.0), scale, unit_scale, "").map_from_file
    if metres is None:
        assert found is None
    else:
        assert_allclose(found @ [1.0, 0.0, 1.0], [2e6, 1e6 + metres, 1.0])


def test_a_site_without_a_plan_is_moved_to_an_origin_of_whole_metres():
    far = CORNERS + np.array([5e6, 4e6, 300.0])
    placed = place_points(survey_at(far, "site"), None)
    assert_allclose(placed.xyz + placed.origin, far, rtol=0, atol=1e-9)
    assert (placed.origin == np.floor(placed.origin)).all()
    assert np.abs(placed.xyz).max() < 10


@pytest.mark.parametrize(
    ("axes", "spoil", "words"),
    [
        ("plan", lambda p: p * 1000, "they lie on it as millimetres: multiply them by 0.001"),
        (
            "plan",
            lambda p: p * np.array([1 / 0.3048, 1 / 0.3048, 1]),
            "as feet: multiply them by 0.3048",
        ),
        ("plan", lambda p: p + np.array([1e6, 2e6, 0]), "give --survey-axes file"),
        ("file", lambda p: p, "give --survey-axes plan"),
        ("file", lambda p: p[:, [1, 0, 2]] + np.array([2e6, 1e6, 0]), "with x and y swapped"),
        (
            "plan",
            lambda p: p + np.array([300, 0, 0]),
            "check their axes, unit and order of columns",
        ),
        ("map", lambda p: p, "expected a plan with a map conversion"),
        ("plan", lambda p: p + np.array([0, 0, 431.5]), "expected heights above the floor (m)"),
    ],
)
def test_points_that_lie_elsewhere_are_told_where_they_would_fit(axes, spoil, words):
    plan = plan_in(affine(1.0, 0.0, 1e6, 2e6))
    with pytest.raises(OptionError) as found:
        place_points(survey_at(spoil(CORNERS), axes), plan)
    assert words in str(found.value)
