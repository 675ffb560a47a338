"""A scan of one room for the 3D view, whose every pixel's place is known, and a decoder of its own."""

import base64
import json
import re
import zlib
from dataclasses import replace

import numpy as np

from planfit.as_built import AsBuilt, AsBuiltOptions, AsBuiltWall
from planfit.floorplan import Floorplan
from planfit.geometry import se3, segments
from planfit.geometry.camera import Camera
from planfit.report.html.page import make_report
from planfit.report.html.view_section import view_data, view_section
from planfit.report.make_scene import make_pictures, make_scene
from planfit.runtime import Runtime
from planfit.scan import scan_from_arrays
from test_report import DEPTH, WIDTH, make_result

RED, GREEN, BLUE, GREY = (220, 20, 20), (20, 200, 20), (30, 30, 230), (120, 120, 120)
WALL_COLORS = (GREY, RED, GREEN, BLUE)
"""Of the walls at y = 0, x = WIDTH, y = DEPTH, x = 0."""
PER_FRAME = 900


def room_points(result, offsets=(0.0, 0.0, 0.0, 0.0)):
    """Points in camera axes, colours and starts: frame i sees the lower 2 m of wall i % 4."""
    rng = np.random.default_rng(1)
    points, colors = [], []
    for i, pose in enumerate(result.plan_from_cams):
        wall, d = i % 4, offsets[i % 4]
        along = rng.uniform(0.5, 5.5, PER_FRAME)
        across = (d, WIDTH - d, DEPTH - d, d)[wall] + 0 * along
        x, y = (along, across) if wall in (0, 2) else (across, along)
        in_plan = np.stack([x, y, rng.uniform(0.3, 2.0, PER_FRAME)], axis=1)
        points.append(se3.transform(se3.inverse(pose), in_plan))
        colors.append(np.tile(np.array(WALL_COLORS[wall], dtype=np.uint8), (PER_FRAME, 1)))
    start = PER_FRAME * np.arange(len(points) + 1)
    return np.concatenate(points).astype(np.float32), np.concatenate(colors), start


def room_scan(result):
    """Frame i shows one colour, brighter from frame to frame; camera in the plan's axes."""
    n = len(result.plan_from_cams)
    colors = [np.full((60, 80, 3), (20 * i, 40, 40), dtype=np.uint8) for i in range(n)]
    depths = [np.full((60, 80), 2.0, dtype=np.float32) for _ in range(n)]
    camera = Camera(80, 60, 70.0, 70.0, 39.5, 29.5)
    return scan_from_arrays(colors, depths, camera, result.initial_plan_from_cams)


def room_plan():
    """The four walls, normals into the room."""
    corners = np.array([[0.0, 0.0], [WIDTH, 0.0], [WIDTH, DEPTH], [0.0, DEPTH]])
    ends = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
    return Floorplan("room.npy", ends, segments.left_normals(ends), np.full(4, True))


def room_scene(
    n_frames=12, max_pictures=120, offsets=(0.0, 0.0, 0.0, 0.0), result=None, as_built=None
):
    """The room's scene and the result it is of."""
    seen = make_result(n_frames, offsets)
    result = result or replace(seen, floorplan=room_plan())
    scan = room_scan(result)
    pictures = make_pictures(scan, result.plan_from_cams, max_pictures, Runtime())
    as_built = as_built or room_as_built(offsets)
    return make_scene(scan, result, *room_points(seen, offsets), pictures, as_built), result


def room_report(**arguments):
    """Its report as HTML, and the scene."""
    as_built = room_as_built(arguments.get("offsets", (0.0,) * 4))
    scene, result = room_scene(**arguments, as_built=as_built)
    return make_report("room", result.floorplan, result, "", scene=scene, as_built=as_built), scene


def room_as_built(offsets):
    """Verdicts on its walls, and one that the plan lacks, from (2, 2) to (4, 2)."""
    plan = room_plan()
    walls = zip(plan.ends, plan.normals, offsets, strict=True)
    new = AsBuiltWall(
        -1, np.array([[4.0, 2.0], [2.0, 2.0]]), np.array([0.0, -1.0]), True, 0.0, 0.01, 3, 3, 0.0
    )
    return AsBuilt(
        (
            *(
                AsBuiltWall(k, ends, normal, True, offset_m, 0.01, 3, 3, 0.0)
                for k, (ends, normal, offset_m) in enumerate(walls)
            ),
            new,
        ),
        AsBuiltOptions(),
        plan.name,
    )


def view_of(scene):
    """The part of a report that is the 3D view, without the plots, which take seconds."""
    return view_section(scene) + "".join(view_data(scene))


def decode(html):
    """Slow and plain twin of `html/view/scene.js`: the scene's JSON, and every point of all levels as (frame,
    point in the axes of its camera, colour, distances)."""
    found = re.search(r'id="view-scene">(.*?)</script>', html, re.S)
    scene = json.loads(found[1])
    for name, shape in (("before", (-1, 3, 4)), ("after", (-1, 3, 4)), ("tiles", (-1, 2, 3))):
        scene[name] = np.frombuffer(base64.b64decode(scene[name]), "<f4").reshape(shape)
    n = len(scene["frames"]["id"])
    columns = {k: v * n if len(v) == 1 else v for k, v in scene["frames"].items()}
    scene["frames"] = [
        dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)
    ]
    points = []
    for block in re.findall(r'class="view-points">(.*?)</script>', html, re.S):
        data = zlib.decompress(base64.b64decode(block))
        n_frames = len(scene["frames"])
        counts = np.frombuffer(data, "<u4", n_frames)
        n = int(counts.sum())
        if n == 0:
            continue
        planes = np.frombuffer(data, np.uint8, offset=4 * n_frames).reshape(-1, n).astype(int)
        q = [np.cumsum(planes[2 * a] + 256 * planes[2 * a + 1]) % 65536 for a in range(3)]
        rgb = [np.cumsum(planes[6 + a]) % 256 for a in range(3)]
        frame = np.repeat(np.arange(n_frames), counts)
        for i in range(n):
            origin, step = scene["tiles"][frame[i]]
            at = [float(origin[a]) + float(step[a]) * int(q[a][i]) for a in range(3)]
            points.append((int(frame[i]), at, [int(c[i]) for c in rgb], planes[9:, i].tolist()))
    return scene, points
