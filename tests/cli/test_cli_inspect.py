"""`planfit inspect`: what it says of a scan, and the picture it draws."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from planfit.cli import run
from planfit.runtime import Runtime
from planfit.scan import read_scan
from planfit.scan.statistics import depth_statistics, path_statistics
from planfit.synth import SynthOptions, WalkOptions, make_scan


def spoken(capsys) -> str:
    return " ".join(capsys.readouterr().out.split())


def test_statistics_and_picture(small_scan: Path, tmp_path: Path, capsys) -> None:
    picture = tmp_path / "view.png"
    assert run(["inspect", str(small_scan), "-o", str(picture)]) == 0
    text = spoken(capsys)
    scan = read_scan(small_scan)
    steps = np.linalg.norm(np.diff(scan.world_from_cams[:, :3, 3], axis=0), axis=1)
    for words in (
        "format facap",
        "frames 60, 0001 to 0060",
        "320 x 240 px",
        f"path {steps.sum():.1f} m",
        "up axis (0.000, 1.000, 0.000)",
        "gaps none",
        "jumps none",
        "masks floor and walls",
        f"written: {picture}",
    ):
        assert words in text, words
    with Image.open(picture) as image:
        colours = np.asarray(image.convert("RGB")).reshape(-1, 3)
    blue, purple = (0, 114, 178), (123, 63, 160)
    assert (np.abs(colours.astype(int) - blue).max(axis=1) < 12).sum() > 2000
    assert (np.abs(colours.astype(int) - purple).max(axis=1) < 12).sum() > 300


def test_frames_left_out_are_counted_and_named(small_scan: Path, tmp_path: Path, capsys) -> None:
    poses = tmp_path / "poses.txt"
    lines = (small_scan / "groundtruth.tum").read_text().splitlines()
    poses.write_text("\n".join([*lines[:20], *lines[22:]]) + "\n")
    assert run(["inspect", str(small_scan), "--poses", str(poses)]) == 0
    text = spoken(capsys)
    assert "frames 58, 0001 to 0060" in text
    assert (
        "note: 2 of 60 frames are left out: frame 0021: poses.txt has no pose; frame 0022:" in text
    )
    assert "gaps none" in text  # two frames are missing, which is not yet a gap


def test_a_wrong_depth_scale_is_questioned(small_scan: Path, capsys) -> None:
    assert run(["inspect", str(small_scan), "--depth-scale", "1"]) == 2
    assert "leave out --depth-scale" in capsys.readouterr().err


def test_only_pictures_are_written(small_scan: Path, tmp_path: Path, capsys) -> None:
    assert run(["inspect", str(small_scan), "-o", str(tmp_path / "view.html")]) == 2
    assert "expected a file of .png, found .html" in capsys.readouterr().err


def test_unknown_formats_and_options(small_scan: Path, capsys) -> None:
    assert run(["inspect", str(small_scan), "--format", "kinect"]) == 2
    assert "expected auto, facap" in capsys.readouterr().err
    assert run(["inspect", str(small_scan), "--min-confidence", "3"]) == 2
    assert "min_confidence: expected 0, 1 or 2" in capsys.readouterr().err


@pytest.fixture(scope="module")
def walk():
    return make_scan(SynthOptions(seed=4, walk=WalkOptions(n_frames=80))).scan


def test_gaps_and_jumps_are_found_where_they_were_put(walk) -> None:
    times = walk.timestamps / 30
    times[31:] += 4.0
    poses = walk.world_from_cams.copy()
    poses[31:, :3, 3] += (1.5, 0.0, 0.0)  # explained by the gap
    poses[60:, :3, 3] += (0.0, 0.0, 6.0)
    facts = path_statistics(replace(walk, timestamps=times, world_from_cams=poses))
    assert facts.gaps.tolist() == [30]
    assert facts.jumps.tolist() == [59]
    assert facts.interval_s == pytest.approx(1 / 30)
    plain = path_statistics(walk)
    assert plain.gaps.tolist() == plain.jumps.tolist() == []


def test_depth_statistics_are_those_of_the_images(small_scan: Path) -> None:
    walk = read_scan(small_scan)
    facts = depth_statistics(walk, Runtime(2))
    every = np.concatenate([walk.files.depth(int(i)).ravel() for i in facts.frame_idx[::6]])
    known = every[np.isfinite(every)]
    assert facts.median_m == pytest.approx(np.median(known), rel=0.1)
    assert facts.far_m == pytest.approx(np.percentile(known, 99), rel=0.15)
    assert facts.coverage == pytest.approx(np.isfinite(every).mean(), abs=0.05)
    assert facts.n_empty == 0
    # World y is up and the floor is at 0: nothing lies below it but noise.
    assert np.percentile(facts.points_world[:, 1], 1) > -0.15
