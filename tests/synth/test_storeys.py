"""Storeys: floors at their heights, walls of their own plans, stairs that a walk goes up and down."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planfit.cli.main import run
from planfit.errors import OptionError
from planfit.floorplan import Floorplan, nearest_faces, read_floorplan
from planfit.geometry import se3, segments
from planfit.scan import Label, read_scan
from planfit.synth import (
    ON_STAIRS,
    BuildingOptions,
    CameraOptions,
    NoDepthNoise,
    SynthOptions,
    WalkOptions,
    make_building,
    make_scan,
)

OPTIONS = SynthOptions(
    seed=1,
    building=BuildingOptions(n_storeys=2, n_rooms=2, yaw_deg=15.0, furniture_per_room=2),
    walk=WalkOptions(n_frames=240),
    camera=CameraOptions(width_px=80, height_px=60),
    depth_noise=NoDepthNoise(),
)


@pytest.fixture(scope="module")
def synthetic():
    return make_scan(OPTIONS)


def frames_of(synthetic, storey):
    return np.flatnonzero(synthetic.frame_storeys == storey)


def points_of(synthetic, frame):
    pose = synthetic.true_plan_from_cams[frame]
    camera = synthetic.scan.cameras[frame]
    view = synthetic.renderer.render(camera, pose)
    points = se3.transform(pose, camera.lift_image(view.depth).reshape(-1, 3))
    return view, points.reshape(*view.depth.shape, 3)


def test_heights_are_storeys_and_slabs():
    synthetic = make_scan(
        replace(OPTIONS, building=BuildingOptions(n_storeys=3, n_rooms=1, height_m=2.8))
    )
    assert_allclose(synthetic.floors_z, [0.0, 3.1, 6.2])
    assert len(synthetic.floorplans) == 3
    assert {ON_STAIRS, 0, 1, 2} == set(synthetic.frame_storeys)
    step = np.abs(np.diff(synthetic.true_plan_from_cams[:, 2, 3]))
    assert step.max() < 0.5  # no jump from storey to storey


@pytest.mark.parametrize("storey", [0, 1])
def test_each_storey_is_seen_as_its_own_plan(synthetic, storey):
    z = synthetic.floors_z[storey]
    n_floor, n_wall = 0, 0
    for frame in frames_of(synthetic, storey)[::9]:
        view, points = points_of(synthetic, frame)
        height = points[..., 2] - z
        # Through the stairwell one may look down on the floor below, and up to the ceiling above.
        floor = height[(view.labels == Label.FLOOR) & (np.abs(height) < 1.0)]
        assert_allclose(floor, 0.0, atol=1e-3)
        is_wall = (view.labels == Label.WALL) & (height > 0.0) & (height < 2.05)
        xy = points[is_wall][:, :2]
        if len(xy):
            ends = synthetic.floorplans[storey].ends
            assert nearest_faces.nearest_distance(xy, ends).max() < 1e-3
        n_floor, n_wall = n_floor + len(floor), n_wall + len(xy)
    assert n_floor > 1000
    assert n_wall > 1000


def test_layouts_of_storeys_differ_but_for_the_stairwell(synthetic):
    low, high = (storey.layout for storey in synthetic.storeys)
    assert low.rooms[:-1] != high.rooms[:-1]
    assert low.stairs == high.stairs
    assert low.rooms[-1] == high.rooms[-1] == low.stairs.well


def test_camera_is_over_the_floor_or_the_steps(synthetic):
    over = synthetic.true_plan_from_cams[:, 2, 3] - 1.5
    for storey in (0, 1):
        assert_allclose(over[frames_of(synthetic, storey)], synthetic.floors_z[storey], atol=0.1)
    on_stairs = frames_of(synthetic, ON_STAIRS)
    assert len(on_stairs) > 20
    # Steps right below, by rays straight down: the walk is level with them to a step.
    down = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]]).T
    camera = synthetic.scan.cameras[0]
    for frame in on_stairs[::4]:
        pose = se3.make_transform(down, synthetic.true_plan_from_cams[frame, :3, 3])
        depth = synthetic.renderer.render(camera, pose).depth[30, 40]
        assert abs(depth - 1.5) < 0.25


def test_loops_come_down_again_with_the_first_view(synthetic):
    assert_allclose(synthetic.true_plan_from_cams[-1], synthetic.true_plan_from_cams[0], atol=1e-6)
    assert synthetic.frame_storeys[0] == synthetic.frame_storeys[-1] == 0
    changes = synthetic.frame_storeys[np.flatnonzero(np.diff(synthetic.frame_storeys)) + 1]
    assert_array_equal(changes, [ON_STAIRS, 1, ON_STAIRS, 0])
    up = make_scan(replace(OPTIONS, walk=WalkOptions(n_frames=60, is_loop=False)))
    assert up.frame_storeys[-1] == 1
    changes = up.frame_storeys[np.flatnonzero(np.diff(up.frame_storeys)) + 1]
    assert_array_equal(changes, [ON_STAIRS, 1])


def test_every_room_of_every_storey_is_entered_with_clearance(synthetic):
    for k, storey in enumerate(synthetic.storeys):
        poses = synthetic.true_plan_from_cams[frames_of(synthetic, k)]
        xy = poses[:, :2, 3] @ storey.plan_from_building[:2, :2]
        assert all(room.contains(xy).any() for room in storey.rooms)
        # The way onto the steps is no wall to keep from.
        is_clear = ~storey.layout.stairs.landing.contains(xy)
        assert storey.clearance(xy[is_clear]).min() >= 0.4


def test_frames_are_evenly_moving_across_storeys(synthetic):
    step = np.linalg.norm(np.diff(synthetic.true_plan_from_cams[:, :3, 3], axis=0), axis=1)
    assert step.max() < 0.6
    assert step.sum() > 40


def test_written_storeys_read_back(tmp_path, capsys):
    out = tmp_path / "scan"
    words = ["--building.n-storeys", "2", "--building.n-rooms", "1", "--walk.n-frames", "20",
             "--camera.width-px", "64", "--camera.height-px", "48"]  # fmt: skip
    assert run(["synth", str(out), *words]) == 0
    assert "4 of 4 rooms entered" in capsys.readouterr().out
    assert len(read_scan(out)) == 20
    assert not (out / "floorplan.npy").exists()
    plans = [read_floorplan(out / f"plan_{k}.npy") for k in (0, 1)]
    assert plans[0].ends.shape[1:] == plans[1].ends.shape[1:]
    rows = [line.split(",") for line in (out / "storeys.csv").read_text().splitlines()]
    assert rows[0] == ["frame", "storey", "floor_z_m"]
    assert len(rows) == 21
    assert {tuple(row[1:]) for row in rows[1:]} >= {("0", "0.000"), ("1", "2.900")}


def test_what_storeys_cannot_be_is_refused():
    with pytest.raises(OptionError, match="n_storeys"):
        BuildingOptions(n_storeys=0)
    with pytest.raises(OptionError, match="n_storeys"):
        BuildingOptions(n_storeys=2, n_rooms=6, same_rooms=True)
    with pytest.raises(OptionError, match="one storey"):
        make_building(BuildingOptions(n_storeys=2), np.random.default_rng(0))
    ends = np.array([[(0, 0), (9, 0)], [(9, 0), (9, 9)], [(9, 9), (0, 9)], [(0, 9), (0, 0)]], float)
    plan = Floorplan.from_segments(ends, segments.left_normals(ends))
    with pytest.raises(OptionError, match="together with a plan"):
        make_scan(OPTIONS, plan)
