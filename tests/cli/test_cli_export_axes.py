"""`planfit export --frame file|map`: what is written lies where the plan's own file and its map have it."""

import json
from pathlib import Path

import ifcopenshell
import ifcopenshell.util.geolocation as geolocation
import numpy as np
import pytest
import shapely
import trimesh
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from plan_files import make_plan, write_geojson, write_ifc, write_png, write_svg
from planfit.cli import run
from planfit.export.poses import file_axes, map_axes
from planfit.floorplan import read_floorplan
from planfit.scan import read_scan, read_tum
from planfit.scan.pose_files import read_poses

ELEVATION_M = 3.2
WALLS, _ = make_plan(n_rooms=2)


def put_on_map(path: Path, scale: float, metres: float = 1.0) -> ifcopenshell.file:
    """Give a model a place in Swiss coordinates, `metres` a unit of the map."""
    model = ifcopenshell.open(str(path))
    crs = model.create_entity("IfcProjectedCRS", Name="EPSG:2056")
    (context,) = model.by_type("IfcGeometricRepresentationContext")
    origin = [v / metres for v in (2_683_412.345, 1_247_889.678, 432.1)]
    model.create_entity(
        "IfcMapConversion", context, crs, *origin, XAxisAbscissa=0.8, XAxisOrdinate=0.6, Scale=scale
    )
    model.write(str(path))
    return model


@pytest.mark.parametrize(
    ("prefix", "scale", "metres"),
    [(None, 1.0, 1.0), (None, 0.9996, 1.0), ("MILLI", 0.001, 1.0), ("MILLI", 1.0, 0.001)],
)
def test_a_model_lies_on_its_map_as_ifcopenshell_has_it(prefix, scale, metres, tmp_path) -> None:
    path = write_ifc(tmp_path / "a.ifc", WALLS, prefix, storeys=(("Ground", ELEVATION_M),))
    model = put_on_map(path, scale, metres)
    units_a_metre = 1000.0 if prefix else 1.0
    source = read_floorplan(path).source
    points = np.random.default_rng(0).uniform(-30, 30, (20, 3))
    in_file = (points + np.array([0, 0, ELEVATION_M])) * units_a_metre
    on_map = [np.array(geolocation.auto_xyz2enh(model, *xyz)) * metres for xyz in in_file]
    assert_allclose(file_axes(source).points(points), in_file, rtol=0, atol=1e-9)
    assert_allclose(map_axes(source).points(points), on_map, rtol=0, atol=1e-6)


def test_axes_of_pictures_drawings_and_degrees(tmp_path: Path) -> None:
    """Where y of a file runs down, z does, so that a pose stays one; degrees are no lengths."""
    svg = read_floorplan(write_svg(tmp_path / "a.svg", WALLS, units_per_metre=20.0))
    axes = file_axes(svg.scaled(0.05).source)
    assert axes.metres_per_unit == pytest.approx(0.05)
    assert axes.words == "lengths in 0.05 m, z down"
    turned = axes.poses(np.eye(4)[None])[0]
    assert_allclose(turned[:3, :3], np.diag([1.0, -1.0, -1.0]), atol=1e-12)
    assert map_axes(svg.source) is None
    png = write_png(tmp_path / "b.png", WALLS)
    png.with_suffix(".pgw").write_text("0.02\n0\n0\n-0.02\n2683000.01\n1247999.99\n")
    plan = read_floorplan(png)
    xyz = np.array([[1.0, 2.0, 0.5], [7.0, 3.0, 2.0]])
    pixels = file_axes(plan.source).points(xyz)
    on_map = np.column_stack([2683000.01 + 0.02 * pixels[:, 0], 1247999.99 - 0.02 * pixels[:, 1],
                              [0.5, 2.0]])  # fmt: skip
    assert_allclose(map_axes(plan.source).points(xyz), on_map, rtol=0, atol=1e-6)
    degrees = read_floorplan(write_geojson(tmp_path / "c.geojson", WALLS)).source
    assert file_axes(degrees) is None
    assert map_axes(degrees) is None


