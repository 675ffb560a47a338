"""Reading plans: both formats there and back, and what is wrong with a file."""

import json
import pickle

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from builders import room_plan
from planfit.errors import FloorplanError
from planfit.floorplan import (
    Floorplan,
    PlanOptions,
    read_floorplan,
    write_floorplan_json,
)

ROOM = np.array([[0, 0, 6, 0], [6, 0, 6, 4], [6, 4, 0, 4], [0, 4, 0, 0]], dtype=float)


def saved(path, values):
    np.save(path, values)
    return path


def refused(path, *words):
    with pytest.raises(FloorplanError) as caught:
        read_floorplan(path)
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    for word in words:
        assert word in message


def test_npy_points_are_u_and_minus_v(tmp_path):
    plan = read_floorplan(saved(tmp_path / "plan.npy", ROOM))
    assert_array_equal(plan.ends[1], [[6, 0], [6, -4]])
    assert len(plan) == 4
    assert plan.size == (6.0, 4.0)
    assert not plan.is_oriented.any()
    assert_allclose(plan.lengths, [6, 4, 6, 4])


def test_integers_are_fine(tmp_path):
    plan = read_floorplan(saved(tmp_path / "plan.npy", ROOM.astype(np.int32)))
    assert plan.ends.dtype == float


def test_segments_without_length_are_left_out(tmp_path):
    values = np.vstack([ROOM, [[1, 1, 1, 1]]])
    assert len(read_floorplan(saved(tmp_path / "plan.npy", values))) == 4


def test_the_fingerprint_changes_with_the_file(tmp_path):
    one = read_floorplan(saved(tmp_path / "plan.npy", ROOM)).fingerprint
    two = read_floorplan(saved(tmp_path / "plan.npy", ROOM + 1)).fingerprint
    assert one
    assert one != two


def test_missing(tmp_path):
    refused(tmp_path / "plan.npy", "nothing")


@pytest.mark.parametrize("name", ["plan.docx", "plan"])
def test_another_suffix(tmp_path, name):
    (tmp_path / name).write_bytes(b"x")
    refused(tmp_path / name, ".npy, .json")


@pytest.mark.parametrize("values", [np.zeros((0, 4)), np.tile([1.0, 2, 1, 2], (3, 1))])
def test_no_walls(tmp_path, values):
    refused(saved(tmp_path / "plan.npy", values), "none")


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_not_finite(tmp_path, bad):
    values = ROOM.copy()
    values[2, 1] = bad
    refused(saved(tmp_path / "plan.npy", values), "finite")


@pytest.mark.parametrize("shape", [(4, 2, 2), (16,), (8, 2), ()])
def test_wrong_shape(tmp_path, shape):
    refused(saved(tmp_path / "plan.npy", np.resize(ROOM, shape)), "(n, 4)")


@pytest.mark.parametrize("dtype", [complex, "U8", bool])
def test_wrong_kind_of_numbers(tmp_path, dtype):
    refused(saved(tmp_path / "plan.npy", ROOM.astype(dtype)), "finite")


@pytest.mark.parametrize("factor", [0.01, 1000.0])
def test_wrong_unit(tmp_path, factor):
    refused(saved(tmp_path / "plan.npy", ROOM * factor), "metres")


class Bomb:
    def __reduce__(self):
        return (exec, ("raise SystemExit('pickle was run')",))


def test_pickles_are_refused_and_not_run(tmp_path):
    array = np.array([[Bomb()] * 4], dtype=object)
    np.save(tmp_path / "plan.npy", array, allow_pickle=True)
    refused(tmp_path / "plan.npy")
    (tmp_path / "bare.npy").write_bytes(pickle.dumps(Bomb()))
    refused(tmp_path / "bare.npy")


def test_files_that_are_no_array(tmp_path):
    whole = saved(tmp_path / "whole.npy", ROOM).read_bytes()
    for data in (b"", b"garbage", b"PK\x03\x04garbage", whole[:40], whole[:-10]):
        (tmp_path / "plan.npy").write_bytes(data)
        refused(tmp_path / "plan.npy", "NumPy array")


