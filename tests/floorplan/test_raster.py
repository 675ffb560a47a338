"""Walls out of pictures: styles, clutter, options, and pictures that are no plans."""

import functools
import os
import subprocess
import sys
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import shapely
from drawn_plans.drawing import STYLES, DrawingOptions, PlanPicture, draw_building
from numpy.testing import assert_allclose

from planfit.errors import FloorplanError
from planfit.floorplan import Floorplan, PlanOptions, nearest_faces, read_floorplan
from planfit.floorplan.gaps import find_openings
from planfit.floorplan.plans_on_sheet import find_storeys
from planfit.floorplan.raster.line_work import opened
from planfit.floorplan.raster.picture import (
    find_skew_deg,
    make_darkness,
    make_upright,
)
from planfit.floorplan.raster.sheet_marks import without_bars, without_frame
from planfit.floorplan.raster.trace import trace_regions
from planfit.geometry import segments
from planfit.synth import BuildingOptions, make_building

MIRROR = np.array([1.0, -1.0])


def drawn(seed: int = 3, n_rooms: int = 4, **options: object) -> PlanPicture:
    rng = np.random.default_rng(seed)
    building = make_building(BuildingOptions(n_rooms=n_rooms), rng)
    return draw_building(building, replace(DrawingOptions(pixels_per_metre=55), **options), rng)


@pytest.fixture(scope="module")
def plan_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Floorplan]:
    """What is read of `drawn(...)` as a PNG: each once, for several tests look at the same one."""
    path = tmp_path_factory.mktemp("drawn") / "plan.png"

    @functools.cache
    def read(*given: int, **options: object) -> Floorplan:
        return read_floorplan(saved(path, drawn(*given, **options).image))

    return read


def saved(path: Path, image: np.ndarray) -> Path:
    assert cv2.imwrite(str(path), image)
    return path


def share_near(ends, normals, to_ends, to_normals, near_px=3.0):
    """Share of the length of faces that is near a face that looks the same way."""
    n_near, n = 0, 0
    for one, normal in zip(ends, normals, strict=True):
        points, _ = segments.sample(one[None], 1.0)
        alike = np.ascontiguousarray(to_ends[to_normals @ normal > 0.9])
        distance = nearest_faces.nearest_distance(points, alike)
        n_near, n = n_near + int((distance < near_px).sum()), n + len(points)
    return n_near / n


def scores(plan, drawing):
    ends, normals, wall = plan.ends * MIRROR, plan.normals * MIRROR, drawing.is_wall
    return (
        share_near(ends, normals, drawing.ends_uv, drawing.normals_uv),
        share_near(drawing.ends_uv[wall], drawing.normals_uv[wall], ends, normals),
    )


@pytest.mark.parametrize("style", STYLES)
def test_each_style_is_read(plan_of: Callable[..., Floorplan], style: str) -> None:
    plan = plan_of(style=style)
    precision, recall = scores(plan, drawn(style=style))
    assert precision > 0.94
    assert recall > 0.94
    assert plan.is_oriented.all()
    assert not plan.is_metric


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tiff"])
def test_formats(tmp_path: Path, suffix: str) -> None:
    drawing = drawn(n_rooms=1)
    precision, recall = scores(
        read_floorplan(saved(tmp_path / f"plan{suffix}", drawing.image)), drawing
    )
    assert min(precision, recall) > 0.95


@pytest.mark.slow
@pytest.mark.parametrize("change", [
    {"skew_deg": 2.3}, {"skew_deg": -14.0}, {"noise": 6.0, "jpeg_quality": 60}, {"shade": 0.4},
    {"perspective": 0.02}, {"is_cluttered": True},
])  # fmt: skip
def test_black_walls_through_what_happens_to_pictures(tmp_path: Path, change: dict) -> None:
    drawing = drawn(**change)
    precision, recall = scores(read_floorplan(saved(tmp_path / "plan.png", drawing.image)), drawing)
    assert min(precision, recall) > 0.95


