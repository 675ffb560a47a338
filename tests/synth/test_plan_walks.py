"""Walks through given plans: what is seen agrees with the plan, ray by ray; where one can walk; refusals.

The plan: two rooms of 4 x 3 m and 5 x 3 m, a wall of 0.2 m between them with a door of 0.9 m, whose jambs
and the ends of the outer walls are not drawn.
"""

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from planfit.cli.main import run
from planfit.errors import OptionError, ScanError
from planfit.floorplan import Floorplan, PlanOptions, read_floorplan
from planfit.geometry import segments
from planfit.scan import Label, read_scan, write_tum
from planfit.synth import (
    BuildingOptions,
    CameraOptions,
    NoDepthNoise,
    SynthOptions,
    WalkOptions,
    make_scan,
)

DATA = Path(os.environ.get("PLANFIT_SHARED", Path(__file__).parents[2].parent / "shared" / "data"))
DOOR = (1.0, 1.9)


def loop(x0, y0, x1, y1):
    """Edges of a rectangle, its inside on the left."""
    corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], dtype=float)
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def two_rooms(has_door=True, openings=False):
    low, high = DOOR
    ends = [*loop(-0.3, -0.3, 9.5, 3.3)[:, ::-1]]
    for room, x in ((loop(0, 0, 4, 3), 4.0), (loop(4.2, 0, 9.2, 3), 4.2)):
        for a, b in room:
            if a[0] == b[0] == x and has_door:
                up = b[1] > a[1]
                parts = [((x, 0), (x, low)), ((x, high), (x, 3))]
                ends += [np.array(p if up else p[::-1], dtype=float) for p in parts]
            else:
                ends.append(np.array([a, b]))
    plan = Floorplan.from_segments(ends, segments.left_normals(np.array(ends)), name="two rooms")
    if openings:
        gaps = np.array([[(4, low), (4, high)], [(4.2, low), (4.2, high)]], dtype=float)
        plan = replace(plan, openings=gaps)
    return plan


def options(seed=0, walk=None, building=None, **camera):
    motion: dict[str, Any] = {"n_frames": 40, **(walk or {})}
    return SynthOptions(
        seed=seed,
        walk=WalkOptions(**motion),
        building=BuildingOptions(**(building or {})),
        camera=CameraOptions(**({"width_px": 96, "height_px": 64} | camera)),
        depth_noise=NoDepthNoise(),
    )


def cast(eye, ahead, ends):
    """Distance from a point along a direction to the nearest of segments: the slow and obvious way."""
    nearest = np.inf
    for a, b in ends:
        matrix = np.column_stack([ahead, a - b])
        if abs(np.linalg.det(matrix)) > 1e-12:
            t, s = np.linalg.solve(matrix, a - eye)
            if t > 0 and 0 <= s <= 1:
                nearest = min(nearest, t)
    return nearest


@pytest.mark.parametrize("frame", range(0, 40, 5))
def test_depth_agrees_with_faces_ray_by_ray(frame):
    plan = two_rooms()
    synthetic = make_scan(options(walk={"pitch_deg": 0.0, "pitch_swing_deg": 0.0}), plan)
    camera, pose = synthetic.scan.cameras[0], synthetic.true_plan_from_cams[frame]
    view = synthetic.renderer.render(camera, pose)
    jambs = np.array([[(4, y), (4.2, y)] for y in DOOR], dtype=float)
    ends = np.concatenate([plan.ends, jambs])
    for u in range(0, 96, 3):
        ray = pose[:3, :3] @ camera.rays(np.array([[u, 32.0]]))[0]
        # A picture hangs 2 cm before its wall, a window's sill 10 cm.
        slack = 1e-4 if view.labels[32, u] == Label.WALL else 0.1 / view.incidence[32, u]
        expected = cast(pose[:2, 3], ray[:2], ends)
        assert expected - slack <= view.depth[32, u] <= expected + 1e-4


