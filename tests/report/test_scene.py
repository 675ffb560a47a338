"""The scene of the 3D view: what the page holds is what was scanned, to the millimetre."""

import io
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from scipy.spatial import KDTree

from builders import CAMERA, look
from planfit.as_built import AsBuilt, AsBuiltOptions, AsBuiltWall, Verdict
from planfit.floorplan.nearest_faces import nearest_distance
from planfit.geometry import se3
from planfit.pipeline.on_plan import Storey, Storeys
from planfit.report.html.page import make_report
from planfit.report.html.view_section import view_data
from planfit.report.make_scene import (
    frames_with_pictures,
    make_pictures,
    quarter_turns,
    scene_walls,
)
from planfit.report.scene import REACH_M, ScenePoints, quantise, tile_frames
from planfit.runtime import Runtime
from planfit.scan import scan_from_arrays
from report.scenes import PER_FRAME, decode, room_plan, room_scene, view_of
from test_report import make_result


def test_page_holds_every_point_within_a_millimetre():
    scene, _ = room_scene(offsets=(0.02, 0.0, -0.07, 0.3))
    html = view_of(scene)
    _, points = decode(html)
    assert len(points) == len(scene.points.points_cam)
    by_frame = {}
    for frame, at, color, distances in points:
        by_frame.setdefault(frame, []).append((*at, *color, *distances))
    for i in range(len(scene.frames)):
        part = slice(scene.points.start[i], scene.points.start[i + 1])
        found = np.array(by_frame[i])  # one level only: in the order of the points
        assert np.abs(found[:, :3] - scene.points.points_cam[part]).max() < 0.001
        assert np.abs(found[:, 3:6] - scene.points.colors[part]).max() < 4
        assert scene.points.plan_distances_m is not None
        expected = np.minimum(scene.points.plan_distances_m[:, part].T, 0.51)
        assert np.abs(found[:, 6:] * 0.002 - expected).max() <= 0.0011


@given(
    extent=st.floats(0.001, REACH_M), centre=st.floats(-REACH_M, REACH_M), seed=st.integers(0, 9)
)
@settings(max_examples=60, deadline=None)
def test_no_coordinate_is_rounded_by_a_millimetre(extent, centre, seed):
    rng = np.random.default_rng(seed)
    cam = np.clip(rng.uniform(centre - extent, centre + extent, (50, 3)), -REACH_M, REACH_M)
    cam = cam.astype(np.float32)
    points = ScenePoints(cam, np.zeros((50, 3), np.uint8), np.array([0, 20, 20, 50]), None)
    low, steps = tile_frames(points)
    idx = points.frame_idx
    decoded = low[idx].astype(float) + steps[idx].astype(float) * quantise(points)
    assert np.abs(decoded - cam).max() < 0.001


def test_what_is_further_than_a_tile_reaches_is_left_out_and_coarsens_nothing():
    scene, _ = room_scene()
    far = scene.points.points_cam.copy()
    far[::100] += 1e4
    html = view_of(replace(scene, points=replace(scene.points, points_cam=far)))
    _, points = decode(html)
    assert len(points) == len(far) - len(far[::100])
    kept = np.delete(scene.points.points_cam, np.s_[::100], axis=0)
    assert np.abs(np.array([p[1] for p in points]) - kept).max() < 0.001


def test_levels_share_all_points_evenly(monkeypatch):
    monkeypatch.setattr("planfit.report.scene._FIRST_POINTS", 600)
    monkeypatch.setattr("planfit.report.scene._LEVEL_POINTS", 1020)
    scene, _ = room_scene()
    html = view_of(scene)
    _, points = decode(html)
    assert html.count('class="view-points"') == 11
    apart = 100.0  # m between frames, so that no point is taken for one of another frame
    decoded = np.array([(*at, apart * frame) for frame, at, *_ in points])
    sampled = np.column_stack([scene.points.points_cam, apart * scene.points.frame_idx])
    away, which = KDTree(decoded).query(sampled)
    assert away.max() < 0.001
    assert len(points) == len(sampled)
    assert (
        len(np.unique(which)) >= len(points) - 3
    )  # a few stand nearer to another than they are rounded
    for part in (slice(0, 600), slice(600, 1620)):
        by_frame = np.bincount([p[0] for p in points[part]], minlength=12)
        assert np.abs(by_frame - len(points[part]) / 12).max() < 4