@pytest.mark.parametrize("style", ["double filled", "poche"])
def test_a_fill_tells_walls_from_the_lines_of_other_things(tmp_path: Path, style: str) -> None:
    # A pale fill was taken for paper, and tiles, windows and furniture for outlines of walls.
    drawing = drawn(style=style, is_cluttered=True, skew_deg=-2.7, noise=4.0, jpeg_quality=70)
    plan = read_floorplan(saved(tmp_path / "plan.png", drawing.image))
    assert "filled" in plan.source.kind
    precision, recall = scores(plan, drawing)
    assert precision > 0.93
    assert recall > 0.93


@pytest.mark.parametrize(("seed", "pixels_per_metre"), [(0, 70), (1, 55), (1, 90), (2, 70)])
def test_hatching_longer_than_the_outlines_of_walls(
    tmp_path: Path, seed: int, pixels_per_metre: float
) -> None:
    drawing = drawn(seed, style="hatched", pixels_per_metre=pixels_per_metre)
    plan = read_floorplan(saved(tmp_path / "plan.png", drawing.image))
    assert min(scores(plan, drawing)) > 0.95


@pytest.mark.parametrize("change", [
    {}, {"is_cluttered": True},
    {"is_cluttered": True, "skew_deg": 3.2, "noise": 4.0, "jpeg_quality": 70},
])  # fmt: skip
def test_hatching_tells_walls_from_windows_words_and_furniture(
    plan_of: Callable[..., Floorplan], change: dict
) -> None:
    # The strip inside an outlined hatched wall was itself taken for the gap behind furniture.
    plan = plan_of(style="hatched", **change)
    assert "hatched" in plan.source.kind
    precision, recall = scores(plan, drawn(style="hatched", **change))
    assert precision > 0.93
    assert recall > 0.95


def line_drawing(lines: np.ndarray, line_px: int = 4) -> np.ndarray:
    """Lines (n, 4) of (u0, v0, u1, v1) along the axes, black on white."""
    image = np.full((900, 1300, 3), 255, np.uint8)
    for u0, v0, u1, v1 in lines:
        u, v, half = min(u0, u1), min(v0, v1), line_px // 2
        image[v - half : v + abs(v1 - v0) + half, u - half : u + abs(u1 - u0) + half] = 0
    return image


ROOMS = [(u0 + (s if u0 == u1 else 0), v0 + (s if v0 == v1 else 0),
          u1 + (s if u0 == u1 else 0), v1 + (s if v0 == v1 else 0))
         for u0, v0, u1, v1 in [
             (300, 100, 1200, 100), (300, 800, 1200, 800), (300, 104, 300, 796),
             (1200, 104, 1200, 796), (750, 104, 750, 330), (750, 420, 750, 796),
             (304, 420, 650, 420)]
         for s in (-4, 4)]  # fmt: skip
"""Walls of two lines 8 px apart."""


@pytest.mark.parametrize("wall", [
    pytest.param([(760, 559, 1000, 559), (760, 561, 1000, 561)], id="two lines that touch"),
    pytest.param([(188, 560, 188, 838), (20, 838, 188, 838),
                  (212, 560, 212, 862), (20, 862, 212, 862)], id="of a yard, three times as thick"),
    pytest.param([(900, 500, 952, 500), (952, 500, 952, 550),
                  (900, 508, 944, 508), (944, 508, 944, 550)], id="a corner by itself"),
])  # fmt: skip
def test_walls_that_differ_from_most_are_read(tmp_path: Path, wall: list[tuple]) -> None:
    plan = read_floorplan(saved(tmp_path / "plan.png", line_drawing(np.array([*ROOMS, *wall]))))
    assert "double lines" in plan.source.kind
    for lines in (ROOMS, wall):
        points, _ = segments.sample(np.reshape(lines, (-1, 2, 2)).astype(float), 1.0)
        distance = nearest_faces.nearest_distance(points, np.ascontiguousarray(plan.ends * MIRROR))
        assert (distance < 3.0).mean() > 0.9


