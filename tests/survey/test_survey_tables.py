"""Tables of points and marks as people and programs write them, and what is said of those that are none."""

import os
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from planfit.errors import OptionError
from planfit.survey import read_marks, read_points

SHARED = Path(os.environ.get("PLANFIT_SHARED", Path(__file__).parents[3] / "shared" / "data"))
NAMES = ("frame-a", "frame-b", "0012")


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "table.csv"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "text",
    [
        "P1,1.5,-2,3,0.02\nP2,4,5,6,0.02\n",
        "id,x,y,z,sigma\nP1,1.5,-2,3,0.02\n\nP2,4,5,6,0.02\n",
        "\ufeffPoint;Northing;Easting;Height;Sigma\r\nP1;-2,0;1,5;3,0;0,02\r\nP2;5;4;6;0,02\r\n",
        "# of the total station\nP1 1.5 -2 3 0.02\nP2\t4 5 6 0.02\n",
        'name\tz\ty\tx\taccuracy\n"P1"\t3\t-2\t1.5\t0.02\nP2\t6\t5\t4\t0.02\n',
        "code,id,x,y,z,sigma\nbolt,P1,1.5,-2,3,0.02\nnail,P2,4,5,6,0.02\n",
    ],
    ids=["bare", "header", "northing first", "blanks", "tabs", "more columns"],
)
def test_points_in_forms_that_programs_write(tmp_path, text):
    first, second = read_points(written(tmp_path, text))
    assert (first.id, second.id) == ("P1", "P2")
    assert_allclose(first.xyz, [1.5, -2.0, 3.0])
    assert_allclose(second.xyz, [4.0, 5.0, 6.0])
    assert first.sigma_m == 0.02
    assert not first.is_check


def test_unknown_heights_default_sigmas_and_large_numbers(tmp_path):
    one, two = read_points(written(tmp_path, "A,2612345.6789,1223456.7891,\nB,1,2,3\n"), True)
    assert np.isnan(one.xyz[2])
    assert one.xyz[0] == 2612345.6789
    assert one.sigma_m == two.sigma_m == 0.01
    assert one.is_check


def test_marks_by_number_by_name_and_of_cameras(tmp_path):
    text = "frame,u,v,id\n2,10.5,20,A\nframe-b,,,B\n"
    first, second = read_marks(written(tmp_path, text), NAMES)
    assert (first.frame_idx, first.uv, first.point_id) == (2, (10.5, 20.0), "A")
    assert (second.frame_idx, second.uv, second.point_id) == (1, None, "B")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "expected lines id,x,y,z[,sigma], found none; is it the right file?"),
        ("P1,1,2\n", "table.csv:1: expected id,x,y,z[,sigma], found 'P1,1,2', without z"),
        ("P1,1,2,3\nP2,one,2,3\n", "table.csv:2: expected a number as x, found 'one'"),
        ("P1,nan,2,3\n", "table.csv:1: expected a number as x, found 'nan'"),
        ("P1,1,2,3,-1\n", "expected a sigma above 0 in metres, found -1"),
        (",1,2,3\n", "expected an id, found an empty cell"),
        (
            "P1,1,2,3\nP1,1,2,4\n",
            "expected one place of point 'P1', found two, (1.000, 2.000, 3.000) and",
        ),
        ("WGS84 UTM 16N\n609925 4950688 171 1331 350 A.JPG\n", "without z"),
        ("P1,1\x00,2,3\n", "in plain text (UTF-8), found other data"),
    ],
)
def test_what_is_no_table_of_points_is_told_in_one_line(tmp_path, text, words):
    with pytest.raises(OptionError) as found:
        read_points(written(tmp_path, text))
    assert words in str(found.value)
    assert "table.csv" in str(found.value)
    assert "; " in str(found.value)


def test_a_point_given_twice_at_one_place_is_one(tmp_path):
    assert len(read_points(written(tmp_path, "P1,1,2,3\nP1,1,2,3\nQ,1,2,\nQ,1,2,\n"))) == 2


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("3,1,2,A\n", "expected a frame of the scan, 0 to 2, found '3'"),
        ("frame-c,1,2,A\n", "found 'frame-c'"),
        ("-1,1,2,A\n", "found '-1'"),
        ("1,1,,A\n", "expected u and v, or neither"),
        ("1,a,2,A\n", "expected a number as u, found 'a'"),
        ("\n", "expected lines frame,u,v,id, found none"),
    ],
)
def test_what_is_no_table_of_marks_is_told_in_one_line(tmp_path, text, words):
    with pytest.raises(OptionError) as found:
        read_marks(written(tmp_path, text), NAMES)
    assert words in str(found.value)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(
        OptionError, match=r"none\.csv: expected a table id,x,y,z\[,sigma\], found No such"
    ):
        read_points(tmp_path / "none.csv")


@pytest.mark.shared
@pytest.mark.skipif(not SHARED.is_dir(), reason="no real lists: set PLANFIT_SHARED to their folder")
def test_lists_of_another_program_are_refused_with_what_is_expected():
    """OpenDroneMap's lists of ground control hold points and marks in one, below the name of the grid."""
    paths = sorted((SHARED / "real_files" / "survey_control" / "odm").glob("*.txt"))
    assert paths
    for path in paths:
        with pytest.raises(OptionError, match=r"expected (id,x,y,z\[,sigma\]|a number)"):
            read_points(path)
