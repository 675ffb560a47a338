"""Readers against files that nobody thought of: what is written is read back, any text is read or refused.

A file that is refused is told in one line that begins with its name; what is read is finite.
"""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from ezdxf.filemanagement import new as new_dxf
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from planfit.corrections.file import corrections_of, to_toml
from planfit.errors import PlanfitError
from planfit.floorplan import read_floorplan
from planfit.geometry.camera import Camera
from planfit.scan import scan_from_arrays
from planfit.scan.lens_file import FORMAT, VERSION, take_calibration
from planfit.scan.pose_files import parse_poses
from planfit.survey.read import read_marks, read_points

THOROUGH = settings(
    max_examples=150,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
"""The same examples on every run."""
POSES = Path("poses.txt")
OFTEN = (
    "0", "1", "-0.5", "1e3", "nan", "inf", "-inf", "1e999", "0x1F", "1,5", "١٢", "", "#", "a", '"q"',
)  # fmt: skip
KINDS = ("place", "add_loop", "delete_loop", "exclude_frames", "draw_wall", "planfit_corrections")
KEYS = ("frame", "pixel", "scan", "plan", "frames", "pixels", "ends", "note")

coordinate = st.floats(-1e5, 1e5, allow_nan=False).map(lambda value: round(value, 6))
pair = st.lists(coordinate, min_size=2, max_size=2)
frame = st.integers(0, 5000)
frame_range = st.lists(frame, min_size=2, max_size=2).map(sorted)
cell = st.one_of(
    st.sampled_from(OFTEN),
    st.floats().map(repr),
    st.integers().map(str),
    st.text(max_size=8),
    st.integers(300, 5000).map(lambda n: "9" * n),
)
json_value = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=6),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=6), inner, max_size=4)
    ),
    max_leaves=12,
)


@st.composite
def tables(draw):
    """Lines of cells, most of them of one length, parted as files do or do not."""
    part = draw(st.sampled_from([" ", ",", ";", "\t", ", "]))
    width = draw(st.integers(1, 13))
    rows = draw(
        st.lists(
            st.one_of(st.lists(cell, min_size=width, max_size=width), st.lists(cell, max_size=14)),
            max_size=11,
        )
    )
    end = draw(st.sampled_from(["\n", "\r\n", "\r", ""]))
    header = draw(
        st.sampled_from(["", "id,x,y,z\n", "frame,u,v,id\n", "#timestamp [ns],p_x,p_y\n"])
    )
    return header + end.join(part.join(row) for row in rows)


@st.composite
def trajectories(draw):
    """Times (ns) that ascend, and poses."""
    n = draw(st.integers(1, 6))
    vectors = st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3)
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(
        draw(st.lists(vectors, min_size=n, max_size=n))
    ).as_matrix()
    places = st.lists(coordinate, min_size=3, max_size=3)
    poses[:, :3, 3] = draw(st.lists(places, min_size=n, max_size=n))
    begin = draw(st.sampled_from([0, 1_650_000_000]))
    # Whole nanoseconds, and apart by more than the last digit of a float of that size.
    steps = draw(st.lists(st.integers(10**6, 10**11), min_size=n, max_size=n))
    return begin * 10**9 + np.cumsum(steps), poses


def refused_in_one_line(error: PlanfitError, name: str) -> None:
    assert str(error).startswith(name)
    assert "\n" not in str(error)