@pytest.mark.parametrize("corners", [
    pytest.param([(20, 20), (120, 20), (120, 90)], id="an L"),
    pytest.param([(20, 20), (120, 20), (120, 90), (60, 90), (60, 140)], id="an S"),
    pytest.param([(20, 20), (120, 20), (70, 20), (70, 90), (100, 90)], id="with a branch"),
])  # fmt: skip
def test_outlines_follow_what_is_one_pixel_thick(corners: list[tuple[int, int]]) -> None:
    mask = np.zeros((160, 160), np.uint8)
    cv2.polylines(mask, [np.array(corners)], False, (1,))
    (region,) = trace_regions(mask, 1.0)
    outline = shapely.segmentize(region.exterior, 1.0)
    points = shapely.points(shapely.get_coordinates(outline))
    away = shapely.distance(shapely.LineString(corners), points)
    assert away.max() < 3.0
    assert region.area == pytest.approx(3.0 * shapely.LineString(corners).length, rel=0.2)


def test_thin_double_lines_that_blur_into_one_another_are_parted(tmp_path: Path) -> None:
    thick, thin = (0, 204, 0, 0, 0, 204, 0), (68, 163, 163, 49)
    """Darkness across a wall, of 255: each line 0.8 px wide."""
    image = np.full((720, 960), 255, np.uint8)

    def add(u0: int, v0: int, u1: int, v1: int, across: tuple[int, ...]) -> None:
        for k, dark in enumerate(across):
            if u0 == u1:
                image[v0:v1, u0 + k] = np.minimum(image[v0:v1, u0 + k], 255 - dark)
            else:
                image[v0 + k, u0:u1] = np.minimum(image[v0 + k, u0:u1], 255 - dark)

    for wall in ((50, 50, 907, 50), (50, 650, 907, 650), (50, 50, 50, 657), (900, 50, 900, 657)):
        add(*wall, thick)
    for box in ((57, 52, 900, 55), (57, 652, 900, 655), (52, 57, 55, 650), (902, 57, 905, 650)):
        image[box[1] : box[3], box[0] : box[2]] = 255
    inner = [(500, 57, 500, 250), (500, 320, 500, 650), (57, 400, 420, 400)]
    for wall in inner:
        add(*wall, thin)
    plan = read_floorplan(saved(tmp_path / "plan.png", image))
    assert plan.source.kind.endswith("walls double lines")
    points, _ = segments.sample(np.reshape(inner, (-1, 2, 2)) + 1.5, 1.0)
    distance = nearest_faces.nearest_distance(points, np.ascontiguousarray(plan.ends * MIRROR))
    assert (distance < 3.0).mean() > 0.9


def test_a_wall_around_a_yard_is_no_storey() -> None:
    def ring(u0: float, v0: float, u1: float, v1: float) -> shapely.Polygon:
        box = shapely.box(u0, v0, u1, v1)
        return shapely.difference(box, shapely.buffer(box, -10, join_style="mitre"))

    building = [ring(300 + 150 * k, 0, 450 + 150 * k, 800) for k in range(6)]
    yard = shapely.Polygon([(0, 0), (10, 0), (10, 790), (200, 790), (200, 800), (0, 800)])
    lines = np.zeros((900, 1300), bool)
    for wall, n_storeys in ((yard, 1), (ring(0, 0, 200, 800), 2)):
        walls = np.array([wall, *building], dtype=object)
        storey_of = find_storeys(walls, 10.0, np.zeros((0, 2, 2)), lines)
        assert storey_of.max() + 1 == n_storeys


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 6])
@pytest.mark.parametrize("change", [
    {}, {"is_cluttered": True},
    {"is_cluttered": True, "skew_deg": 3.2, "noise": 4.0, "jpeg_quality": 70},
])  # fmt: skip
def test_closed_outlines_tell_walls_from_windows_doors_and_furniture(
    tmp_path: Path, seed: int, change: dict
) -> None:
    drawing = drawn(seed, 6, style="double", **change)
    plan = read_floorplan(saved(tmp_path / "plan.png", drawing.image))
    precision, recall = scores(plan, drawing)
    assert precision > 0.93
    assert recall > 0.93