def test_an_archive_of_arrays(tmp_path):
    np.savez(tmp_path / "plan.npz", a=ROOM)
    (tmp_path / "plan.npz").rename(tmp_path / "plan.npy")
    refused(tmp_path / "plan.npy", "archive")


@pytest.mark.parametrize("name", ["plan.npy", "plan.json"])
def test_a_folder_of_that_name(tmp_path, name):
    (tmp_path / name).mkdir()
    refused(tmp_path / name)


# planfit's own form.


def test_json_round_trip_is_lossless(tmp_path, rng):
    ends = rng.uniform(-20, 20, (12, 2, 2))
    ends[6:] = ends[:6] + 0.1 / 3  # some get a partner and so a free side
    made = Floorplan.from_segments(ends, name="made")
    assert made.is_oriented.any()
    assert not made.is_oriented.all()
    write_floorplan_json(tmp_path / "plan.json", made)
    back = read_floorplan(tmp_path / "plan.json")
    assert_array_equal(back.ends, made.ends)
    assert_array_equal(back.normals, made.normals)
    assert_array_equal(back.is_oriented, made.is_oriented)
    write_floorplan_json(tmp_path / "again.json", back)
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "plan.json").read_bytes()


def face(**changes):
    return {"ends": [[0, 0], [6, 0]], "normal": [0, 1]} | changes


def plan_json(path, faces, **changes):
    path.write_text(json.dumps({"planfit_floorplan": 1, "unit": "m", "faces": faces} | changes))
    return path


def test_json_by_hand(tmp_path):
    faces = [face(), face(ends=[[0, 4], [6, 4]], normal=None), {"ends": [[0, 0], [0, 4]]}]
    plan = read_floorplan(plan_json(tmp_path / "plan.json", faces))
    assert_array_equal(plan.is_oriented, [True, False, False])
    assert_array_equal(plan.normals[0], [0, 1])
    assert_array_equal(plan.offsets[:2], [0, 4])


@pytest.mark.parametrize("text", [
    "", "{", "[]", "null", "3", "{}", '{"faces": []}', '{"unit": "m"}', "\xff",
    '{"unit": "m", "faces": 3}', '{"unit": "m", "faces": [3]}', '{"unit": "m", "faces": [{}]}',
])  # fmt: skip
def test_json_that_is_no_plan(tmp_path, text):
    (tmp_path / "plan.json").write_bytes(text.encode("latin-1"))
    is_object = text in ("{}", '{"unit": "m"}')
    refused(tmp_path / "plan.json", "another program" if is_object else "a plan as JSON")


@pytest.mark.parametrize("faces", [
    [face(ends=[[0, 0]])], [face(ends=[[0, 0, 0], [1, 1, 1]])], [face(ends="ab")],
    [face(ends=[[0, "x"], [1, 1]])], [face(), face(ends=[[0, 0], [1, 1], [2, 2]])],
    [face(normal="up")], [face(normal=[0, 1, 0])], [face(normal=[0, "y"])],
])  # fmt: skip
def test_json_faces_of_the_wrong_form(tmp_path, faces):
    refused(plan_json(tmp_path / "plan.json", faces), "expected")


@pytest.mark.parametrize("normal", [[0, 2], [1, 0], [0.6, 0.8], [0, 0], [float("nan"), 1],
                                    [float("inf"), 1], [5, 1]])  # fmt: skip
def test_json_normals_that_are_none(tmp_path, normal):
    refused(plan_json(tmp_path / "plan.json", [face(normal=normal)]), "normal")


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_json_coordinates_that_are_not_finite(tmp_path, bad):
    refused(plan_json(tmp_path / "plan.json", [face(ends=[[0, 0], [bad, 0]])]), "finite")


def test_json_without_walls_or_with_a_point(tmp_path):
    refused(plan_json(tmp_path / "plan.json", []), "0 faces")
    refused(plan_json(tmp_path / "plan.json", [face(), face(ends=[[1, 1], [1, 1]])]), "length")