@pytest.mark.parametrize("kind", ["tum", "euroc", "kitti", "log"])
@given(trajectory=trajectories(), comment=st.sampled_from(["", "# of a tracker\n"]))
@THOROUGH
def test_poses_are_read_back_as_they_were_written(kind, trajectory, comment):
    ns, poses = trajectory
    lines = []
    for k, (time, pose) in enumerate(zip(ns.tolist(), poses, strict=True)):
        x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat().tolist()
        at = " ".join(f"{value:.6f}" for value in pose[:3, 3])
        matrix = [" ".join(map(repr, row)) for row in pose.tolist()]
        lines += {
            "tum": [f"{time // 10**9}.{time % 10**9:09d} {at} {x!r} {y!r} {z!r} {w!r}"],
            "euroc": [f"{time},{at.replace(' ', ',')},{w!r},{x!r},{y!r},{z!r},0,0,0"],
            "kitti": [" ".join(matrix[:3])],
            "log": [f"{k} {k} {k + 1}", *matrix],
        }[kind]
    if kind == "euroc" and len(str(ns[0])) <= 15:
        return  # seconds after the start of a recording are no time of a EuRoC file
    found = parse_poses(comment * (kind != "log") + "\n".join(lines) + "\n", POSES)
    assert found.kind == ("tum" if kind == "euroc" else kind)
    assert_allclose(found.poses, poses, atol=2e-6)
    if kind in ("tum", "euroc"):
        assert_allclose(found.keys, ns / 1e9, rtol=1e-15, atol=1e-6)


@given(text=st.one_of(tables(), st.text(max_size=200)))
@THOROUGH
def test_any_text_is_a_file_of_poses_or_refused(text):
    try:
        found = parse_poses(text, POSES)
    except PlanfitError as error:
        refused_in_one_line(error, "poses.txt")
        return
    assert len(found.keys) == len(found.poses) > 0
    assert np.isfinite(found.poses[:, :3, :3]).all()