def test_faces_lie_at_fractions_of_a_pixel(plan_of: Callable[..., Floorplan]) -> None:
    drawing, plan = drawn(style="black"), plan_of(style="black")
    points, _ = segments.sample(plan.ends * MIRROR, 1.0)
    distance = nearest_faces.nearest_distance(points, np.ascontiguousarray(drawing.ends_uv))
    assert np.median(distance) < 0.3


def test_thickness_and_openings(tmp_path: Path) -> None:
    image = np.full((400, 700, 3), 255, np.uint8)
    cv2.rectangle(image, (50, 50), (649, 349), (0, 0, 0), -1)
    cv2.rectangle(image, (70, 70), (629, 329), (255, 255, 255), -1)
    image[330:350, 300:380] = 255  # a door
    plan = read_floorplan(saved(tmp_path / "plan.png", image))
    long = plan.lengths > 100
    assert_allclose(plan.thickness[long], 20, atol=0.6)
    assert len(plan.openings) == 2
    assert_allclose(np.sort(plan.openings[:, :, 0], axis=1), [[299.5, 379.5]] * 2, atol=1)
    assert_allclose(np.sort(plan.openings[:, 0, 1]), [-349.5, -329.5], atol=0.6)


def test_a_gap_in_one_face_alone_is_no_opening() -> None:
    ends = np.array([[[0, 0], [40, 0]], [[60, 0], [100, 0]], [[0, 10], [100, 10]]], dtype=float)
    normals = np.array([[0, -1], [0, -1], [0, 1]], dtype=float)
    assert len(find_openings(ends, normals, np.full(3, 10.0))) == 0


def lies_in_the_picture(plan: Floorplan) -> bool:
    points = np.concatenate([plan.ends[:, 0], np.ones((len(plan), 1))], axis=1)
    uv = (points @ plan.source.file_from_plan.T)[:, :2]
    return bool((uv > 0).all() and (uv < 1000).all())


def test_scale_makes_it_metric_and_leads_to_pixels(
    plan_of: Callable[..., Floorplan], tmp_path: Path
) -> None:
    path = saved(tmp_path / "plan.png", drawn(n_rooms=1).image)
    plan, scaled = plan_of(n_rooms=1), read_floorplan(path, PlanOptions(metres_per_unit=1 / 55))
    assert lies_in_the_picture(plan)
    assert lies_in_the_picture(scaled)
    assert scaled.is_metric
    assert "--scale" in plan.source.unit_from
    assert scaled.source.unit_from == "--scale"
    assert_allclose(scaled.ends, plan.ends / 55)
    assert_allclose(scaled.thickness, plan.thickness / 55)
    with pytest.raises(FloorplanError, match="--scale"):
        read_floorplan(path, PlanOptions(metres_per_unit=100.0))


@pytest.mark.slow
@pytest.mark.parametrize(("between", "n_storeys"), [(True, 1), (False, 2)])
def test_a_plan_read_in_pieces_is_no_sheet_of_several(between: bool, n_storeys: int) -> None:
    """Two large pieces of a plan, apart, and scraps of its walls: those between tie them together, those
    beyond do not."""
    outlines = [shapely.box(300 * k, 0, 300 * k + 200, 300).buffer(-5).exterior for k in (0, 1)]
    walls = [outline.buffer(5, join_style="mitre") for outline in outlines]
    starts = (215, 240) if between else (-60, 515)  # each reaches past the middle of the strip
    scraps = [
        shapely.box(u, v + 50 * k, u + 45, v + 50 * k + 20)
        for k, u in enumerate(starts)
        for v in (10, 110, 210)
    ]
    storey_of = find_storeys(
        np.array([*walls, *scraps], dtype=object),
        10.0,
        np.zeros((0, 2, 2)),
        np.zeros((400, 700), dtype=bool),
    )
    assert storey_of.max() + 1 == n_storeys