def test_door_leads_through_a_solid_wall():
    """From the middle of the door sideways, the wall's end is seen, not its inside."""
    synthetic = make_scan(options(building={"pictures_per_wall": 0.0}), two_rooms())
    up, left = np.array([0.0, 0, 1]), np.array([-1.0, 0, 0])
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([-left, -up, np.cross(up, left) * -1])
    pose[:3, 3] = (4.1, 1.45, 1.0)
    assert_allclose(np.linalg.det(pose[:3, :3]), 1.0)
    view = synthetic.renderer.render(synthetic.scan.cameras[0], pose)
    assert view.labels[32, 48] == Label.WALL
    assert_allclose(view.depth[32, 48], 0.45, atol=1e-3)


def test_openings_that_the_plan_marks_have_lintels():
    bare = make_scan(options(), two_rooms()).building
    marked = make_scan(options(), two_rooms(openings=True))
    assert len(bare.walls.lintels) == 0
    quads = marked.renderer.quads
    tops = quads.origin[:, 2] + quads.v_axis[:, 2] * quads.size[:, 1]
    is_lintel = (quads.label == Label.WALL) & np.isclose(quads.origin[:, 2], 2.05)
    assert is_lintel.sum() == 2
    assert_allclose(tops[is_lintel], 2.6)
    assert_allclose(np.sort(quads.origin[is_lintel][:, 0]), [4.0, 4.2])
    is_soffit = (quads.normal[:, 2] == -1) & np.isclose(quads.origin[:, 2], 2.05)
    assert_allclose(np.sort(quads.size[is_soffit][0]), [0.2, 0.9])


def test_walls_of_one_line_get_a_back():
    outline = loop(0, 0, 6, 4)
    plan = Floorplan.from_segments(outline, segments.left_normals(outline))
    walls = make_scan(options(building={"single_wall_m": 0.15}), plan).building.walls
    assert walls.n_drawn == 4
    assert_allclose(walls.ends.reshape(-1, 2).min(axis=0), [-0.15, -0.15])


@pytest.mark.parametrize("seed", range(3))
def test_walk_enters_every_room_keeps_clear_and_closes(seed):
    synthetic = make_scan(options(seed), two_rooms())
    xy = synthetic.true_plan_from_cams[:, :2, 3]
    assert (xy[:, 0] < 4).any()
    assert (xy[:, 0] > 4.2).any()
    in_door = (xy[:, 0] > 3.5) & (xy[:, 0] < 4.7)
    angles = np.arange(0.0, 2 * np.pi, 0.2)
    around = np.column_stack([np.cos(angles), np.sin(angles)])
    distance = [min(cast(p, d, synthetic.floorplan.ends) for d in around) for p in xy]
    assert np.min(np.array(distance)[~in_door]) >= 0.39
    assert np.min(distance) >= 0.25
    assert_allclose(synthetic.true_plan_from_cams[0], synthetic.true_plan_from_cams[-1], atol=1e-6)


def test_clearance_is_zero_in_walls_and_outside():
    building = make_scan(options(), two_rooms()).building
    xy = np.array([(2, 1.5), (4.1, 1.45), (4.1, 0.5), (-0.15, 1.5), (-2, 1.5), (12, 1), (1, 0.3)])
    assert_allclose(building.clearance(xy), [1.5, 0.45, 0, 0, 0, 0, 0.3], atol=0.02)
    # But for a hair along the walls.
    assert_allclose([room.area for room in building.rooms], [15, 12], rtol=0.1)


def test_longest_walk_is_an_option():
    plan = two_rooms()
    walks = [
        make_scan(options(walk={"area_per_stop_m2": 2.0, "max_length_m": longest}), plan)
        for longest in (10.0, None)
    ]
    short, long = (
        np.linalg.norm(np.diff(walk.true_plan_from_cams[:, :2, 3], axis=0), axis=1).sum()
        for walk in walks
    )
    assert short <= 11.0 < long


def test_rooms_behind_closed_walls_are_left_out():
    xy = make_scan(options(), two_rooms(has_door=False)).true_plan_from_cams[:, :2, 3]
    assert (xy[:, 0] > 4.2).all()  # the larger room


