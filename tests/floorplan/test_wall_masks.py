"""Pictures of walls and nothing else: every thickness, slant and curve, at every size, margin and turn."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import shapely
from drawn_plans.drawing import STYLES, DrawingOptions, draw_building
from drawn_plans.site_masks import site
from numpy.testing import assert_allclose

from planfit.errors import FloorplanError
from planfit.floorplan import Floorplan, nearest_faces, read_floorplan
from planfit.floorplan.formats import picture as picture_files
from planfit.floorplan.options import PlanOptions
from planfit.floorplan.raster import plan_of_picture, shrink_for_reading
from planfit.floorplan.raster.stroke_widths import twin_share
from planfit.floorplan.raster.trace import trace_regions
from planfit.geometry import segments
from planfit.synth import BuildingOptions, make_building

MIRROR = np.array([1.0, -1.0])
STYLE = "nothing else drawn"


def read(image: np.ndarray) -> Floorplan:
    return plan_of_picture(image, "mask", "", PlanOptions(), "picture")


def recall_and_precision(
    plan: Floorplan, outline: np.ndarray, near_px: float
) -> tuple[float, float]:
    ends = np.ascontiguousarray(plan.ends * MIRROR)
    missed = nearest_faces.nearest_distance(outline, ends)
    points, _ = segments.sample(ends, 1.0)
    found = shapely.STRtree(shapely.points(outline)).query_nearest(
        shapely.points(points), return_distance=True, all_matches=False
    )[1]
    return float((missed < near_px).mean()), float((found < near_px).mean())


@pytest.mark.parametrize("px_per_m", [60.0, 25.0])
def test_walls_of_every_thickness_are_read(px_per_m: float) -> None:
    # By one thickness, half of it was left out: partitions, the slant, the curve; and storeys were invented.
    mask = site(px_per_m)
    plan = read(mask.image)
    assert STYLE in plan.source.kind
    recall, precision = recall_and_precision(plan, mask.outline, max(0.05 * px_per_m, 1.5))
    assert recall > 0.97
    assert precision > 0.97
    assert plan.source.storeys == ()


@pytest.mark.parametrize("angle_deg", [3.0, 33.0])
def test_a_turn_changes_nothing(angle_deg: float) -> None:
    mask = site(30.0, angle_deg)
    recall, precision = recall_and_precision(read(mask.image), mask.outline, 1.5)
    assert min(recall, precision) > 0.97


@pytest.mark.parametrize("margin_m", [0.1, 25.0])
def test_the_margin_changes_nothing(margin_m: float) -> None:
    usual, other = read(site(25.0).image), read(site(25.0, margin_m=margin_m).image)
    moved = np.ascontiguousarray(other.ends - (margin_m - 3.0) * 25.0 * MIRROR)
    for one, another in ((usual.ends, moved), (moved, np.ascontiguousarray(usual.ends))):
        points, _ = segments.sample(one, 1.0)
        assert nearest_faces.nearest_distance(points, another).max() < 3.0


def test_a_curve_is_a_chain_of_faces_within_its_tolerance() -> None:
    mask = site(60.0)
    middle = read(mask.image).ends.mean(axis=1) * MIRROR
    steps = np.ascontiguousarray(np.stack([mask.outline[:-1], mask.outline[1:]], axis=1))
    near = nearest_faces.nearest_distance(middle, steps)
    assert np.median(near) < 0.5
    assert near.max() < 2.0


def test_the_share_of_the_ink_is_said_and_what_is_left_out_has_a_length() -> None:
    rng = np.random.default_rng(3)
    drawing = draw_building(
        make_building(BuildingOptions(n_rooms=3), rng),
        DrawingOptions(pixels_per_metre=45, is_cluttered=True),
        rng,
    )
    plan = read(drawing.image)
    assert any(
        "% of the ink is read as wall" in words and " px" in words for words in plan.source.dropped
    )
    mask = read(site().image)
    assert mask.source.dropped[0].startswith(("99 %", "100 %", "no ink"))
    # The clutter that was left out is shown: most of its length is no wall.
    shown = plan.source.dropped_lines
    assert shown is not None
    length = segments.lengths(shown)
    middle = shown[length > 8].mean(axis=1)
    assert (nearest_faces.nearest_distance(middle, drawing.ends_uv) > 4).mean() > 0.5


@pytest.mark.parametrize("style", STYLES)
def test_lines_of_drawings_have_twins_and_walls_have_none(style: str) -> None:
    # Parameters were chosen at 55 px a metre; reported here at others.
    rng = np.random.default_rng(11)
    drawing = draw_building(
        make_building(BuildingOptions(n_rooms=5), rng),
        DrawingOptions(style=style, pixels_per_metre=80, line_px=2.1, tone=0.8),
        rng,
    )
    assert share_of(drawing.image) > 0.22
    assert share_of(site(30.0).image) < 0.12


def share_of(image: np.ndarray) -> float:
    ink = (image[..., 0] < 128).astype(np.uint8)
    return twin_share(ink, trace_regions(ink, 0.0))


def test_nothing_but_a_few_marks_has_no_share() -> None:
    assert share_of(np.full((100, 100, 3), 255, np.uint8)) == 1.0


def test_huge_pictures_are_read_shrunk_and_it_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mask = site(40.0)
    path = tmp_path / "plan.png"
    assert cv2.imwrite(str(path), mask.image)
    usual = read_floorplan(path)
    monkeypatch.setattr(picture_files, "shrink_for_reading", lambda *_size: 2)
    shrunk = read_floorplan(path)
    assert any("shrunk 2 times" in words for words in shrunk.source.warnings)
    assert not any("shrunk" in words for words in usual.source.warnings)
    recall, precision = recall_and_precision(shrunk, mask.outline, 3.0)
    assert min(recall, precision) > 0.97
    assert_allclose(shrunk.size, usual.size, atol=2.0)


@pytest.mark.parametrize(("size", "factor"), [
    ((7351, 4206), 1), ((13_110, 7_629), 2), ((30_000, 1_000), 2), ((14_043, 9_933), 2),
])  # fmt: skip
def test_how_often_huge_pictures_are_shrunk(size: tuple[int, int], factor: int) -> None:
    assert shrink_for_reading(*size) == factor


def test_circles_alone_are_no_walls() -> None:
    image = np.full((600, 800, 3), 255, np.uint8)
    for k in range(6):
        cv2.circle(image, (100 + 110 * k, 300), 40, (0, 0, 0), 14, cv2.LINE_AA)
    with pytest.raises(FloorplanError, match="is it a floorplan"):
        read(image)


@pytest.mark.parametrize("style", ["black", "grey"])
def test_tiny_drawings_are_enlarged(style: str) -> None:
    # Partitions of 3 px and lines of 1 px: a whole number of pixels parted them wrongly, or not at all.
    rng = np.random.default_rng(5)
    drawing = draw_building(
        make_building(BuildingOptions(n_rooms=5), rng),
        DrawingOptions(style=style, pixels_per_metre=90, line_px=2.0),
        rng,
    )
    size = 0.3
    small = cv2.resize(drawing.image, None, fx=size, fy=size, interpolation=cv2.INTER_AREA)
    assert max(small.shape) < 600
    plan = read(small)
    wall = drawing.ends_uv[drawing.is_wall]
    outline = segments.sample((wall + 0.5) * size - 0.5, 1.0)[0]
    recall, _ = recall_and_precision(plan, outline, 2.0)
    assert recall > 0.95