@given(text=st.one_of(tables(), st.text(max_size=200)))
@example(text="0 0 0 0")  # a mark in the first frame, and a point
@example(text="9" * 5000 + ",1,1,a")
@example(text="a,1e200,1,1")
@THOROUGH
def test_any_text_is_a_table_of_points_or_refused(text, tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(text, encoding="utf-8")
    try:
        points = read_points(path)
    except PlanfitError as error:
        refused_in_one_line(error, str(path))
    else:
        assert np.isfinite([point.xyz[:2] for point in points]).all()
    try:
        marks = read_marks(path, ["0", "1", "left"])
    except PlanfitError as error:
        refused_in_one_line(error, str(path))
    else:
        assert all(0 <= mark.frame_idx < 3 for mark in marks)


def tables_of(**values):
    """Up to two tables with these keys, and a note or none."""
    return st.lists(
        st.fixed_dictionaries(
            values, optional={"note": st.text("aZ9 ä会é[]{}#=,.'\"\\", max_size=12)}
        ),
        max_size=2,
    )


frames = st.one_of(frame, frame_range)
wall = pair.map(lambda end: [list(end), [end[0] + 1.0, end[1]]])
two_frames = frame.flatmap(lambda first: st.sampled_from([[first, first + 1], [first + 9, first]]))


@given(
    content=st.fixed_dictionaries(
        {
            "place": st.one_of(
                tables_of(frame=frame, pixel=pair, plan=pair),
                tables_of(scan=st.lists(coordinate, min_size=3, max_size=3), plan_file=pair),
            ),
            "add_loop": st.one_of(
                tables_of(frames=two_frames),
                tables_of(frames=two_frames, pixels=st.lists(pair, min_size=2, max_size=2)),
            ),
            "delete_loop": tables_of(frames=st.lists(frames, min_size=2, max_size=2)),
            "exclude_frames": tables_of(frames=st.lists(frames, min_size=1, max_size=3)),
            "exclude_wall": tables_of(ends=wall),
            "erase_wall": tables_of(ends=wall),
            "draw_wall": tables_of(ends=wall),
        }
    )
)
@THOROUGH
def test_corrections_are_read_back_as_they_were_written(content):
    made = corrections_of(content, "corrections.toml")
    assert len(made) == sum(map(len, content.values()))
    assert corrections_of(tomllib.loads(to_toml(made)), made.name) == made


@given(
    content=st.dictionaries(
        st.sampled_from(KINDS),
        json_value
        | st.lists(
            st.dictionaries(st.sampled_from(KEYS), json_value),
            max_size=3,
        ),
    )
)
@THOROUGH
def test_any_values_are_corrections_or_refused(content):
    try:
        found = corrections_of(content, "corrections.toml")
    except PlanfitError as error:
        refused_in_one_line(error, "corrections.toml")
    else:
        assert corrections_of(tomllib.loads(to_toml(found)), found.name) == found


@given(
    parameters=json_value
    | st.dictionaries(st.sampled_from(["depth_scale", "focal", "clock_s"]), json_value),
    camera=json_value | st.fixed_dictionaries({"width": json_value, "fx": json_value}),
)
@THOROUGH
def test_any_values_are_a_calibration_or_refused(parameters, camera, tmp_path):
    path = tmp_path / "device.json"
    content = {"format": FORMAT, "version": VERSION, "parameters": parameters}
    path.write_text(json.dumps({**content, "camera": camera}))
    depth, lens = np.ones((2, 12, 16), dtype=np.float32), Camera(16, 12, 20.0, 20.0, 7.5, 5.5)
    scan = scan_from_arrays(None, depth, lens, np.tile(np.eye(4), (2, 1, 1)))
    with pytest.raises(PlanfitError) as refused:
        take_calibration(scan, path)  # its parameters never are all there
    refused_in_one_line(refused.value, str(path))


@given(
    geometry=st.sampled_from(
        ["LineString", "MultiLineString", "Polygon", "MultiPolygon", "Point", "", None]
    ),
    coordinates=json_value
    | st.lists(st.lists(pair, max_size=5), max_size=3)
    | st.lists(pair, max_size=5),
)
@THOROUGH
def test_any_values_are_a_geojson_plan_or_refused(geometry, coordinates, tmp_path):
    path = tmp_path / "plan.geojson"
    feature = {"type": "Feature", "geometry": {"type": geometry, "coordinates": coordinates}}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    try:
        plan = read_floorplan(path)
    except PlanfitError as error:
        refused_in_one_line(error, str(path))
    else:
        assert np.isfinite(plan.ends).all()
        assert_allclose(np.linalg.norm(plan.normals, axis=1), 1.0)


@given(
    sides=st.tuples(st.floats(3.0, 60.0), st.floats(3.0, 60.0)),
    thickness=st.floats(0.08, 0.45),
    yaw_deg=st.floats(-180.0, 180.0),
    offset=pair,
    unit=st.sampled_from([(6, 1.0), (4, 1e-3), (2, 0.3048)]),
)
@settings(THOROUGH, max_examples=40)
def test_a_room_is_read_wherever_it_lies_and_whatever_its_unit(
    sides, thickness, yaw_deg, offset, unit, tmp_path
):
    number, metres = unit
    outer = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * sides
    inner = np.clip(outer, thickness, np.subtract(sides, thickness))
    turn = Rotation.from_euler("z", yaw_deg, degrees=True).as_matrix()[:2, :2]
    document = new_dxf()
    document.header["$INSUNITS"] = number
    for ring in (outer, inner):
        corners = (ring @ turn.T + offset) / metres
        document.modelspace().add_lwpolyline(corners.tolist(), close=True)
    document.saveas(tmp_path / "plan.dxf")
    plan = read_floorplan(tmp_path / "plan.dxf")
    found = np.linalg.norm(plan.ends[:, 1] - plan.ends[:, 0], axis=1).sum()
    assert found == pytest.approx(4 * sum(sides) - 8 * thickness, rel=2e-3)
    assert len(plan) == 8
    assert plan.is_oriented.all()
    assert_allclose(plan.thickness, thickness, rtol=0.02)
    # Faces look away from the wall: four to the room, four out of the building.
    free = plan.ends.mean(axis=1) + 0.5 * thickness * plan.normals
    in_file = np.column_stack([free, np.ones(len(free))]) @ plan.source.file_from_plan.T
    x, y = ((in_file[:, :2] * metres - offset) @ turn).T
    width, height = sides
    in_room = (x > thickness) & (x < width - thickness) & (y > thickness) & (y < height - thickness)
    outside = (x < 0) | (x > width) | (y < 0) | (y > height)
    assert in_room.sum() == outside.sum() == 4