def test_the_bar_of_a_title_is_no_storey() -> None:
    """As above the plan on escape plans, in the colour of its symbols."""
    house = shapely.difference(shapely.box(0, 200, 900, 800), shapely.box(10, 210, 890, 790))
    for title, n_storeys in (
        (shapely.box(0, 0, 1200, 80), 1),
        (shapely.difference(shapely.box(0, 0, 1200, 80), shapely.box(10, 10, 1190, 70)), 2),
    ):
        walls = np.array([house, title], dtype=object)
        lines = np.zeros((900, 1300), dtype=bool)
        storey_of = find_storeys(walls, 10.0, np.zeros((0, 2, 2)), lines)
        assert storey_of.max() + 1 == n_storeys


@pytest.mark.parametrize(("darkness", "n_storeys"), [(0.2, 1), (0.05, 2)])
def test_pale_lines_from_one_group_to_the_other_make_them_one_plan(
    tmp_path: Path, darkness: float, n_storeys: int
) -> None:
    """Windows and doors of a shrunk picture are paler than lines; a tint of the paper is no line."""
    image = np.full((500, 1000, 3), 255, np.uint8)
    for u0, v0 in ((80, 80), (530, 50)):
        cv2.rectangle(image, (u0, v0), (u0 + 390, v0 + 370), (0, 0, 0), 12)
        cv2.line(image, (u0 + 200, v0), (u0 + 200, v0 + 370), (0, 0, 0), 12)
        image[200:260, u0 + 190 : u0 + 212] = 255
    for v in (120, 380):
        image[v - 1 : v + 2, 477:524] = round(255 * (1 - darkness))
    plan = read_floorplan(saved(tmp_path / "plan.png", image))
    assert max(len(plan.source.storeys), 1) == n_storeys


@pytest.mark.parametrize("way", [0, 1])
@pytest.mark.parametrize("gap_px", [40, 110])
def test_storeys_of_one_outline_in_line_are_several(tmp_path: Path, gap_px: int, way: int) -> None:
    """The outer walls of both lie in one line, and the paper between them is as wide as a gate is."""
    house = np.full((330, 400, 3), 255, np.uint8)
    cv2.rectangle(house, (6, 6), (393, 323), (0, 0, 0), 12)
    cv2.line(house, (150, 6), (150, 323), (0, 0, 0), 12)
    for u, v, width, height in ((140, 130, 20, 60), (60, 0, 50, 13), (250, 0, 70, 13)):
        house[v : v + height, u : u + width] = 255
    paper = np.full((330, gap_px, 3) if way else (gap_px, 400, 3), 255, np.uint8)
    sheet = np.concatenate([house, paper, house], axis=way)
    sheet = cv2.copyMakeBorder(sheet, 30, 30, 30, 30, cv2.BORDER_CONSTANT, value=(255,) * 3)
    assert len(read_floorplan(saved(tmp_path / "plan.png", sheet)).source.storeys) == 2


def test_storeys_side_by_side(tmp_path: Path) -> None:
    one, other = drawn(3).image, drawn(4).image
    height = max(len(one), len(other))
    sheet = np.full((height, one.shape[1] + other.shape[1], 3), 255, np.uint8)
    sheet[: len(one), : one.shape[1]] = one
    sheet[: len(other), one.shape[1] :] = other
    path = saved(tmp_path / "plan.png", sheet)
    both = read_floorplan(path)
    assert len(both.source.storeys) == 2
    assert "--storey" in both.source.warnings[0]
    left, right = (read_floorplan(path, PlanOptions(storey=k)) for k in "01")
    assert left.ends[..., 0].max() < one.shape[1] < right.ends[..., 0].min()
    assert len(left) + len(right) == len(both)
    with pytest.raises(FloorplanError, match=r"0 \(left\), 1 \(right"):
        read_floorplan(path, PlanOptions(storey="7"))


