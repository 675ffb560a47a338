"""Drawings: the same picture in a page and in a file, short, and with round numbers at its rims."""

import io
import re

import numpy as np
import pytest
from PIL import Image

from planfit.report.plots import colors
from planfit.report.plots.axes import Axes, left_pt, new_chart, round_number, tick_values
from planfit.report.plots.drawing import (
    DPI,
    Box,
    Drawing,
    Words,
    rgb_of,
    to_image,
    to_png,
    to_svg,
    visible_lines,
)

RED, GREEN = "#ff0000", "#00ff00"


def make_axes(x=(0.0, 10.0), y=(0.0, 5.0)):
    """Axes of 200 x 100 pt, 20 pt from the upper left."""
    drawing = Drawing(240, 140)
    return drawing, Axes(drawing, Box(20, 20, 220, 120), x, y)


def pixels_of(image, color, tolerance=8):
    """Rows and columns, in pt, of the pixels of a colour."""
    rows, columns = np.nonzero(
        np.abs(image[:, :, ::-1] - np.array(rgb_of(color))).max(2) < tolerance
    )
    return np.column_stack([columns, rows]) * 72 / DPI


def moves_of(svg):
    """Points of all lines of an SVG, pt."""
    lines = []
    for path in re.findall(r' d="(.*?)"', svg):
        for one in re.findall(r"M([-\d ]+)l([-\d ]+)", path):
            start, steps = (
                np.array([int(n) for n in re.findall(r"-?\d+", part)]).reshape(-1, 2)
                for part in one
            )
            lines.append(np.cumsum(np.concatenate([start, steps]), axis=0) / 10)
    return lines


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (0.0, 1.0, ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]),
        (-2.1, 1.9, ["−2", "−1", "0", "1"]),
        (0.0, 0.3, ["0.0", "0.1", "0.2", "0.3"]),
        (990.0, 1010.0, ["990", "995", "1000", "1005", "1010"]),
    ],
)
def test_numbers_at_a_rim_are_round(low, high, expected):
    assert [words for _, words in tick_values(low, high)] == expected


def test_frames_are_counted_in_whole_numbers():
    assert [words for _, words in tick_values(0, 2, least_step=1)] == ["0", "1", "2"]


def test_an_axis_may_be_told_by_its_negative():
    assert tick_values(-1.0, 2.0, sign=-1) == [(-1, "1"), (0, "0"), (1, "−1"), (2, "−2")]


@pytest.mark.parametrize("number", [0.1, 0.3 / 3, 1.0, 4.9, 7.0, 123.0, 1e-7])
def test_a_round_number_is_the_largest_below(number):
    found = round_number(number)
    assert 0.4 * number < found <= number * (1 + 1e-9)
    assert f"{found:.0e}"[0] in "125"


def test_room_on_the_left_grows_with_the_numbers():
    assert left_pt((0, 1e6)) > left_pt((0, 1)) + 10


def test_a_line_is_where_its_values_are_in_both_kinds_of_picture():
    drawing, axes = make_axes()
    axes.series(np.array([2.0, 8.0]), np.array([1.0, 4.0]), RED, 1.0)
    (line,) = moves_of(to_svg(drawing))
    np.testing.assert_allclose(line, [[60, 100], [180, 40]])
    drawn = pixels_of(to_image(drawing), RED, 60)
    np.testing.assert_allclose([drawn.min(0), drawn.max(0)], [[60, 40], [180, 100]], atol=1.0)


def test_what_is_outside_the_axes_is_cut_off():
    drawing, axes = make_axes()
    axes.lines([np.array([[-5.0, 2.5], [15.0, 2.5], [15.0, 9.0], [5.0, 9.0]])], RED, 1.0)
    (line,) = moves_of(to_svg(drawing))
    np.testing.assert_allclose(line, [[20, 70], [220, 70]], atol=0.5)


