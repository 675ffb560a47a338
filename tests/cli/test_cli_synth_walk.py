"""`planfit synth --plan FILE --walk-file TUM`: a walk of one's own through a plan."""

from pathlib import Path

import numpy as np
from numpy.testing import assert_allclose

from planfit.cli import run
from planfit.floorplan import Floorplan, write_floorplan_json
from planfit.scan import read_tum, write_tum


def room(path: Path) -> Path:
    corners = np.array([(0, 0), (9, 0), (9, 5), (0, 5)], dtype=float)
    ends = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
    inwards = np.array([(0, 1), (-1, 0), (0, -1), (1, 0)], dtype=float)
    write_floorplan_json(path, Floorplan.from_segments(ends, inwards))
    return path


def test_the_walk_of_a_file_is_walked(tmp_path: Path, capsys) -> None:
    poses = np.tile(np.eye(4), (20, 1, 1))
    poses[:, 0, 3], poses[:, 1, 3] = np.linspace(1.0, 8.0, 20), 2.5
    write_tum(tmp_path / "walk.tum", np.arange(20.0), poses)
    plan, scan = room(tmp_path / "plan.json"), tmp_path / "scan"
    small = ["--walk.n-frames", "5", "--camera.width-px", "64", "--camera.height-px", "48"]
    walk = ["--walk-file", str(tmp_path / "walk.tum")]
    assert run(["synth", str(scan), "--plan", str(plan), *walk, *small]) == 0
    _, true = read_tum(scan / "groundtruth.tum")
    steps = np.linalg.norm(np.diff(true[:, :3, 3], axis=0), axis=1)
    assert_allclose(steps.sum(), 7.0, atol=0.3)
    both = [*walk, "--walk.path", str(tmp_path / "walk.tum")]
    assert run(["synth", str(tmp_path / "other"), "--plan", str(plan), *both]) == 2
    assert "leave one out" in " ".join(capsys.readouterr().err.split())


def test_a_walk_beside_the_plan_is_refused_until_it_is_moved(tmp_path: Path, capsys) -> None:
    """Once rendered in silence: 500 images of nothing, which refine then refused for want of depth."""
    poses = np.tile(np.eye(4), (20, 1, 1))
    poses[:, 0, 3], poses[:, 1, 3] = np.linspace(1.0, 8.0, 20), 42.5
    write_tum(tmp_path / "walk.tum", np.arange(20.0), poses)
    asked = ["--plan", str(room(tmp_path / "plan.json")), "--walk-file", str(tmp_path / "walk.tum")]
    asked += ["--walk.n-frames", "5", "--camera.width-px", "64", "--camera.height-px", "48"]
    assert run(["synth", str(tmp_path / "scan"), *asked]) == 2
    words = " ".join(capsys.readouterr().err.split())
    assert "x 0 to 9, y 0 to 5 m" in words
    assert "y 42.5 to 42.5 m" in words
    assert run(["synth", str(tmp_path / "scan"), *asked, "--walk.path-offset-m", "0", "-40"]) == 0
