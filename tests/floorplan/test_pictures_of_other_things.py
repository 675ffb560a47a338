"""Pictures that are no floorplan, or a poor one: read, and said to be doubtful."""

import cv2
import numpy as np
import pytest
from drawn_plans.drawing import DrawingOptions, draw_building

from planfit.errors import FloorplanError
from planfit.floorplan import Floorplan, PlanOptions
from planfit.floorplan.plausible import aligned_share, are_closed_rooms, kinked_share
from planfit.floorplan.raster import plan_of_picture
from planfit.floorplan.raster.sheet_marks import is_photograph
from planfit.synth import BuildingOptions, make_building
from strange_pictures import strange_picture

BLACK = (0, 0, 0)


def read(image: np.ndarray) -> Floorplan:
    return plan_of_picture(image, "picture", "", PlanOptions(), "picture")


def paper(height: int = 900, width: int = 1300) -> np.ndarray:
    return np.full((height, width, 3), 255, np.uint8)


def facade() -> np.ndarray:
    """A photograph of a house front: sky, plaster with shade, rows of dark windows."""
    rng = np.random.default_rng(4)
    image = np.zeros((900, 1300, 3))
    image[:250] = (230, 190, 150)
    image[250:] = np.linspace(150, 190, 1300)[None, :, None]
    for v in range(300, 800, 120):
        for u in range(100, 1200, 140):
            image[v : v + 70, u : u + 60] = 40 + 30 * rng.random((70, 60, 3))
            image[v + 70 : v + 76, u - 5 : u + 65] = 120
    image += cv2.GaussianBlur(rng.normal(size=image.shape), (0, 0), 3) * 25
    image += rng.normal(size=image.shape) * 6
    return np.clip(image, 0, 255).astype(np.uint8)


def site_plan() -> np.ndarray:
    """Streets as pairs of lines, plots, outlines of houses, trees, names."""
    rng = np.random.default_rng(5)
    image = paper()
    for v in (300, 620):
        for side in (-22, 22):
            cv2.line(image, (0, v + side), (1300, v + side - 40), BLACK, 2, cv2.LINE_AA)
    for u in range(60, 1300, 150):
        cv2.line(image, (u, 330), (u + 10, 590), (120,) * 3, 1, cv2.LINE_AA)
        corner = np.array([u + 30, 380])
        box = cv2.boxPoints((tuple((corner + 45).tolist()), (70, 90), float(rng.uniform(-8, 8))))
        cv2.polylines(image, [box.astype(np.int32)], True, BLACK, 2, cv2.LINE_AA)
        cv2.putText(
            image, f"{rng.integers(100, 999)}", (u + 50, 430), 0, 0.6, BLACK, 1, cv2.LINE_AA
        )
    for _ in range(60):
        at = (int(rng.uniform(0, 1300)), int(rng.uniform(660, 880)))
        cv2.circle(image, at, int(rng.uniform(6, 16)), (90,) * 3, 1, cv2.LINE_AA)
    cv2.putText(image, "Station Road", (500, 300), 0, 0.8, BLACK, 1, cv2.LINE_AA)
    return image


def section() -> np.ndarray:
    """A house cut from top to bottom: slabs, a gable roof, ground, stairs, heights."""
    image = paper()
    for v in (300, 470, 640):
        cv2.rectangle(image, (300, v), (1000, v + 22), BLACK, -1)
    for u in (300, 976):
        cv2.rectangle(image, (u, 300), (u + 24, 662), BLACK, -1)
    roof = np.array([[270, 310], [650, 90], [1030, 310], [1000, 310], [650, 115], [300, 310]])
    cv2.fillPoly(image, [roof.astype(np.int32)], BLACK)
    for u in range(0, 1300, 18):
        cv2.line(image, (u, 700), (u + 24, 676), BLACK, 1, cv2.LINE_AA)
    cv2.line(image, (0, 676), (1300, 676), BLACK, 2)
    for k in range(12):
        cv2.line(image, (600 + 14 * k, 640 - 13 * k), (614 + 14 * k, 640 - 13 * k), BLACK, 2)
        cv2.line(image, (614 + 14 * k, 640 - 13 * k), (614 + 14 * k, 627 - 13 * k), BLACK, 2)
    for k, v in enumerate((640, 470, 300)):
        cv2.putText(image, f"+{2.8 * k:.2f}", (1080, v), 0, 0.7, BLACK, 1, cv2.LINE_AA)
        cv2.line(image, (1040, v), (1180, v), BLACK, 1)
    return image