def test_lines_break_where_a_value_is_unknown():
    drawing, axes = make_axes()
    y = np.array([1.0, 2.0, np.nan, 2.0, 1.0, np.inf, np.inf])
    axes.series(np.arange(7), y, RED, 1.0)
    axes.band(np.arange(7), np.zeros(7), y, GREEN, 0.5)
    svg = to_svg(drawing)
    assert len(moves_of(svg)) == 4
    assert "nan" not in svg
    assert len(pixels_of(to_image(drawing), RED, 60))


def test_long_lines_stay_short_and_keep_their_peaks():
    drawing, axes = make_axes((0.0, 1e6), (-5.0, 5.0))
    y = np.random.default_rng(0).normal(0.0, 0.5, 1_000_000)
    y[345_678] = 4.9
    axes.series(np.arange(1_000_000), y, RED, 1.0)
    svg = to_svg(drawing)
    assert len(svg) < 20_000
    assert min(line[:, 1].min() for line in moves_of(svg)) == pytest.approx(21.0, abs=0.1)


def test_density_shows_every_point_and_more_where_there_are_more():
    drawing, axes = make_axes()
    axes.density(np.array([[1.0, 4.0], *[[9.0, 1.0]] * 50, [11.0, 1.0]]), colors.AFTER, 2.0)
    assert "data:image/png;base64," in to_svg(drawing)
    image = to_image(drawing).astype(int)
    one, many = (image[round(y * DPI / 72), round(x * DPI / 72)] for x, y in ((41, 41), (201, 101)))
    np.testing.assert_allclose(many[::-1], rgb_of(colors.AFTER), atol=2)
    assert (many < one).any()
    assert (one < 250).any()
    assert image[round(101 * DPI / 72), round(230 * DPI / 72)].min() == 255


def test_a_png_has_the_size_in_points_at_its_resolution():
    drawing, _ = new_chart(209, (0.0, 1.0), (0.0, 1.0))
    with Image.open(io.BytesIO(to_png(drawing))) as image:
        assert image.size == pytest.approx((331 * DPI / 72, 209 * DPI / 72), abs=1)
        assert image.mode == "RGB"


@pytest.mark.parametrize(("anchor", "share"), [("start", 0.0), ("middle", 0.5), ("end", 1.0)])
def test_words_stand_where_they_are_put(anchor, share):
    drawing = Drawing(200, 40, [Words("HHHHHHHH", (100.0, 20.0), colors.INK, anchor)])
    drawn = pixels_of(to_image(drawing), colors.INK, 40)
    (left, top), (right, bottom) = drawn.min(0), drawn.max(0)
    assert left + share * (right - left) == pytest.approx(100, abs=1.5)
    assert bottom == pytest.approx(20, abs=1)
    assert 5 < bottom - top < 8
    assert f'text-anchor="{anchor}"' in to_svg(drawing) or anchor == "start"


def test_upright_words_are_read_from_below():
    drawing = Drawing(60, 100, [Words("HHHHL", (30.0, 90.0), colors.INK, is_upright=True)])
    drawn = pixels_of(to_image(drawing), colors.INK, 60)
    assert drawn[:, 0].max() == pytest.approx(30, abs=1)  # its base line
    assert drawn[:, 1].max() == pytest.approx(90, abs=1.5)  # where it begins


def test_words_of_a_page_are_escaped():
    assert "&lt;b&gt; &amp;" in to_svg(Drawing(9, 9, [Words("<b> &", (1, 1))]))


def test_letters_that_the_file_lacks_do_not_stop_it():
    words = Words("Büro −2\u00a0m 中", (5.0, 20.0), colors.BEFORE, is_bold=True)
    assert len(pixels_of(to_image(Drawing(200, 40, [words])), colors.BEFORE, 40)) > 100


def test_lines_are_broken_where_a_point_is_nowhere():
    line = np.array([[1.0, 1], [2, 1], [np.nan, np.nan], [6, 1], [8, 3], [9, np.inf], [3, 3]])
    found = visible_lines([line], Box(0.0, 0.0, 10.0, 10.0))
    assert [one.tolist() for one in found] == [[[1, 1], [2, 1]], [[6, 1], [8, 3]]]