@pytest.fixture(scope="module")
def model(small_scan: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The scan's own plan as a model in millimetres, on a map."""
    plan = read_floorplan(small_scan / "floorplan.npy")
    behind = plan.ends - 0.06 * plan.normals[:, None]
    walls = shapely.polygons(np.concatenate([plan.ends, behind[:, ::-1]], axis=1))
    area = (
        shapely.union_all(walls).buffer(0.02, join_style="mitre").buffer(-0.02, join_style="mitre")
    )
    path = tmp_path_factory.mktemp("model") / "house.ifc"
    write_ifc(path, area, "MILLI", storeys=(("Ground", ELEVATION_M),))
    put_on_map(path, 0.001)
    return path


@pytest.fixture(scope="module")
def finished(small_scan: Path, model: Path, brief: list[str], tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("axes") / "out"
    assert run(["refine", str(small_scan), str(model), "-o", str(out), *brief]) in (0, 1)
    return out


def exported(finished: Path, to: str, frame: str, path: Path) -> Path:
    assert run(["export", str(finished), "--to", to, "--frame", frame, "-o", str(path)]) == 0
    return path


def moved_by_ifcopenshell(model: Path, points_plan: np.ndarray, frame: str) -> np.ndarray:
    in_file = (points_plan + np.array([0, 0, ELEVATION_M])) * 1000.0
    if frame == "file":
        return in_file
    opened = ifcopenshell.open(str(model))
    return np.array([geolocation.auto_xyz2enh(opened, *xyz) for xyz in in_file])


@pytest.mark.parametrize("frame", ["file", "map"])
def test_poses_and_points_of_a_run(
    frame, finished: Path, model: Path, tmp_path: Path, capsys
) -> None:
    _, plan_from_cams = read_tum(finished / "trajectory.tum")
    expected = moved_by_ifcopenshell(model, plan_from_cams[:, :3, 3], frame)
    turn = Rotation.from_euler("z", 0.0 if frame == "file" else np.arctan2(0.6, 0.8)).as_matrix()
    for to in ("tum", "kitti"):
        poses = read_poses(exported(finished, to, frame, tmp_path / to)).poses
        assert_allclose(poses[:, :3, 3], expected, rtol=0, atol=1e-6)
        assert_allclose(poses[:, :3, :3], turn @ plan_from_cams[:, :3, :3], atol=1e-6)
    told = " ".join(capsys.readouterr().out.split())
    assert f"{frame} axes" in told
    assert ("lengths in 0.001 m" in told) == (frame == "file")
    before = trimesh.load(exported(finished, "ply", "plan", tmp_path / "plan.ply"))
    after = trimesh.load(exported(finished, "ply", frame, tmp_path / f"{frame}.ply"))
    some = slice(None, None, 997)
    expected = moved_by_ifcopenshell(model, np.asarray(before.vertices[some]), frame)
    unit = 1000.0 if frame == "file" else 1.0
    assert_allclose(after.vertices[some], expected, rtol=0, atol=2e-6 * unit)  # floats of the plan


def test_a_mesh_on_the_map(finished: Path, model: Path, tmp_path: Path) -> None:
    pytest.importorskip("open3d", reason="Open3D is not installed", exc_type=ImportError)
    meshes = [
        trimesh.load(exported(finished, "mesh", frame, tmp_path / f"{frame}.ply"))
        for frame in ("plan", "map")
    ]
    expected = moved_by_ifcopenshell(model, np.asarray(meshes[0].vertices[::997]), "map")
    assert_allclose(meshes[1].vertices[::997], expected, rtol=0, atol=2e-6)


def test_a_data_set_on_the_map(finished: Path, model: Path, tmp_path: Path, capsys) -> None:
    """Depth stays in metres: on the map, whose unit is one, but not in the millimetres of the file."""
    folder = exported(finished, "nerfstudio", "map", tmp_path / "set")
    _, plan_from_cams = read_tum(finished / "trajectory.tum")
    expected = moved_by_ifcopenshell(model, plan_from_cams[:, :3, 3], "map")
    assert_allclose(read_scan(folder).world_from_cams[:, :3, 3], expected, rtol=0, atol=1e-6)
    words = ["export", str(finished), "--to", "colmap", "--frame", "file", "-o"]
    assert run([*words, str(tmp_path / "model")]) == 2
    assert "expected axes in metres for colmap, found lengths in 0.001 m" in capsys.readouterr().err


def test_a_plan_without_such_axes(finished: Path, small_scan: Path, tmp_path: Path, capsys) -> None:
    copy = tmp_path / "out"
    copy.mkdir()
    for name in ("run.json", "trajectory.tum"):
        (copy / name).write_bytes((finished / name).read_bytes())
    record = json.loads((copy / "run.json").read_text())
    assert_allclose(np.array(record["file_from_plan"])[2, 3], ELEVATION_M * 1000)
    record["map_from_plan"] = None
    (copy / "run.json").write_text(json.dumps(record))
    words = ["--to", "tum", "--frame", "map", "-o", str(tmp_path / "p.tum")]
    assert run(["export", str(copy), *words]) == 2
    assert "a map conversion or a world file" in capsys.readouterr().err
    assert run(["export", str(small_scan), *words]) == 2
    assert "expected the output folder of planfit refine for --frame map" in capsys.readouterr().err