def test_json_in_another_unit(tmp_path):
    refused(plan_json(tmp_path / "plan.json", [face()], unit="mm"), "'mm'")


# The type itself.


def test_offsets_are_the_lines_of_the_faces():
    plan = room_plan()
    for i in range(2):
        assert_allclose(np.sum(plan.normals * plan.ends[:, i], axis=1), plan.offsets)


@pytest.mark.parametrize("change", [
    {"ends": np.zeros((0, 2, 2))}, {"ends": np.zeros((4, 2))}, {"normals": np.zeros((3, 2))},
    {"ends": np.full((4, 2, 2), np.nan)},
])  # fmt: skip
def test_a_plan_checks_itself(change):
    plan = room_plan()
    fields = {"name": "made up", "ends": plan.ends, "normals": plan.normals,
              "is_oriented": plan.is_oriented} | change  # fmt: skip
    with pytest.raises(FloorplanError, match="made up"):
        Floorplan(**fields)


# Units.


@pytest.mark.parametrize(("unit", "metres"), [("mm", 0.001), ("cm", 0.01), ("ft", 0.3048)])
def test_a_given_unit_scales(tmp_path, unit, metres):
    path = saved(tmp_path / "plan.npy", ROOM / metres)
    assert_allclose(read_floorplan(path, PlanOptions(unit=unit)).size, (6.0, 4.0))
    plan = read_floorplan(path, PlanOptions(unit="m", metres_per_unit=metres))
    assert_allclose(plan.size, (6.0, 4.0))
    assert plan.is_metric
    assert plan.source.unit_from == "--scale"


@pytest.mark.parametrize("factor", [0.01, 1.0, 1e4])
def test_an_unknown_unit_is_not_questioned(tmp_path, factor):
    double = np.vstack([ROOM, [[-0.2, -0.2, 6.2, -0.2], [6.2, -0.2, 6.2, 4.2],
                               [6.2, 4.2, -0.2, 4.2], [-0.2, 4.2, -0.2, -0.2]]])  # fmt: skip
    path = saved(tmp_path / "plan.npy", double * factor)
    plan = read_floorplan(path, PlanOptions(unit="unknown"))
    assert not plan.is_metric
    assert_allclose(plan.size, (6.4 * factor, 4.4 * factor))
    # Which side is free does not hang on the unit either.
    metric = Floorplan.from_segments(double.reshape(-1, 2, 2) * (1.0, -1.0), name="metric")
    assert_array_equal(plan.is_oriented, metric.is_oriented)
    assert_allclose(plan.normals, metric.normals, atol=1e-12)


def test_single_lines_of_unknown_unit_have_no_free_side(tmp_path):
    plan = read_floorplan(saved(tmp_path / "plan.npy", ROOM * 37), PlanOptions(unit="unknown"))
    assert not plan.is_oriented.any()


def test_json_keeps_thickness_openings_and_an_unknown_unit(tmp_path):
    faces = [face(thickness=0.24), face(ends=[[0, 4], [6, 4]], normal=None)]
    openings = [[[1, 0], [2, 0]]]
    path = plan_json(tmp_path / "plan.json", faces, unit="unknown", openings=openings)
    plan = read_floorplan(path)
    assert not plan.is_metric
    assert_array_equal(plan.thickness, [0.24, np.nan])
    assert_array_equal(plan.openings, openings)
    write_floorplan_json(tmp_path / "again.json", plan)
    again = read_floorplan(tmp_path / "again.json")
    assert_array_equal(again.thickness, plan.thickness)
    assert_array_equal(again.openings, plan.openings)
    assert again.is_metric == plan.is_metric
    assert read_floorplan(path, PlanOptions(metres_per_unit=2.0)).size[0] == 12.0


@pytest.mark.parametrize("change", [{"thickness": 0}, {"thickness": -1}])
def test_json_thickness_that_is_none(tmp_path, change):
    refused(plan_json(tmp_path / "plan.json", [face(**change)]), "thickness")


