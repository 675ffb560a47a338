"""`planfit export --to rosbag|rerun`: what is written is read back by the libraries of both."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from planfit.cli import run
from planfit.geometry import se3
from planfit.scan import read_scan


def exported(small_scan: Path, to: str, path: Path) -> Path:
    assert run(["export", str(small_scan), "--to", to, "-o", str(path)]) == 0
    return path


def pose_of(translation, rotation) -> np.ndarray:
    """Of messages of ROS."""
    xyzw = [getattr(rotation, axis) for axis in "xyzw"]
    at = np.array([getattr(translation, axis) for axis in "xyz"])
    return se3.make_transform(Rotation.from_quat(xyzw).as_matrix(), at)


def test_rosbags_reads_the_bag(small_scan: Path, tmp_path: Path) -> None:
    highlevel = pytest.importorskip("rosbags.highlevel", reason="rosbags is not installed")
    scan = read_scan(small_scan)
    folder = exported(small_scan, "rosbag", tmp_path / "bag")
    assert {p.name for p in folder.iterdir()} == {"metadata.yaml", "poses.db3"}
    with highlevel.AnyReader([folder]) as reader:
        read = [
            (c.topic, ns, reader.deserialize(data, c.msgtype)) for c, ns, data in reader.messages()
        ]
    moved = [(ns, message.transforms[0]) for topic, ns, message in read if topic == "/tf"]
    assert len(moved) == len(scan)
    assert {(m.header.frame_id, m.child_frame_id) for _, m in moved} == {
        ("world", "camera_optical_frame")
    }
    assert_allclose(np.array([ns for ns, _ in moved]) * 1e-9, scan.timestamps, atol=1e-6)
    found = [pose_of(m.transform.translation, m.transform.rotation) for _, m in moved]
    assert_allclose(found, scan.world_from_cams, atol=1e-9)
    (path,) = [message for topic, _, message in read if topic == "/path"]
    assert path.header.frame_id == "world"
    found = [pose_of(one.pose.position, one.pose.orientation) for one in path.poses]
    assert_allclose(found, scan.world_from_cams, atol=1e-9)
    stamps = [one.header.stamp.sec + 1e-9 * one.header.stamp.nanosec for one in path.poses]
    assert_allclose(stamps, scan.timestamps, atol=1e-6)


def test_rerun_reads_the_recording(small_scan: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    scan = read_scan(small_scan)
    file = exported(small_scan, "rerun", tmp_path / "scan")
    file = file.with_suffix(".rrd")
    verify = [sys.executable, "-m", "rerun_cli", "rrd", "verify", str(file)]
    told = subprocess.run(verify, capture_output=True, text=True, check=False)
    assert told.returncode == 0, told.stderr
    chunk = pytest.importorskip("rerun.chunk", reason="this rerun-sdk has no reader of chunks")
    # Columns of each chunk; its times are nanoseconds, which no datetime holds.
    tables = []
    for one in chunk.RrdReader(str(file)).stream():
        batch = one.to_record_batch()
        columns = {
            name: (values.cast("int64") if name in ("time", "log_time") else values).to_pylist()
            for name, values in zip(batch.schema.names, batch.columns, strict=True)
        }
        tables.append((one.entity_path, columns))
    moved = {
        number: (at[0], xyzw[0], ns)
        for entity, table in tables
        if entity == "/world/camera" and "Transform3D:translation" in table
        for number, ns, at, xyzw in zip(
            table["frame"], table["time"], table["Transform3D:translation"],
            table["Transform3D:quaternion"], strict=True,
        )
    }  # fmt: skip
    assert sorted(moved) == list(range(len(scan)))
    for number, (at, xyzw, ns) in moved.items():
        found = se3.make_transform(Rotation.from_quat(xyzw).as_matrix(), np.array(at))
        assert_allclose(found, scan.world_from_cams[number], atol=2e-6)
        assert ns * 1e-9 == pytest.approx(scan.timestamps[number], abs=1e-6)
    columns = {(entity, name): rows for entity, table in tables for name, rows in table.items()}
    (strips,) = columns["/world/path", "LineStrips3D:strips"]
    assert_allclose(strips[0], scan.world_from_cams[:, :3, 3], atol=2e-6)
    assert len(columns["/world/points", "Points3D:positions"][0]) > 10_000


@pytest.mark.parametrize(("to", "library"), [("rosbag", "rosbags"), ("rerun", "rerun")])
def test_without_the_library(
    to, library, small_scan: Path, tmp_path: Path, capsys, monkeypatch
) -> None:
    monkeypatch.setitem(sys.modules, library if to == "rerun" else f"{library}.rosbag2", None)
    assert run(["export", str(small_scan), "--to", to, "-o", str(tmp_path / "out")]) == 2
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.startswith(f"planfit: export: expected the library {library}, found none (")
    assert line.endswith(f"; pip install 'planfit[{'bag' if to == 'rosbag' else to}]'")
    assert not list(tmp_path.iterdir())