def test_a_given_mask_takes_the_place_of_an_interpretation(tmp_path: Path) -> None:
    mask = np.zeros((300, 400), np.uint8)
    mask[100:120, 50:350] = 255
    mask_path = saved(tmp_path / "mask.png", mask)
    photo = np.random.default_rng(0).integers(0, 255, (300, 400, 3)).astype(np.uint8)
    path = saved(tmp_path / "plan.png", photo)
    plan = read_floorplan(path, PlanOptions(wall_mask=mask_path))
    long = plan.lengths > 100
    assert_allclose(np.sort(plan.ends[long][:, 0, 1]), [-119.5, -99.5], atol=0.6)
    wrong = saved(tmp_path / "wrong.png", mask[:100])
    with pytest.raises(FloorplanError, match="resize it"):
        read_floorplan(path, PlanOptions(wall_mask=wrong))


def cat(size: int = 500) -> np.ndarray:
    """Smooth shapes of all scales, as photographs have."""
    rng = np.random.default_rng(8)
    image = np.zeros((size, size, 3))
    for sigma in (2, 8, 32, 90):
        noise = cv2.GaussianBlur(rng.normal(size=(size, size, 3)), (0, 0), sigma)
        image += noise / noise.std()
    return np.clip(128 + 28 * image, 0, 255).astype(np.uint8)


def words_only() -> np.ndarray:
    image = np.full((300, 800, 3), 255, np.uint8)
    for k in range(5):
        cv2.putText(image, "The quick brown fox, 1:100", (40, 60 + 42 * k),
                    cv2.FONT_HERSHEY_SIMPLEX, 1.1, (0, 0, 0), 2, cv2.LINE_AA)  # fmt: skip
    return image


def circles() -> np.ndarray:
    image = np.full((600, 800, 3), 255, np.uint8)
    for k in range(6):
        cv2.circle(image, (100 + 110 * k, 300), 90, (0, 0, 0), 14, cv2.LINE_AA)
    return image


