"""`planfit export`: what is written is what a run found, read back by readers of the forms."""

import csv
import json
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from planfit.cli import run
from planfit.evaluation import position_errors
from planfit.floorplan import read_floorplan
from planfit.floorplan.nearest_faces import nearest_distance
from planfit.scan import ScanOptions, read_scan, read_tum
from planfit.scan.pose_files import read_poses


@pytest.fixture(scope="module")
def finished(small_scan: Path, brief: list[str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of a scan with the poses of another tracker: truth without two frames, in other axes."""
    folder = tmp_path_factory.mktemp("export")
    lines = (small_scan / "groundtruth.tum").read_text().splitlines()
    (folder / "poses.tum").write_text("\n".join([*lines[:20], *lines[22:]]) + "\n")
    words = ["refine", str(small_scan), "-o", str(folder / "out"), *brief]
    assert run([*words, "--poses", str(folder / "poses.tum")]) in (0, 1)
    return folder / "out"


@pytest.fixture(scope="module")
def refined(finished: Path) -> np.ndarray:
    return np.stack([np.loadtxt(p) for p in sorted((finished / "poses").iterdir())])


def test_another_trackers_poses_are_refined(finished: Path, small_scan: Path, refined) -> None:
    record = json.loads((finished / "run.json").read_text())
    assert record["frames"] == 58
    assert record["frames_left_out"] == [
        "frame 0021: poses.tum has no pose",
        "frame 0022: poses.tum has no pose",
    ]
    assert record["up_from"] != "recorded by the scan's format"
    names = {p.name for p in (finished / "poses").iterdir()}
    assert "pose-0020.txt" in names
    assert "pose-0021.txt" not in names
    _, truth = read_tum(small_scan / "groundtruth.tum")
    kept = [i for i in range(60) if i not in (20, 21)]
    # They were true before: they must stay so, up to the rigid motion onto the plan.
    assert position_errors(refined, truth[kept]).aligned_rms_m < 0.03


@pytest.mark.parametrize("kind", ["tum", "kitti", "open3d"])
def test_trajectories_are_read_back(kind, finished: Path, refined, tmp_path: Path) -> None:
    path = tmp_path / ("poses.log" if kind == "open3d" else "poses.txt")
    assert run(["export", str(finished), "--to", kind, "-o", str(path)]) == 0
    table = read_poses(path)
    assert table.kind == {"tum": "tum", "kitti": "kitti", "open3d": "log"}[kind]
    assert_allclose(table.poses, refined, atol=1e-6)


def test_open3d_gets_the_suffix_it_asks_for(finished: Path, tmp_path: Path, capsys) -> None:
    assert run(["export", str(finished), "--to", "open3d", "-o", str(tmp_path / "poses")]) == 0
    assert [p.name for p in tmp_path.iterdir()] == ["poses.log"]
    assert "poses.log" in capsys.readouterr().out.replace("\n", "")
    assert run(["export", str(finished), "--to", "open3d", "-o", str(tmp_path / "poses.txt")]) == 2
    assert "expected a file of .log" in capsys.readouterr().err
    reason = "Open3D is not installed, or a library of the system that it needs"
    open3d = pytest.importorskip("open3d", reason=reason, exc_type=ImportError)
    read = open3d.io.read_pinhole_camera_trajectory(str(tmp_path / "poses.log"))
    assert len(read.parameters) == 58


def test_plan_axes(finished: Path, tmp_path: Path) -> None:
    path = tmp_path / "poses.txt"
    assert run(["export", str(finished), "--to", "kitti", "-o", str(path), "--frame", "plan"]) == 0
    _, plan_from_cams = read_tum(finished / "trajectory.tum")
    assert_allclose(read_poses(path).poses, plan_from_cams, atol=1e-6)


def loop_error(row: list[str], i_from_j: np.ndarray) -> tuple[float, float]:
    """How far the edge of a graph is from a motion: m, and in sigmas by g2o's error of its kind: translation
    and the quaternion's vector part of what is between both."""
    values = np.array(row[3:], dtype=float)
    measured = np.eye(4)
    measured[:3, :3] = Rotation.from_quat(values[3:7]).as_matrix()
    measured[:3, 3] = values[:3]
    between = np.linalg.inv(measured) @ i_from_j
    error = np.array([*between[:3, 3], *Rotation.from_matrix(between[:3, :3]).as_quat()[:3]])
    upper = np.zeros((6, 6))
    upper[np.triu_indices(6)] = values[7:]
    information = upper + upper.T - np.diag(np.diag(upper))
    metres = float(np.linalg.norm(i_from_j[:3, 3] - measured[:3, 3]))
    return metres, float(np.sqrt(error @ information @ error / 6))


def test_a_pose_graph(finished: Path, refined, tmp_path: Path) -> None:
    path = tmp_path / "graph.g2o"
    assert run(["export", str(finished), "--to", "g2o", "-o", str(path)]) == 0
    rows = [line.split() for line in path.read_text().splitlines()]
    vertices = [r for r in rows if r[0] == "VERTEX_SE3:QUAT"]
    edges = [r for r in rows if r[0] == "EDGE_SE3:QUAT"]
    assert len(vertices) == 58
    steps = [r for r in edges if int(r[2]) - int(r[1]) == 1]
    loops = [r for r in edges if int(r[2]) - int(r[1]) > 1]
    assert len(steps) == 57
    assert len(loops) > 20
    assert len(steps) + len(loops) == len(edges)
    # Each agrees with the refined poses, which all of them made, as far as it knows of the motion: sixteen
    # matches a hand wide leave a rotation open that moves the other camera by 0.1 m.
    off = [
        loop_error(row, np.linalg.inv(refined[int(row[1])]) @ refined[int(row[2])]) for row in loops
    ]
    metres, sigmas = np.array(off).T
    assert np.median(metres) < 0.02
    assert sigmas.max() < 3.0
    assert ["FIX", "0"] in rows
    assert_allclose([[float(v) for v in r[2:5]] for r in vertices], refined[:, :3, 3], atol=1e-6)
    assert all(len(r) == 3 + 7 + 21 for r in edges)
    # The library that reads such graphs agrees, and finds the recorded steps.
    gtsam = pytest.importorskip("gtsam")
    graph, values = gtsam.readG2o(str(path), True)
    assert values.size() == 58
    assert_allclose(values.atPose3(5).matrix(), refined[5], atol=1e-6)
    assert graph.size() >= 57


@pytest.mark.parametrize("kind", ["colmap", "nerfstudio"])
def test_data_sets_are_scans_again(
    kind, finished: Path, small_scan: Path, refined, tmp_path
) -> None:
    folder = tmp_path / "set"
    assert run(["export", str(finished), "--to", kind, "-o", str(folder)]) == 0
    again, before = read_scan(folder), read_scan(small_scan)
    assert again.format == kind
    assert len(again) == 58
    assert_allclose(again.world_from_cams, refined, atol=1e-6)
    assert again.cameras[0].fx == pytest.approx(before.cameras[0].fx)
    assert again.cameras[0].cx == pytest.approx(before.cameras[0].cx)
    for mine, its in ((0, 0), (19, 19), (20, 22), (57, 59)):
        assert_allclose(again.files.depth(mine), before.files.depth(its), atol=1e-6)
        gap = np.abs(again.files.color(mine).astype(int) - before.files.color(its)).mean()
        assert gap < 4
    assert not list(tmp_path.glob("*.part"))


def test_points_of_a_colmap_model_lie_where_the_cloud_does(finished: Path, tmp_path: Path) -> None:
    assert run(["export", str(finished), "--to", "colmap", "-o", str(tmp_path / "set"), "--frame",
                "plan"]) == 0  # fmt: skip
    lines = (tmp_path / "set" / "sparse" / "0" / "points3D.txt").read_text().splitlines()[1:]
    rows = [line.split() for line in lines]
    tracked = [row for row in rows if len(row) > 8]
    assert len(tracked) > 100
    assert min(len(row) for row in tracked) >= 8 + 4  # two images at least
    heights = np.array([float(row[3]) for row in rows])
    # Plan axes: the floor is at 0, and next to nothing is below it.
    assert np.mean(np.abs(heights) < 0.08) > 0.05
    assert np.mean(heights < -0.15) < 0.005


def test_pycolmap_reads_the_model(finished: Path, refined, tmp_path: Path) -> None:
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    assert run(["export", str(finished), "--to", "colmap", "-o", str(tmp_path / "set")]) == 0
    model = pycolmap.Reconstruction(str(tmp_path / "set" / "sparse" / "0"))
    assert len(model.images) == 58
    assert len(model.points3D) > 1000
    assert model.compute_num_observations() > 500
    assert model.compute_mean_reprojection_error() < 2.0
    for number in (1, 30, 58):
        cam_from_world = model.images[number].cam_from_world()
        assert_allclose(cam_from_world.matrix(), np.linalg.inv(refined[number - 1])[:3], atol=1e-6)
    # It can be refined on: observations pull the errors down, and no camera leaves its place.
    before = model.compute_mean_reprojection_error()
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.refine_focal_length = options.refine_extra_params = False
    pycolmap.bundle_adjustment(model, options)
    model.update_point_3d_errors()
    assert model.compute_mean_reprojection_error() < before


def test_a_cloud(finished: Path, tmp_path: Path) -> None:
    path = tmp_path / "cloud.ply"
    assert run(["export", str(finished), "--to", "ply", "-o", str(path)]) == 0
    cloud = trimesh.load(path)
    assert len(cloud.vertices) > 10_000


def test_a_mesh_lies_on_the_building(finished: Path, tmp_path: Path) -> None:
    reason = "Open3D is not installed (pip install planfit[map]), or a library of the system that it needs"
    pytest.importorskip("open3d", reason=reason, exc_type=ImportError)
    path = tmp_path / "mesh.ply"
    words = ["export", str(finished), "--to", "mesh", "--frame", "plan", "--voxel-m", "0.04"]
    assert run([*words, "-o", str(path)]) == 0
    mesh = trimesh.load(path)
    assert len(mesh.faces) > 5000
    assert np.ptp(mesh.visual.vertex_colors[:, :3].astype(int), axis=0).min() > 60
    # Plan axes: the floor is at 0, and next to nothing is below it.
    heights, upward = mesh.triangles_center[:, 2], mesh.face_normals[:, 2]
    floor = (np.abs(heights) < 0.06) & (upward > 0.9)
    assert mesh.area_faces[floor].sum() > 4.0
    assert mesh.area_faces[heights < -0.2].sum() < 0.01 * mesh.area
    # Upright faces are walls and what stands at them: much of them within 8 cm of a wall of the plan.
    record = json.loads((finished / "run.json").read_text())
    plan = read_floorplan(record["inputs"]["plan"])
    upright = (np.abs(upward) < 0.1) & (heights > 1.9)
    distance = nearest_distance(mesh.triangles_center[upright][:, :2], plan.ends)
    assert np.mean(distance < 0.08) > 0.8
    # Triangles look to where they were seen from: walls to the inside, the floor upwards.
    assert (
        mesh.area_faces[floor].sum()
        > 5 * mesh.area_faces[(np.abs(heights) < 0.06) & (upward < -0.9)].sum()
    )
    for suffix in (".glb", ".obj"):
        assert run([*words, "-o", str(path.with_suffix(suffix))]) == 0
        again = trimesh.load(path.with_suffix(suffix), force="mesh", process=False)
        assert len(again.faces) == len(mesh.faces)


def test_a_mesh_without_open3d_says_what_to_install(
    small_scan: Path, tmp_path: Path, capsys, monkeypatch
) -> None:
    monkeypatch.setitem(sys.modules, "open3d", None)
    words = ["export", str(small_scan), "--to", "mesh", "-o", str(tmp_path / "mesh.ply")]
    assert run(words) == 2
    message = capsys.readouterr().err
    assert message.startswith("planfit: meshes: expected the library Open3D, found none (")
    assert message.endswith("; pip install 'planfit[map]'\n")
    assert not list(tmp_path.iterdir())


def test_a_mesh_under_a_name_of_something_else(small_scan: Path, tmp_path: Path, capsys) -> None:
    words = ["export", str(small_scan), "--to", "mesh", "-o", str(tmp_path / "mesh.txt")]
    assert run(words) == 2
    assert "expected a file of .ply, .obj, .glb for a mesh, found .txt" in capsys.readouterr().err
    words = ["export", str(small_scan), "--to", "mesh", "-o", str(tmp_path / "mesh.ply")]
    assert run([*words, "--voxel-m", "0"]) == 2
    assert "voxel_m: expected a number above 0, found 0" in capsys.readouterr().err


def test_a_scan_is_exported_as_recorded(small_scan: Path, tmp_path: Path) -> None:
    path = tmp_path / "poses.tum"
    assert run(["export", str(small_scan), "--to", "tum", "-o", str(path)]) == 0
    times, poses = read_tum(path)
    scan = read_scan(small_scan)
    assert_allclose(times, scan.timestamps)
    assert_allclose(poses, scan.world_from_cams, atol=1e-7)
    # And back in place of its own.
    assert_allclose(
        read_scan(small_scan, options=ScanOptions(poses=path)).world_from_cams, poses, atol=1e-7
    )


def test_nothing_is_overwritten(finished: Path, small_scan: Path, tmp_path: Path, capsys) -> None:
    words = ["export", str(finished), "--to", "nerfstudio", "-o"]
    assert run([*words, str(small_scan)]) == 2
    assert "expected no such file or folder" in capsys.readouterr().err
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    assert run([*words, str(tmp_path / "link")]) == 2
    words = ["export", str(small_scan), "--to", "tum", "-o", str(tmp_path / "t"), "--frame", "plan"]
    assert run(words) == 2
    assert "refine it first" in capsys.readouterr().err


def test_a_scan_that_changed_since_the_run(finished: Path, tmp_path: Path, capsys) -> None:
    copy = tmp_path / "out"
    copy.mkdir()
    for name in ("run.json", "trajectory.tum"):
        (copy / name).write_bytes((finished / name).read_bytes())
    record = json.loads((copy / "run.json").read_text())
    record["scan_options"]["poses"] = None
    (copy / "run.json").write_text(json.dumps(record))
    assert run(["export", str(copy), "--to", "tum", "-o", str(tmp_path / "p.tum")]) == 2
    assert "expected the 58 frames of the run, found 60" in capsys.readouterr().err
    assert not (tmp_path / "p.tum").exists()


def test_evaluate_reads_the_scan_as_the_run_did(
    finished: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["evaluate", str(finished)]) == 0
    assert "58 frames" in capsys.readouterr().out


def test_walls_of_a_run_are_judged(finished: Path, tmp_path: Path) -> None:
    """The plan is right: walls that were seen agree, and none that is sure does not."""
    assert (
        run(["export", str(finished), "--to", "as-built", "-o", str(tmp_path / "walls.csv")]) == 0
    )
    with (tmp_path / "walls.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    words = [row["verdict"] for row in rows]
    assert words.count("agrees") >= 5
    assert not {"moved", "missing"} & {row["verdict"] for row in rows if row["is_sure"] == "yes"}
    errors = [abs(float(row["offset_m"])) for row in rows if row["verdict"] == "agrees"]
    assert np.median(errors) < 0.02