# Segments in memory.


def test_segments_in_memory_are_a_plan():
    ends = [[[0, 0], [6, 0]], [[0, 0.2], [6, 0.2]], [[6, 0], [0, 0]], [[1, 1], [1, 1]]]
    plan = Floorplan.from_segments(ends)
    assert_array_equal(plan.ends, np.array(ends[:2], dtype=float))  # once each, no points
    assert_allclose(plan.normals, [[0, -1], [0, 1]], atol=1e-12)  # away from each other
    assert plan.is_oriented.all()
    assert plan.is_metric
    assert plan.fingerprint == Floorplan.from_segments(ends).fingerprint
    moved = Floorplan.from_segments(np.array(ends) + 1.0)
    assert moved.fingerprint != plan.fingerprint


@pytest.mark.parametrize("length", [0.0, 9e-16])
def test_a_face_without_length_is_no_face(length):
    ends = np.array([[[0.0, 0.0], [5.0, 0.0]], [[1.0, 2.0], [1.0 + length, 2.0]]])
    with pytest.raises(FloorplanError, match="expected faces with a length"):
        Floorplan("made", ends, np.array([[0.0, 1.0], [0.0, 1.0]]), np.ones(2, dtype=bool))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"type": "CityJSON", "CityObjects": {"a": {}, "b": {}}}, "a CityJSON model of 2 objects"),
        ({"type": "FeatureCollection", "features": []}, "found GeoJSON; rename it to .geojson"),
    ],
)
def test_json_of_another_kind_is_named(tmp_path, content, words):
    path = tmp_path / "model.json"
    path.write_text(json.dumps(content))
    with pytest.raises(FloorplanError, match=words):
        read_floorplan(path)


def test_normals_in_memory_tell_the_free_side():
    ends = [[[0, 0], [6, 0]], [[0, 0.2], [6, 0.2]], [[0, 5], [6, 5]]]
    plan = Floorplan.from_segments(ends, [[0, 2.0], [0, -0.1], [np.nan, np.nan]])
    assert_allclose(plan.normals[:2], [[0, 1], [0, -1]], atol=1e-12)  # of length 1, as given
    assert_array_equal(plan.is_oriented, [True, True, False])


def test_segments_of_an_unknown_unit_keep_it():
    room = ROOM.reshape(-1, 2, 2)
    outside = room + 0.2 * np.sign(room - [3, 2])
    ends = 77.0 * np.concatenate([room, outside])
    plan = Floorplan.from_segments(ends, is_metric=False)
    assert not plan.is_metric
    assert_array_equal(plan.ends, ends)
    assert plan.is_oriented.all()


@pytest.mark.parametrize(
    ("ends", "normals", "words"),
    [
        ([[0, 0, 6, 0]], None, ("(n, 2, 2)", "(1, 4)")),
        (np.zeros((3, 2, 3)), None, ("(n, 2, 2)", "(3, 2, 3)")),
        ([[["a", 0], [6, 0]]], None, ("numbers",)),
        ([[[0, 0], [6]]], None, ("numbers",)),
        ([[[0, np.nan], [6, 0]]], None, ("finite", "NaN")),
        ([], None, ("wall segments", "none")),
        ([[[1, 1], [1, 1]]], None, ("wall segments", "none")),
        ([[[0, 0], [6, 0]]], [[0, 1], [0, 1]], ("each of 1 segments", "(2, 2)")),
        ([[[0, 0], [6, 0]]], [[0, 0]], ("with a length", "0")),
        ([[[0, 0], [6, 0]]], [[1, 1]], ("right angles", "45 deg")),
    ],
)
def test_segments_in_memory_that_are_none_say_what_was_found(ends, normals, words):
    with pytest.raises(FloorplanError) as caught:
        Floorplan.from_segments(ends, normals, name="my plan")
    message = str(caught.value)
    assert message.startswith("my plan: expected ")
    for word in words:
        assert word in message