@pytest.mark.parametrize(("image", "words"), [
    (cat(), "photograph"),
    (np.full((400, 400, 3), 255, np.uint8), "blank page"),
    (np.zeros((400, 400, 3), np.uint8), "blank page"),
    (np.full((20, 20, 3), 255, np.uint8), "at least 60 px"),
    (words_only(), "is it a floorplan"),
    (circles(), "is it a floorplan"),
])  # fmt: skip
def test_what_is_no_plan_is_refused_in_one_line(tmp_path: Path, image, words: str) -> None:
    path = saved(tmp_path / "plan.png", image)
    with pytest.raises(FloorplanError, match=words) as caught:
        read_floorplan(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_huge_picture_is_refused_before_it_is_unpacked(tmp_path: Path) -> None:
    # A PNG's header tells its size; there are no pixels behind this one.
    header = b"\x89PNG\r\n\x1a\n" + (13).to_bytes(4, "big") + b"IHDR"
    size = (30_000).to_bytes(4, "big") * 2 + b"\x08\x00\x00\x00\x00"
    chunk = header[-4:] + size
    data = header[:-4] + chunk + zlib.crc32(chunk).to_bytes(4, "big")
    (tmp_path / "plan.png").write_bytes(data + (0).to_bytes(4, "big") + b"IDAT" + bytes(4))
    with pytest.raises(FloorplanError, match="scale it down"):
        read_floorplan(tmp_path / "plan.png")


@pytest.mark.parametrize("data", [b"", b"not a picture", b"\x89PNG\r\n\x1a\n"])
def test_damaged_pictures(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "plan.png").write_bytes(data)
    with pytest.raises(FloorplanError, match="damaged"):
        read_floorplan(tmp_path / "plan.png")


@pytest.mark.parametrize("angle", [0.0, 0.4, -3.1, 17.0, -40.0])
def test_skew_is_found(angle: float) -> None:
    darkness = make_darkness(drawn(skew_deg=angle).image, "x")
    # Drawings turn clockwise as seen, skew is counted the other way.
    assert abs(find_skew_deg(darkness) + angle) < 0.1


@pytest.mark.parametrize("angle", [0.0, 3.2, -20.0])
@pytest.mark.parametrize(("seed", "pixels_per_metre"), [(0, 70), (1, 55), (1, 90), (2, 70)])
def test_hatching_does_not_turn_the_sheet(seed: int, pixels_per_metre: float, angle: float) -> None:
    # Oblique lines had more length here than the outlines of the walls: the sheet was turned by 45 deg.
    drawing = drawn(seed, style="hatched", pixels_per_metre=pixels_per_metre, skew_deg=angle)
    assert abs(find_skew_deg(make_darkness(drawing.image, "x")) + angle) < 0.1


@pytest.mark.parametrize("angle", [-20.0, 17.0, 30.0])
def test_the_turn_of_thin_lines_is_found(angle: float) -> None:
    # Their gradients are off by more than 1 deg at such angles.
    darkness = make_darkness(drawn(style="double", skew_deg=angle).image, "x")
    assert abs(find_skew_deg(darkness) + angle) < 0.1


def test_dense_hatching_does_not_turn_the_sheet() -> None:
    drawing = drawn(0, style="hatched", pixels_per_metre=110)
    assert abs(find_skew_deg(make_darkness(drawing.image, "x"))) < 0.1


def test_upright_leads_back_to_the_picture() -> None:
    upright = make_upright(make_darkness(drawn(skew_deg=5.0).image, "x"))
    assert abs(find_skew_deg(upright.darkness)) < 0.15


def framed(image: np.ndarray, n_frames: int) -> np.ndarray:
    """The sheet with frames around it, one in the other, and words near its edge."""
    framed = cv2.copyMakeBorder(image, 40, 40, 40, 40, cv2.BORDER_CONSTANT, value=(255,) * 3)
    h, w = framed.shape[:2]
    for inset in (10, 24)[:n_frames]:
        cv2.rectangle(framed, (inset, inset), (w - inset, h - inset), (0, 0, 0), 4)
    cv2.putText(framed, "Sheet 3", (w - 150, h - 20), cv2.FONT_HERSHEY_SIMPLEX, 0.7, (0, 0, 0), 2)
    return framed


@pytest.mark.parametrize("n_frames", [1, 2])
@pytest.mark.parametrize(
    ("style", "n_rooms"), [("black", 4), ("double", 4), ("double", 2), ("hatched", 1)]
)
def test_frames_of_a_sheet_are_no_walls(
    tmp_path: Path, style: str, n_rooms: int, n_frames: int
) -> None:
    # Of one room or two, lines of thin walls have less ink than the frame.
    image = framed(drawn(style=style, n_rooms=n_rooms).image, n_frames)
    plan = read_floorplan(saved(tmp_path / "plan.png", image))
    uv = (plan.ends * MIRROR).reshape(-1, 2)
    assert (uv > 50).all()
    assert (uv < np.array(image.shape[1::-1]) - 50).all()


@pytest.mark.parametrize("n_rooms", [1, 2, 3, 4])
def test_the_outer_line_of_a_building_is_no_frame(n_rooms: int) -> None:
    darkness = make_darkness(drawn(style="double", n_rooms=n_rooms).image, "x")
    np.testing.assert_array_equal(without_frame(darkness), darkness)


@pytest.mark.parametrize("size", [2, 3, 4, 5, 8])
def test_opening_does_not_shift(size: int) -> None:
    mask = np.zeros((60, 60), np.uint8)
    mask[20:31, 10:50] = 1
    mask[40, 10:50] = 1
    expected = mask.copy()
    expected[40] = 0
    np.testing.assert_array_equal(opened(mask, size), expected)


SHARED = Path(os.environ.get("PLANFIT_SHARED", Path(__file__).parents[3] / "shared" / "data"))


@pytest.mark.shared
@pytest.mark.skipif(not SHARED.is_dir(), reason="no real plans: set PLANFIT_SHARED to their folder")
@pytest.mark.parametrize("name", ["apartment_bw.png", "apartment_hebrew.png", "flat_grey_walls.png",
                                  "house_two_floors.jpg", "villa.png"])  # fmt: skip
def test_real_pictures_are_read_without_help(name: str) -> None:
    plan = read_floorplan(SHARED / "floorplans" / "raster" / name)
    image = cv2.imread(str(SHARED / "floorplans" / "raster" / name))
    assert plan.lengths.sum() > 4 * max(image.shape)
    assert max(plan.size) > 0.6 * max(image.shape[:2])
    assert (len(plan.source.storeys) == 2) == (name == "house_two_floors.jpg")


@pytest.mark.shared
@pytest.mark.skipif(not SHARED.is_dir(), reason="no real plans: set PLANFIT_SHARED to their folder")
def test_a_real_photograph_is_refused() -> None:
    with pytest.raises(FloorplanError):
        read_floorplan(SHARED / "kitchen" / "frame-000000.color.jpg")


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="no /proc")
def test_a_large_sheet_takes_little_memory(tmp_path: Path) -> None:
    """7,351 x 4,206 px in 0.8 GB, libraries and the picture of what was read included."""
    house = np.full((4206, 7351, 3), 255, np.uint8)
    cv2.rectangle(house, (300, 300), (7050, 3900), (0, 0, 0), 33)
    for u in range(1200, 6800, 900):
        cv2.line(house, (u, 300), (u, 3900), (0, 0, 0), 12)
        house[1500:1620, u - 20 : u + 20] = 255
    path = saved(tmp_path / "plan.png", house)
    # Not `ru_maxrss`: a program begins with that of the one that started it.
    code = (
        "from pathlib import Path; from planfit.cli.main import run; "
        f"code = run(['plan', {str(path)!r}, '-o', {str(tmp_path / 'read.png')!r}]); "
        "told = Path('/proc/self/status').read_text(); "
        "peak = int(told.split('VmHWM:')[1].split()[0]); "
        "assert not code; assert peak < 800_000, peak"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)