def test_points_stand_before_and_after_where_the_poses_put_them():
    scene, _ = room_scene()
    html = view_of(scene)
    decoded, points = decode(html)
    for side, poses in (("before", scene.before), ("after", scene.after)):
        for frame, at, *_ in points[::500]:
            rows = decoded[side][frame].astype(float)
            in_plan = rows[:, :3] @ at + rows[:, 3] + decoded["origin"]
            nearest = se3.transform(poses[frame], scene.points.points_cam)
            assert np.linalg.norm(nearest - in_plan, axis=1).min() < 0.002


def test_a_site_far_from_the_origin_loses_nothing():
    far = np.array([2.6e6, 1.2e6, 400.0])
    result = make_result()
    moved = []
    for poses in (result.initial_plan_from_cams, result.plan_from_cams):
        poses = poses.copy()
        poses[:, :3, 3] += far
        moved.append(poses)
    ends = room_plan().ends + far[:2]
    plan = replace(room_plan(), ends=ends)
    scene, _ = room_scene()
    at_origin, _ = decode(view_of(scene))
    result = replace(
        result, floorplan=plan, initial_plan_from_cams=moved[0], plan_from_cams=moved[1]
    )
    decoded, _ = decode(view_of(room_scene(result=result)[0]))
    for side in ("before", "after"):
        shifted = decoded[side].astype(float)
        shifted[:, :, 3] += np.array(decoded["origin"]) - np.array(at_origin["origin"]) - far
        assert np.abs(shifted - at_origin[side]).max() < 1e-3


def test_distances_are_to_the_nearest_wall_of_the_plan():
    scene, _ = room_scene(offsets=(0.0, 0.0, 0.2, 0.0))
    assert scene.points.plan_distances_m is not None
    for side, poses in enumerate((scene.before, scene.after)):
        for i in (0, 2):
            part = slice(i * PER_FRAME, (i + 1) * PER_FRAME)
            in_plan = se3.transform(poses[i], scene.points.points_cam[part])
            expected = np.minimum(nearest_distance(in_plan[:, :2], room_plan().ends), 0.51)
            assert np.allclose(scene.points.plan_distances_m[side, part], expected, atol=1e-6)
    assert np.allclose(
        scene.points.plan_distances_m[1, 2 * PER_FRAME : 3 * PER_FRAME], 0.2, atol=1e-5
    )


def test_without_alignment_neither_walls_nor_distances_are_shown():
    scene, _ = room_scene(result=replace(make_result(), alignment=None))
    html = view_of(scene)
    decoded, points = decode(html)
    assert not scene.walls
    assert decoded["hasDistances"] is False
    assert points[0][3] == []
    assert "distance to the plan</option>" not in html
    assert "walls of the plan</label>" not in html


def test_walls_say_what_the_table_says():
    scene, _ = room_scene(offsets=(0.0, 0.0, 0.07, -0.12))
    by_face = {wall.face_idx: wall for wall in scene.walls}
    assert [by_face[k].status for k in range(4)] == ["agrees", "agrees", "moved", "moved"]
    assert "moved by 0.120 m" in dict(by_face[3].rows)["As built"]
    assert by_face[3].title == "Wall No. 4 of the plan"


def test_walls_have_the_colours_of_their_verdicts():
    """Those too short to be judged are shown as not seen."""
    result = make_result()
    plan = result.floorplan
    verdicts = (Verdict.MISSING, Verdict.NOT_SEEN, Verdict.MOVED)
    offsets = (np.nan, np.nan, 0.2)
    walls = tuple(
        AsBuiltWall(k, plan.ends[k], plan.normals[k], True, off, 0.01, 3, 3, 0.9 * (k == 0))
        for k, off in enumerate(offsets)
    )
    bounds = np.array([[0.0, 0.0, 0.0], [8.0, 6.0, 2.5]])
    found = scene_walls(plan, result, bounds, AsBuilt(walls, AsBuiltOptions()))
    assert [wall.status for wall in found] == ["missing", "unseen", "moved", "unseen"]
    for wall, verdict in zip(found, verdicts, strict=False):
        assert verdict.value in dict(wall.rows)["As built"]
    assert "As built" not in dict(found[3].rows)