def test_paths_are_followed_and_walls_in_their_way_not_built(tmp_path):
    """Straight through the wall where there is no door."""
    x = np.linspace(1.0, 8.0, 30)
    poses = np.tile(np.eye(4), (30, 1, 1))
    poses[:, :3, 3] = np.column_stack([x - 10.0, np.full(30, 2.5), np.zeros(30)])
    write_tum(tmp_path / "walk.tum", np.arange(30.0), poses)
    plan = two_rooms()
    walk = {"path": tmp_path / "walk.tum", "path_offset_m": (10.0, 0.0), "look_around_deg": 0.0}
    synthetic = make_scan(options(walk=walk), plan)
    true = synthetic.true_plan_from_cams
    assert_allclose(true[:, 1, 3], 2.5, atol=0.15)
    assert_allclose(true[[0, -1], 0, 3], [1.0, 8.0], atol=0.05)
    assert (true[:, 0, 2] > 0.8).all()  # looks along x
    walls = synthetic.building.walls
    built_m = segments.lengths(walls.ends[: walls.n_drawn]).sum()
    assert_allclose(plan.lengths.sum() - built_m, 2 * 0.5, atol=0.02)
    assert_array_equal(synthetic.floorplan.ends, plan.ends)  # the plan still has them


def test_same_seed_same_walk_other_seed_other_walk():
    one, two, other = (make_scan(options(seed), two_rooms()) for seed in (1, 1, 2))
    assert_array_equal(one.true_plan_from_cams, two.true_plan_from_cams)
    assert_array_equal(one.scan.files.color(3), two.scan.files.color(3))
    assert one.scan.fingerprint == two.scan.fingerprint != other.scan.fingerprint
    moved = two_rooms(openings=True)
    assert make_scan(options(1), replace(moved, ends=moved.ends + 0.5)).scan.fingerprint not in (
        one.scan.fingerprint,
        other.scan.fingerprint,
    )


def test_what_cannot_be_walked_is_refused(tmp_path):
    plan = two_rooms()
    with pytest.raises(OptionError, match="plan in metres"):
        make_scan(options(), replace(plan, is_metric=False))
    with pytest.raises(OptionError, match="free space"):
        make_scan(options(), plan.scaled(0.1))
    with pytest.raises(OptionError, match="only together with a plan"):
        make_scan(options(walk={"path": tmp_path / "walk.tum"}))
    with pytest.raises(ScanError, match="expected a TUM trajectory"):
        make_scan(options(walk={"path": tmp_path / "walk.tum"}), plan)
    (tmp_path / "still.tum").write_text("1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 1\n")
    with pytest.raises(OptionError, match="leads somewhere"):
        make_scan(options(walk={"path": tmp_path / "still.tum"}), plan)


def test_command_writes_a_walk_through_a_plan(tmp_path, capsys):
    np.save(tmp_path / "plan.npy", two_rooms().ends.reshape(-1, 4) * (1, -1, 1, -1))
    out = tmp_path / "scan"
    words = ["--walk.n-frames", "6", "--camera.width-px", "64", "--camera.height-px", "48"]
    assert run(["synth", str(out), "--plan", str(tmp_path / "plan.npy"), *words]) == 0
    assert "2 of 2 rooms entered" in capsys.readouterr().out
    assert len(read_scan(out)) == 6
    assert_allclose(read_floorplan(out / "floorplan.npy").ends, two_rooms().ends)


@pytest.mark.shared
@pytest.mark.skipif(not DATA.is_dir(), reason="no real plans: set PLANFIT_SHARED to their folder")
def test_real_drawing_is_walked_through():
    plan = read_floorplan(DATA / "floorplans" / "dxf" / "two_rooms_metres.dxf", PlanOptions("m"))
    synthetic = make_scan(options(), plan)
    centres = synthetic.true_plan_from_cams[:, :2, 3]
    rooms = synthetic.building.rooms
    assert any(room.contains(centres).mean() > 0.5 for room in rooms)
    assert synthetic.building.clearance(centres).min() > 0.25