def with_bar(title: str, side: str, colour: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """A flat, as darkness, below or beside a bar with white letters; and the flat alone."""
    picture = np.full((900, 1200, 3), 255, np.uint8)
    cv2.rectangle(picture, (200, 250), (1000, 800), (0, 0, 0), 16)
    cv2.line(picture, (600, 250), (600, 600), (0, 0, 0), 10)
    plain = picture.copy()
    cv2.rectangle(picture, (0, 0), (1199, 90), (colour, colour, colour), -1)
    cv2.putText(picture, title, (250, 62), cv2.FONT_HERSHEY_SIMPLEX, 1.8, (255, 255, 255), 5)
    turn = {"top": 0, "left": 1, "bottom": 2}[side]
    return tuple(np.rot90(1 - p[..., 0] / np.float32(255), turn) for p in (picture, plain))


@pytest.mark.parametrize("side", ["top", "left", "bottom"])
def test_bars_of_titles_are_blanked(side: str) -> None:
    darkness, plain = with_bar("FOX AND SONS", side)
    np.testing.assert_allclose(without_bars(darkness), plain, atol=0.01)


def test_a_dark_bar_without_words_may_be_a_wall() -> None:
    darkness, _ = with_bar("", "top")
    np.testing.assert_array_equal(without_bars(darkness), darkness)
    # As a shop front with panes as long as they are.
    for x in range(60, 1100, 160):
        darkness[30:60, x : x + 120] = 0.0
    np.testing.assert_array_equal(without_bars(darkness), darkness)


def test_a_picture_with_a_bar_reads_as_without(tmp_path: Path) -> None:
    found = []
    for name, darkness in zip(("bar", "plain"), with_bar("FOX AND SONS", "top"), strict=True):
        cv2.imwrite(str(tmp_path / f"{name}.png"), np.round(255 * (1 - darkness)).astype(np.uint8))
        found.append(read_floorplan(tmp_path / f"{name}.png"))
    np.testing.assert_allclose(found[0].ends, found[1].ends, atol=1.0)