def test_walls_that_the_table_tells_of_are_shown_wherever_they_are():
    """What was seen through a window is further away than nearly all points; and what the plan lacks."""
    result = make_result()
    far = np.array([[[50.0, 0.0], [50.0, 5.0]], [[60.0, 0.0], [60.0, 5.0]]])
    plan = replace(
        result.floorplan,
        ends=np.concatenate([result.floorplan.ends, far]),
        normals=np.concatenate([result.floorplan.normals, [[-1.0, 0.0]] * 2]),
        is_oriented=np.ones(len(result.floorplan) + 2, dtype=bool),
    )
    told = AsBuiltWall(4, far[0], np.array([-1.0, 0.0]), True, 0.01, 0.01, 3, 3, 0.0)
    unseen = AsBuiltWall(5, far[1], np.array([-1.0, 0.0]), True, np.nan, np.nan, 0, 0, 0.0)
    new = AsBuiltWall(-1, far[0] - [45.0, 0.0], np.array([1.0, 0.0]), True, 0.0, 0.01, 3, 3, 0.0)
    nowhere = np.array([[900.0, 900.0, 0.0], [901.0, 901.0, 1.0]])
    found = scene_walls(plan, result, nowhere, AsBuilt((told, unseen, new), AsBuiltOptions()))
    assert [wall.face_idx for wall in found] == [4, -3]
    assert [wall.status for wall in found[-2:]] == ["agrees", "new"]
    assert found[-2].title == "Wall No. 1 of the plan"
    assert found[-1].title == "Wall No. 3, which the plan lacks"
    np.testing.assert_array_equal(found[-1].ends, new.ends)


def test_walls_of_a_storey_stand_on_its_floor():
    result = make_result()
    upper = replace(room_plan(), storeys=np.array([0, 1, 0, 1]))
    storeys = Storeys(
        (Storey(0.0, ((0, 5),), None), Storey(3.2, ((6, 11),), None)), np.repeat([0, 1], 6)
    )
    structure = replace(result.structure, storeys=np.repeat([0, 1], 6))
    result = replace(result, floorplan=upper, storeys=storeys, structure=structure)
    scene, _ = room_scene(result=result)
    assert [wall.heights[0] for wall in scene.walls] == [0.0, 3.2, 0.0, 3.2]
    assert [frame.floor_m for frame in scene.frames] == [0.0] * 6 + [3.2] * 6
    # Frame 6 is upstairs and sees the wall y = DEPTH, which is drawn downstairs alone.
    assert scene.points.plan_distances_m is not None
    assert scene.points.plan_distances_m[1, 6 * PER_FRAME : 7 * PER_FRAME].min() > 0.4


def test_ceilings_are_cut_at_first():
    scene, result = room_scene()
    assert scene.cut_m == pytest.approx(result.plan_from_cams[:, 2, 3].max() + 0.4)


def test_pictures_are_a_bounded_number_evenly_spread():
    assert frames_with_pictures(7, 120).tolist() == list(range(7))
    assert frames_with_pictures(100, 3).tolist() == [0, 50, 99]
    assert frames_with_pictures(100, 0).tolist() == []
    scene, _ = room_scene(n_frames=12, max_pictures=4)
    assert sorted(scene.pictures) == [0, 4, 7, 11]
    image = np.asarray(Image.open(io.BytesIO(scene.pictures[7])))
    assert np.abs(image.reshape(-1, 3).mean(axis=0) - [140, 40, 40]).max() < 6