def round_house(gaps: int) -> np.ndarray:
    """A ring of wall with doors and windows cut into it, and partitions without doors."""
    image = paper(900, 900)
    cv2.circle(image, (450, 450), 350, BLACK, 18, cv2.LINE_AA)
    cv2.line(image, (450, 110), (450, 790), BLACK, 10)
    cv2.line(image, (450, 450), (795, 450), BLACK, 10)
    for angle in (0.6, 2.4, 4.0)[:gaps]:
        along = np.array([np.cos(angle), np.sin(angle)])
        ends = [tuple(np.round(450 + r * along).astype(int).tolist()) for r in (320, 380)]
        cv2.line(image, *ends, (255, 255, 255), 50)
    return image


def sketch(seed: int = 6) -> np.ndarray:
    """Rooms as single pencil lines of a shaking hand, on grey paper."""
    rng = np.random.default_rng(seed)
    image = np.full((900, 1200, 3), 225, np.uint8)
    walls = [(150, 150, 1000, 150), (1000, 150, 1000, 750), (1000, 750, 150, 750),
             (150, 750, 150, 150), (550, 150, 550, 420), (550, 520, 550, 750),
             (150, 450, 400, 450), (550, 400, 850, 400)]  # fmt: skip
    for u0, v0, u1, v1 in walls:
        n = 30
        points = np.linspace((u0, v0), (u1, v1), n)
        points += cv2.GaussianBlur(rng.normal(size=(n, 2)), (0, 0), 2) * 6
        cv2.polylines(image, [points.astype(np.int32)], False, (60, 60, 60), 3, cv2.LINE_AA)
    for name, at in (("kitchen", (250, 600)), ("bed", (700, 280)), ("living", (700, 600))):
        cv2.putText(image, name, at, cv2.FONT_HERSHEY_SCRIPT_SIMPLEX, 1.2, (80,) * 3, 2)
    noise = rng.normal(size=image.shape[:2]) * 4
    return np.clip(image + noise[..., None], 0, 255).astype(np.uint8)


