"""Clouds of a run: points by frame, and frames that are left out of them."""

import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_array_equal

import planfit
import planfit.cli.refine as command
from planfit.export.cloud import (
    Cloud,
    Sampling,
    place_cloud,
    read_ply_points,
    sample_cloud,
    sample_clouds,
    write_ply,
)
from planfit.runtime import Runtime
from planfit.saving import RunInputs
from planfit.scan import ScanOptions
from planfit.synth import BuildingOptions, CameraOptions, SynthOptions, WalkOptions, make_scan


def make_cloud(sizes):
    frame = np.repeat(np.arange(len(sizes)), sizes)
    points = np.column_stack([frame, np.zeros((len(frame), 2))]).astype(float)
    colors = np.repeat(frame[:, None], 3, axis=1).astype(np.uint8)
    return Cloud(points, colors, np.cumsum([0, *sizes]))


def test_runs_of_frames_are_left_out():
    cloud = make_cloud([2, 3, 0, 4, 1])
    less = cloud.without([(1, 2), (4, 4)])
    assert_array_equal(less.points_cam[:, 0], [0, 0, 3, 3, 3, 3])
    assert_array_equal(less.colors[:, 0], [0, 0, 3, 3, 3, 3])
    assert_array_equal(less.start, [0, 2, 2, 2, 6, 6])
    poses = np.tile(np.eye(4), (5, 1, 1))
    assert len(place_cloud(less, poses)) == 6
    assert_array_equal(cloud.without([]).start, cloud.start)


@pytest.fixture(scope="module")
def small_run():
    synthetic = make_scan(
        SynthOptions(
            building=BuildingOptions(n_rooms=1),
            walk=WalkOptions(n_frames=12),
            camera=CameraOptions(width_px=160, height_px=120),
        )
    )
    plan = synthetic.floorplans[0]
    return synthetic.scan, plan, planfit.refine(synthetic.scan, plan)


def test_a_cloud_of_some_frames_is_theirs_alone(small_run):
    scan, _, _ = small_run
    some = np.array([0, 5, 11])
    every = sample_cloud(scan, Runtime(1), max_points=12 * 300)
    less = sample_cloud(scan, Runtime(1), max_points=3 * 300, frame_idx=some)
    assert len(less.start) == len(every.start) == len(scan) + 1
    of_some = np.isin(np.repeat(np.arange(len(scan)), np.diff(every.start)), some)
    assert_array_equal(less.points_cam, every.points_cam[of_some])
    assert_array_equal(less.colors, every.colors[of_some])
    assert_array_equal(np.flatnonzero(np.diff(less.start)), some)


def test_several_clouds_are_those_sampled_one_by_one_and_open_each_image_once(small_run):
    scan, _, _ = small_run
    opened = []

    class Counted:
        def __getattr__(self, name):
            read = getattr(scan.files, name)
            return (
                (lambda i: opened.append((name, i)) or read(i))
                if name in ("depth", "color")
                else read
            )

    counted = replace(scan, files=Counted())
    few, many = sample_clouds(counted, Runtime(1), (Sampling(12 * 300), Sampling(10**6, 800)))
    assert sorted(opened) == [(name, i) for name in ("color", "depth") for i in range(len(scan))]
    assert_array_equal(few.points_cam, sample_cloud(scan, Runtime(1), 12 * 300).points_cam)
    assert np.diff(many.start).max() <= 2 * 800
    (alone,) = sample_clouds(scan, Runtime(1), [Sampling(10**6, 800)])
    for one, other in ((many.points_cam, alone.points_cam), (many.colors, alone.colors)):
        assert_array_equal(one, other)
    assert len(many.points_cam) > 2 * len(few.points_cam)


@pytest.mark.parametrize("most", [1, 4, 9, 10, 50])
def test_a_thinned_cloud_has_no_more_points_and_keeps_their_frames(most):
    cloud = make_cloud([2, 3, 0, 4, 1])
    less = cloud.thinned(most)
    assert len(less.points_cam) == min(most, 10)
    frame = np.repeat(np.arange(5), np.diff(less.start))
    assert_array_equal(less.points_cam[:, 0], frame)
    assert_array_equal(less.colors[:, 0], frame)


@pytest.mark.slow
def test_a_run_leaves_frames_without_place_out_of_its_clouds(small_run, tmp_path, monkeypatch):
    scan, floorplan, result = small_run
    evidence = replace(result.evidence, unplaced=((2, 4),))
    monkeypatch.setattr(command, "refine", lambda *_, **__: replace(result, evidence=evidence))
    inputs = RunInputs(scan, floorplan, planfit.RefineOptions(), ScanOptions())
    command.refine_into(tmp_path / "out", inputs, 1, False)
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert record["verdict"]["frames_without_place"] == [[2, 4]]
    monkeypatch.setattr(command, "refine", lambda *_, **__: result)
    command.refine_into(tmp_path / "whole", inputs, 1, False)
    some, whole = (
        len(trimesh.load(tmp_path / name / "cloud_after.ply").vertices) for name in ("out", "whole")
    )
    assert 0 < some < whole


@pytest.mark.parametrize(
    "origin", [(0.0, 0.0, 0.0), (500000.25, 5400000.5, 212.0), (-4000.0, 0.0, 0.0)]
)
def test_clouds_lose_nothing_wherever_they_are(tmp_path, rng, origin):
    """Single precision has steps of half a metre at the northings of a national grid."""
    points = np.array(origin) + rng.uniform(-20, 20, (500, 3))
    path = tmp_path / "cloud.ply"
    write_ply(path, points, np.zeros((500, 3), dtype=np.uint8))
    np.testing.assert_allclose(read_ply_points(path, 1000), points, atol=0.0003, rtol=0)
    kind = b"double" if origin[1] > 0 else b"float"
    assert b"property " + kind + b" x" in path.read_bytes()[:200]
