"""What pictures have beside walls: titles and names of rooms, however bold, other pages, no paper."""

from itertools import pairwise

import cv2
import numpy as np
import pytest
from PIL import Image

from planfit.floorplan import Floorplan, read_floorplan

WALL_PX = 12


def flat() -> np.ndarray:
    """Walls of five rooms, doors as gaps: 255 on paper."""
    picture = np.full((1000, 1200), 255, np.uint8)
    for u0, v0, u1, v1 in (
        (100, 100, 1000, 100), (100, 700, 1000, 700), (100, 100, 100, 700), (1000, 100, 1000, 700),
        (450, 100, 450, 350), (450, 430, 450, 700), (100, 400, 280, 400), (360, 400, 450, 400),
        (450, 450, 700, 450), (780, 450, 1000, 450), (720, 100, 720, 300), (720, 380, 720, 450),
    ):  # fmt: skip
        half = WALL_PX // 2
        picture[v0 - half : v1 + half, u0 - half : u1 + half] = 0
    return picture


def read(picture: np.ndarray, tmp_path) -> Floorplan:
    path = tmp_path / "plan.png"
    Image.fromarray(picture).save(path)
    return read_floorplan(path)


def write(picture: np.ndarray, words: str, at: tuple[int, int], height_px: int) -> None:
    font, pen = cv2.FONT_HERSHEY_SIMPLEX, max(height_px // 5, 1)
    size = cv2.getFontScaleFromHeight(font, height_px, pen)
    cv2.putText(picture, words, at, font, size, 0, pen)


def same_faces(a: Floorplan, b: Floorplan) -> bool:
    if len(a.ends) != len(b.ends):
        return False
    ends = [each.ends[np.lexsort(each.ends.reshape(-1, 4).T.round(1))] for each in (a, b)]
    return bool(np.abs(ends[0] - ends[1]).max() < 1.0)


@pytest.mark.parametrize("height_px", [30, 50, 80])
def test_a_bold_title_is_no_wall(height_px: int, tmp_path) -> None:
    picture = flat()
    write(picture, "GROUND FLOOR 1", (100, 820), height_px)
    assert same_faces(read(picture, tmp_path), read(flat(), tmp_path))


def test_a_title_along_the_side_is_no_wall(tmp_path) -> None:
    beside = np.full((1200, 1000), 255, np.uint8)
    write(beside, "GROUND FLOOR", (200, 60), 50)
    picture = np.minimum(flat(), np.rot90(beside))
    assert same_faces(read(picture, tmp_path), read(flat(), tmp_path))


@pytest.mark.parametrize("height_px", [30, 56])
def test_bold_names_of_rooms_are_no_walls_and_hide_none(height_px: int, tmp_path) -> None:
    picture = flat()
    for name, at in (("KITCHEN", (130, 200)), ("LIVING", (130, 600)), ("BEDROOM", (500, 600))):
        write(picture, name, at, height_px)
    assert same_faces(read(picture, tmp_path), read(flat(), tmp_path))


@pytest.mark.parametrize("wall_px", [6, 12, 18])
def test_a_building_in_pieces_is_no_text(wall_px: int, tmp_path) -> None:
    # Cells on both sides of a corridor, windows and doors as gaps: rows of pieces as high, and close.
    picture = np.full((420, 1400), 255, np.uint8)
    columns = (100, 210, 360, 470, 590, 760, 870, 1010, 1120, 1260)
    for top, bottom in ((60, 180), (240, 360)):
        for u in columns:
            picture[top : bottom + wall_px, u : u + wall_px] = 0
        for v in (top, bottom):
            picture[v : v + wall_px, columns[0] : columns[-1]] = 0
            for left, right in pairwise(columns):
                middle = (left + right + wall_px) // 2
                picture[v : v + wall_px, middle - 20 : middle + 20] = 255
    plan = read(picture, tmp_path)
    low, high = plan.ends.reshape(-1, 2).min(axis=0), plan.ends.reshape(-1, 2).max(axis=0)
    np.testing.assert_allclose(low, (100, -(360 + wall_px)), atol=2.0)
    np.testing.assert_allclose(high, (1260 + wall_px, -60), atol=2.0)
    across = np.ptp(plan.ends[:, :, 0], axis=1) < 1.0
    lengths = np.linalg.norm(np.diff(plan.ends[across], axis=1)[:, 0], axis=1)
    assert lengths.sum() > 0.9 * 2 * 2 * len(columns) * 120


def test_walls_drawn_in_white_on_nothing_are_those_in_black(tmp_path) -> None:
    path = tmp_path / "white.png"
    rgba = np.full((*flat().shape, 4), 255, np.uint8)
    rgba[..., 3] = 255 - flat()
    Image.fromarray(rgba).save(path)
    assert same_faces(read_floorplan(path), read(flat(), tmp_path))


@pytest.mark.parametrize("n_pages", [1, 3])
def test_pages_of_a_scanned_document_that_are_not_read_are_told(n_pages: int, tmp_path) -> None:
    path, page = tmp_path / "pages.tif", Image.fromarray(flat())
    page.save(path, save_all=True, append_images=[page] * (n_pages - 1))
    told = [words for words in read_floorplan(path).source.warnings if "pages" in words]
    assert len(told) == (n_pages > 1)


def test_the_first_page_is_read_of_a_document_that_is_cut_off_behind_it(tmp_path) -> None:
    path, page = tmp_path / "pages.tif", Image.fromarray(flat())
    page.save(path, save_all=True, append_images=[page] * 5)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    plan = read_floorplan(path)
    assert same_faces(plan, read(flat(), tmp_path))
    assert [words for words in plan.source.warnings if "page is read" in words]


def shut(margin_px: int) -> np.ndarray:
    """Walls with no gap to the outside, one partition, fittings in a finer pen, paper around: 255 on it."""
    picture = flat()[80:720, 80:1020].copy()
    picture[40:600, 40:350] = 255
    picture[40:600, 380:900] = 255
    for v in (150, 170, 190, 210, 480, 500, 520):
        picture[v : v + 3, 30:140] = 0
    picture[150:523, 140:143] = 0
    return np.pad(picture, margin_px, constant_values=255)


@pytest.mark.parametrize("margin_px", [0, 12, 30, 45, 90])
def test_the_paper_around_walls_is_none_of_theirs(margin_px: int, tmp_path) -> None:
    plan = read(shut(margin_px), tmp_path)
    corners = plan.ends.reshape(-1, 2)
    np.testing.assert_allclose(corners.min(axis=0), (14 + margin_px, -626 - margin_px), atol=2.0)
    np.testing.assert_allclose(corners.max(axis=0), (926 + margin_px, -14 - margin_px), atol=2.0)
    assert plan.lengths.sum() == pytest.approx(2 * (912 + 612 + 888 + 588) + 2 * 560, rel=0.1)


@pytest.mark.parametrize("size", [1.0, 1.7, 2.6])
def test_a_deck_of_planks_is_no_wall(size: float, tmp_path) -> None:
    picture = flat()
    for row in range(0, 16):
        for column in range(0, 20):
            u, v = 112 + 34 * column // 2 * 1, 420 + 34 * row // 2
            if (row + column) % 2:
                picture[v : v + 2, u : u + 16] = picture[v + 8 : v + 10, u : u + 16] = 150
            else:
                picture[v : v + 16, u : u + 2] = picture[v : v + 16, u + 8 : u + 10] = 150
    plain, planked = (
        cv2.resize(each, None, fx=size, fy=size, interpolation=cv2.INTER_CUBIC)
        for each in (flat(), picture)
    )
    found = read(planked, tmp_path)
    assert found.lengths.sum() < 1.05 * read(plain, tmp_path).lengths.sum()


@pytest.mark.parametrize("turn", [0, 1])
@pytest.mark.parametrize("narrower", [0.0, 0.06, 0.15])
def test_a_sheet_that_was_photographed_at_a_slant_is_told(
    narrower: float, turn: int, tmp_path
) -> None:
    picture = np.rot90(flat(), turn).copy()
    height, width = picture.shape
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    seen = corners + np.array(
        [[narrower / 2 * width, 0], [-narrower / 2 * width, 0], [0, 0], [0, 0]]
    )
    warp = cv2.getPerspectiveTransform(corners, seen.astype(np.float32))
    size = (width, height)
    leaning = cv2.warpPerspective(picture, warp, size, borderValue=255, flags=cv2.INTER_CUBIC)
    told = [words for words in read(leaning, tmp_path).source.warnings if "at a slant" in words]
    assert len(told) == (narrower > 0)