def brick_facade() -> np.ndarray:
    """Courses of brick, windows with white frames, seen a little from the side: lines side by side
    everywhere."""
    rng = np.random.default_rng(1)
    image = np.full((900, 1300, 3), (200, 170, 140), dtype=float)
    image[300:] = (90, 110, 160)
    for v in range(300, 900, 18):
        image[v : v + 2] = (150, 160, 170)
        for u in range((v // 18 % 2) * 25, 1300, 50):
            image[v : v + 18, u : u + 2] = (150, 160, 170)
    for v in (380, 600):
        for u in range(120, 1200, 230):
            image[v : v + 140, u : u + 90] = 42
            image[v : v + 140, u + 43 : u + 47] = 230
            cv2.rectangle(image, (u, v), (u + 90, v + 140), (235, 235, 235), 6)
    image += cv2.GaussianBlur(rng.normal(size=image.shape), (0, 0), 4) * 30
    image += rng.normal(size=image.shape) * 8
    image *= np.linspace(0.6, 1.1, 1300)[None, :, None]
    there = np.array([[60, 0], [1300, 80], [1280, 860], [0, 900]], dtype=np.float32)
    here = np.array([[0, 0], [1300, 0], [1300, 900], [0, 900]], dtype=np.float32)
    matrix = cv2.getPerspectiveTransform(here, there)
    seen = np.clip(image, 0, 255).astype(np.uint8)
    return cv2.warpPerspective(seen, matrix, (1300, 900), borderMode=cv2.BORDER_REPLICATE)


def filled_section() -> np.ndarray:
    """Rooms cut out of a dark house with a gable: walls end in line on both sides of others."""
    image = paper()
    house = np.array([[200, 700], [200, 300], [650, 120], [1100, 300], [1100, 700]], dtype=np.int32)
    cv2.fillPoly(image, [house], (40,) * 3)
    for u0, v0, u1, v1 in ((222, 500, 640, 680), (655, 500, 1078, 680), (222, 322, 640, 482),
                           (655, 322, 1078, 482)):  # fmt: skip
        cv2.rectangle(image, (u0, v0), (u1, v1), (255,) * 3, -1)
    cv2.line(image, (0, 700), (1300, 700), BLACK, 3)
    return image


def sketch_of_two_lines() -> np.ndarray:
    """Walls as two lines of a shaking hand."""
    rng = np.random.default_rng(2)
    image = np.full((900, 1200, 3), 235, np.uint8)
    walls = [(150, 150, 1000, 150), (1000, 150, 1000, 750), (1000, 750, 150, 750), (150, 750, 150, 150),
             (550, 150, 550, 420), (550, 520, 550, 750), (150, 450, 400, 450)]  # fmt: skip
    for u0, v0, u1, v1 in walls:
        for off in (0, 14):
            points = np.linspace((u0, v0), (u1, v1), 40) + off
            points += np.cumsum(rng.normal(size=(40, 2)), axis=0) * 0.8
            cv2.polylines(image, [points.astype(np.int32)], False, (60,) * 3, 2, cv2.LINE_AA)
    return image


def bar_chart() -> np.ndarray:
    image = paper()
    cv2.line(image, (100, 800), (1200, 800), BLACK, 3)
    cv2.line(image, (100, 100), (100, 800), BLACK, 3)
    heights = (190, 540, 320, 610, 250, 470, 130, 580, 400)
    for u, height in zip(range(160, 1150, 120), heights, strict=True):
        cv2.rectangle(image, (u, 800 - height), (u + 70, 800), (60,) * 3, -1)
    return image


def few_houses() -> np.ndarray:
    """A site plan of six houses: no more than there may be storeys on a sheet."""
    image = paper()
    for v in (200, 250):
        cv2.line(image, (0, v), (1300, v + 20), BLACK, 2, cv2.LINE_AA)
    for u in range(70, 1250, 210):
        cv2.line(image, (u - 30, 260), (u - 30, 850), (150,) * 3, 1)
        cv2.rectangle(image, (u, 320), (u + 120, 430), BLACK, 2)
        cv2.rectangle(image, (u + 120, 360), (u + 160, 430), BLACK, 2)
        cv2.putText(image, str(u), (u + 30, 385), 0, 0.6, BLACK, 1)
    return image


@pytest.mark.parametrize(("image", "words"), [
    (filled_section(), "is it a section"),
    (sketch_of_two_lines(), "a sketch by hand"),
    (bar_chart(), "none closes in a room"),
    (few_houses(), "probably no floorplan"),
])  # fmt: skip
def test_what_was_read_without_a_word_is_said_to_be_doubtful(image: np.ndarray, words: str) -> None:
    assert any(words in warning for warning in read(image).source.warnings)


@pytest.mark.parametrize("image", [facade(), brick_facade()], ids=["plaster", "bricks"])
def test_a_photograph_of_a_front_is_refused(image: np.ndarray) -> None:
    with pytest.raises(FloorplanError):
        read(image)


def test_a_photograph_with_little_that_may_be_walls_is_refused_saying_what_to_do() -> None:
    with pytest.raises(FloorplanError, match="crop it"):
        read(brick_facade())


def test_a_photograph_of_a_drawing_is_read() -> None:
    picture = strange_picture("solid, scanned", 41, 45)
    rng = np.random.default_rng(3)
    shade = np.linspace(0.45, 1.0, picture.image.shape[1])[None, :, None]
    photograph = picture.image * shade + rng.normal(size=picture.image.shape) * 9
    image = np.clip(photograph, 0, 255).astype(np.uint8)
    assert is_photograph(image)
    assert len(read(image).ends) > 20


@pytest.mark.parametrize(("style", "seed"), [
    ("solid, scanned", 41), ("coloured rooms, JPEG", 42), ("solid, sepia", 43), ("parquet", 44),
    ("black with cupboards", 14), ("hatched, scanned", 46),
])  # fmt: skip
def test_drawings_in_any_state_raise_none_of_these_doubts(style: str, seed: int) -> None:
    picture = strange_picture(style, seed, 45)
    assert not is_photograph(picture.image)
    words = " ".join(read(picture.image).source.warnings)
    assert not any(each in words for each in ("photograph", "section", "sketch", "no floorplan"))


@pytest.mark.parametrize(("image", "words"), [
    (site_plan(), "houses of a site plan"),
    (section(), "is it a section"),
    (sketch(), "a sketch by hand"),
])  # fmt: skip
def test_what_is_no_floorplan_is_said_to_be_doubtful(image: np.ndarray, words: str) -> None:
    plan = read(image)
    assert any(words in warning for warning in plan.source.warnings)
    assert plan.source.storeys == ()


@pytest.mark.parametrize("change", [
    {}, {"perspective": 0.02}, {"style": "double"}, {"style": "hatched"}, {"is_cluttered": True},
])  # fmt: skip
def test_floorplans_raise_no_doubts(change: dict) -> None:
    rng = np.random.default_rng(7)
    building = make_building(BuildingOptions(n_rooms=4), rng)
    plan = read(draw_building(building, DrawingOptions(pixels_per_metre=45, **change), rng).image)
    assert plan.source.warnings == ()


@pytest.mark.parametrize("gaps", [0, 3])
def test_a_round_house_is_no_sketch_and_no_section(gaps: int) -> None:
    """Straight faces have no gaps there, and few run along common directions."""
    warnings = " ".join(read(round_house(gaps)).source.warnings)
    assert "sketch" not in warnings
    assert ("is it a section" in warnings) == (gaps == 0)


def test_aligned_share_counts_two_pairs_of_directions() -> None:
    def face(angle_deg: float, length: float) -> list:
        angle = np.deg2rad(angle_deg)
        return [(0.0, 0.0), (length * np.cos(angle), length * np.sin(angle))]

    square = [face(0.5, 3), face(90, 2), face(179.5, 3), face(270, 2)]
    assert aligned_share(np.array(square)) == pytest.approx(1.0)
    assert aligned_share(np.array([*square, face(45, 5)])) == pytest.approx(1.0)
    assert aligned_share(np.array([*square, face(45, 5), face(20, 5)])) == pytest.approx(0.75)


def test_kinked_share_counts_small_turns_but_no_corners_and_no_round_walls() -> None:
    def chain(turns_deg: list[float], step: float = 50.0) -> np.ndarray:
        angle = np.deg2rad(np.cumsum(turns_deg))
        steps = step * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        points = np.concatenate([[(0.0, 0.0)], np.cumsum(steps, axis=0)])
        return np.stack([points[:-1], points[1:]], axis=1)

    assert kinked_share(chain([0, 5, -5, 5, -4])) == pytest.approx(0.8)
    assert kinked_share(chain([0, 90, 90, 90])) == 0.0
    assert kinked_share(chain([10.0] * 30)) < 0.05


def test_one_large_room_is_a_plan_whose_outer_doors_are_closed() -> None:
    """Of rooms that doors join, the ring of outer walls encloses one; of a section each room is apart."""
    assert are_closed_rooms(np.array([0.2, 0.2, 0.2, 0.2]))
    assert not are_closed_rooms(np.array([0.85, 0.05]))
    assert not are_closed_rooms(np.array([0.2, 0.1]))
    assert not are_closed_rooms(np.zeros(0))


def test_a_floor_with_open_doors_in_closed_outer_walls_raises_no_doubt() -> None:
    image = paper()
    cv2.rectangle(image, (100, 100), (1200, 800), BLACK, 20)
    cv2.line(image, (600, 100), (600, 800), BLACK, 12)
    cv2.line(image, (100, 450), (1200, 450), BLACK, 12)
    for u, v in ((600, 250), (600, 600), (300, 450), (900, 450)):
        cv2.rectangle(image, (u - 35, v - 35), (u + 35, v + 35), (255,) * 3, -1)
    assert read(image).source.warnings == ()