@pytest.mark.parametrize("turned", range(4))
def test_pictures_are_the_right_way_up(turned):
    """A camera rolled by quarter turns: the lamp over it is in the upper half of every picture."""
    pose = look([0.0, 0.0, 1.5], 20.0, roll_deg=90.0 * turned)
    up_in_cam = pose[2, :2]
    v, u = np.mgrid[0:60, 0:60] - 29.5
    lamp = (u * up_in_cam[0] + v * up_in_cam[1]) > 15
    colors = np.where(lamp[..., None], 250, 10).astype(np.uint8).repeat(3, axis=2)
    depths = np.full((1, 60, 60), 2.0)
    camera = replace(CAMERA, width=60, height=60, cx=29.5, cy=29.5)
    scan = scan_from_arrays(colors[None], depths, camera, pose[None])
    image = np.asarray(Image.open(io.BytesIO(make_pictures(scan, pose[None], 1, Runtime())[0])))
    assert image[:10].mean() > 200
    assert image[-10:].mean() < 50


def test_a_camera_that_looks_at_the_floor_is_not_turned():
    assert quarter_turns(look([0.0, 0.0, 1.5], 70.0, pitch_deg=85.0)) == 0


def test_frames_without_colour_are_shown_by_depth():
    depths = np.full((1, 60, 80), 4.0)
    depths[:, :, :40] = 1.0
    depths[:, :5] = np.nan
    scan = scan_from_arrays(None, depths, replace(CAMERA, width=80, height=60), np.eye(4)[None])
    pose = look([0.0, 0.0, 1.5], 0.0)[None]
    image = np.asarray(Image.open(io.BytesIO(make_pictures(scan, pose, 1, Runtime())[0])))
    assert image[30:, :30].mean() > 240
    assert image[30:, 50:].mean() < 60
    assert image[:3].mean() < 20


def test_without_a_scene_the_page_has_no_view():
    html = make_report("room", room_plan(), make_result(), "")
    assert "view-scene" not in html
    assert "WebGL" not in html
    assert len(html) < 3_000_000


def test_names_of_frames_cannot_leave_their_script():
    scene, _ = room_scene()
    frames = (replace(scene.frames[0], name="</script><b>"), *scene.frames[1:])
    html = view_of(replace(scene, frames=frames))
    assert "</script><b>" not in html
    decoded, _ = decode(html)
    assert decoded["frames"][0]["id"] == "</script><b>"


def test_names_that_are_no_text_are_written():
    """Of a file whose name is of another alphabet's encoding."""
    scene, _ = room_scene()
    name = b"frame-\xff.jpg".decode("utf-8", "surrogateescape")
    html = view_of(replace(scene, frames=(replace(scene.frames[0], name=name), *scene.frames[1:])))
    decoded, _ = decode(html.encode().decode())
    assert decoded["frames"][0]["id"] == name


def test_what_is_told_of_a_frame_takes_little_of_the_page():
    """25,000 frames and 2 million points are to stay below 25 MB."""
    scene, _ = room_scene()
    head, _ = view_data(scene)
    many, _ = view_data(
        replace(
            scene,
            frames=scene.frames * 10,
            before=np.tile(scene.before, (10, 1, 1)),
            after=np.tile(scene.after, (10, 1, 1)),
        )
    )
    n_more = 9 * len(scene.frames)
    assert (len(many) - len(head)) / n_more < 220
    decoded, _ = decode(view_of(scene))
    told = decoded["frames"][3]
    frame = scene.frames[3]
    assert (told["id"], told["moved"], told["predicted"]) == (
        frame.name,
        frame.moved,
        frame.predicted,
    )
    assert told["floor"] == pytest.approx(frame.floor_m - scene.origin[2], abs=1e-3)
    assert bool(told["isAfterGap"]) is frame.is_after_gap


def test_a_scan_of_which_nothing_is_placed_still_makes_a_page():
    scene, _ = room_scene()
    none = ScenePoints(
        np.zeros((0, 3), np.float32),
        np.zeros((0, 3), np.uint8),
        np.zeros(13, int),
        np.zeros((2, 0)),
    )
    _, points = decode(view_of(replace(scene, points=none)))
    assert points == []
