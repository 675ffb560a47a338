"""Laps that are made of one rendered walk: the frames that they say, with recorded drift of their own."""

import numpy as np
from numpy.testing import assert_allclose
from throughput import write_laps

from builders import look
from planfit.scan import read_tum
from planfit.scan.poses import write_pose, write_tum


def test_laps_go_there_and_back_over_the_frames_that_were_rendered(tmp_path):
    rendered, laps = tmp_path / "rendered", tmp_path / "laps"
    (rendered / "arcore").mkdir(parents=True)
    truth = np.stack([look([0.1 * i, 1.5, 0.0], 3 * i) for i in range(4)])
    for i, pose in enumerate(truth):
        write_pose(rendered / "arcore" / f"pose-{i + 1:04d}.txt", pose)
        (rendered / "arcore" / f"cam_params-{i + 1:04d}.txt").write_text("64 48 50 50 31.5 23.5")
        for name in (f"frame-{i + 1:04d}.jpg", f"depth-{i + 1:04d}.png"):
            (rendered / "arcore" / name).write_bytes(name.encode())
    np.save(rendered / "floorplan.npy", np.array([[0.0, 0.0, 1.0, 0.0]]))
    write_tum(rendered / "groundtruth.tum", np.arange(1.0, 5.0), truth)
    write_laps(rendered, laps, 11)
    numbers = [1, 2, 3, 4, 4, 3, 2, 1, 1, 2, 3]
    shown = [(laps / "arcore" / f"frame-{i + 1:05d}.jpg").read_text() for i in range(11)]
    assert shown == [f"frame-{k:04d}.jpg" for k in numbers]
    _, found = read_tum(laps / "groundtruth.tum")
    assert_allclose(found, truth[np.array(numbers) - 1], atol=1e-6)
    recorded = np.stack([np.loadtxt(laps / "arcore" / f"pose-{i + 1:05d}.txt") for i in range(11)])
    off_m = np.linalg.norm(recorded[:, :3, 3] - found[:, :3, 3], axis=1)
    assert off_m[0] < 1e-6
    assert len(np.unique(off_m.round(6))) == 11  # each sighting of a frame has drift of its own
