"""From a result and a sample of its points to the scene of the 3D view: its walls with their verdicts, and
small pictures of some frames, the right way up."""

import io
import itertools
from collections.abc import Iterator, Mapping
from functools import partial

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8
from PIL import Image

from planfit.adjust.uncertainty import radius_95
from planfit.as_built import AsBuilt, AsBuiltWall, Verdict, in_words
from planfit.floorplan import Floorplan
from planfit.floorplan.nearest_faces import nearest_distance
from planfit.geometry import se3
from planfit.pipeline.result import RefineResult
from planfit.priors import DRAWING_ROUNDING_M, WALL_HEIGHT_M
from planfit.report import formatting
from planfit.report.plots.top_view import find_gaps
from planfit.report.scene import FAR_M, Scene, SceneFrame, ScenePoints, SceneWall
from planfit.runtime import Arrays, Runtime, cache_key
from planfit.scan import Scan
from planfit.segmentation import NO_STOREY

_OVER_CAMERAS_M = 0.4
"""Points higher than this over the highest camera are hidden at first: a ceiling, as a rule."""
_STEP_M, _TURN_RAD = 0.6, 0.6
"""A camera is drawn this far from the one drawn before it, or turned by this much: nearer ones hide each
other."""
_EDGE_PERCENT = 0.5
"""Share of the points on either side that what is seen first need not hold: strays through windows."""
_MARGIN_M = 3.0
"""Walls further from the scan are left out: a plan may be of a whole campus."""
_LEAST_LENGTH_M = DRAWING_ROUNDING_M.value
_STATUS = {
    Verdict.AGREES: "agrees",
    Verdict.MOVED: "moved",
    Verdict.MISSING: "missing",
    Verdict.NOT_SEEN: "unseen",
}


def make_scene(
    scan: Scan,
    result: RefineResult,
    points_cam: Float[np.ndarray, "m 3"],
    colors: UInt8[np.ndarray, "m 3"],
    start: Int[np.ndarray, " starts"],
    pictures: Mapping[int, bytes],
    as_built: AsBuilt | None = None,
) -> Scene:
    """The scene of a run.

    Args:
        scan: that was refined.
        result: of `planfit.refine`.
        points_cam: a sample of its points, m, in the axes of the cameras that saw them, frame by frame.
        colors: RGB of each.
        start: (n + 1,), points of frame i are start[i]:start[i + 1].
        pictures: JPEGs of some frames, by frame.
        as_built: verdicts on the walls of the plan; without, no wall is shown.
    """
    sides = (result.initial_plan_from_cams, result.plan_from_cams)
    frame_idx = np.repeat(np.arange(len(scan)), np.diff(start))
    placed = [se3.transform_indexed(poses, frame_idx, points_cam) for poses in sides]
    bounds = _bounds(placed[1], result.plan_from_cams[:, :3, 3])
    plan = result.floorplan if result.alignment is not None else None
    distances = None
    if plan is not None:
        distances = np.stack([_plan_distances(result, points, start) for points in placed])
    is_placed = np.ones(len(scan), dtype=bool)
    for first, last in result.evidence.unplaced:
        is_placed[first : last + 1] = False
    return Scene(
        origin=bounds.mean(axis=0).round(3),
        bounds=bounds,
        cut_m=float(result.plan_from_cams[:, 2, 3].max()) + _OVER_CAMERAS_M,
        before=sides[0],
        after=sides[1],
        points=ScenePoints(points_cam, colors, start, distances),
        frames=_frames(scan, result, is_placed),
        keyframe_idx=_drawn_cameras(result),
        walls=()
        if plan is None or as_built is None
        else scene_walls(plan, result, bounds, as_built),
        pictures=pictures,
    )


def _bounds(
    points: Float[np.ndarray, "m 3"], centres: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "2 3"]:
    """Corners (m) of a box around the cameras and all points but strays."""
    corners = [centres.min(axis=0), centres.max(axis=0)]
    if len(points):
        corners += list(np.percentile(points, [_EDGE_PERCENT, 100 - _EDGE_PERCENT], axis=0))
    return np.stack([np.min(corners, axis=0), np.max(corners, axis=0)])


def _plan_distances(
    result: RefineResult, points: Float[np.ndarray, "m 3"], start: Int[np.ndarray, " starts"]
) -> Float[np.ndarray, " m"]:
    """Distance (m) of points to the nearest face from above, of their own storey where there are several; no
    more than `FAR_M`."""
    plan, storeys = result.floorplan, result.structure.storeys
    assert plan is not None
    distances = np.full(len(points), FAR_M)
    low, high = plan.ends.min(axis=1) - FAR_M, plan.ends.max(axis=1) + FAR_M
    for i, (first, last) in enumerate(itertools.pairwise(start)):
        if first == last:
            continue
        # Faces near the points of one frame are a tenth of a building's.
        xy = points[first:last, :2]
        near = np.all((low <= xy.max(axis=0)) & (high >= xy.min(axis=0)), axis=1)
        if plan.storeys is not None and storeys is not None:
            near &= plan.storeys == storeys[i]
        found = nearest_distance(xy, plan.ends[near])
        distances[first:last] = np.minimum(found, FAR_M)
    return distances


def _frames(scan: Scan, result: RefineResult, is_placed: np.ndarray) -> tuple[SceneFrame, ...]:
    correction = se3.difference(result.plan_from_cams, result.initial_plan_from_cams)
    moved_m = np.linalg.norm(correction[:, 3:], axis=1)
    turned_deg = np.rad2deg(np.linalg.norm(correction[:, :3], axis=1))
    radius_m = radius_95(result.evidence.pose_covariances[:, 3:, 3:])
    gaps = set((find_gaps(result.plan_from_cams[:, :3, 3]) + 1).tolist())
    gaps |= {own.first for own in result.scans if own.first > 0}
    floors = _floors_m(result)
    has_times = not np.array_equal(scan.timestamps, np.round(scan.timestamps))
    frames = []
    for i, camera in enumerate(scan.cameras):
        predicted = f"{formatting.centimetres(float(radius_m[i]))} (95 %)"
        if not is_placed[i]:
            predicted = "nothing says where it stands"
        since = float(scan.timestamps[i] - scan.timestamps[0])
        frames.append(
            SceneFrame(
                name=scan.frame_ids[i],
                time=f"{since:.1f}{formatting.SPACE}s after the first" if has_times else "",
                moved=f"{formatting.length(float(moved_m[i]))}, "
                f"{turned_deg[i]:.2f}{formatting.SPACE}deg",
                predicted=predicted,
                tangents=(camera.width / 2 / camera.fx, camera.height / 2 / camera.fy),
                floor_m=float(floors[i]),
                is_after_gap=i in gaps,
            )
        )
    return tuple(frames)


def _drawn_cameras(result: RefineResult) -> Int[np.ndarray, " k"]:
    """Of the frames that were solved for, those that stand or look elsewhere than the last one taken."""
    drawn: list[int] = []
    for i in result.solved_frame_idx.tolist():
        if drawn:
            step = se3.inverse(result.plan_from_cams[drawn[-1]]) @ result.plan_from_cams[i]
            turned = float(se3.rotation_angle(step[:3, :3]))
            if np.linalg.norm(step[:3, 3]) < _STEP_M and turned < _TURN_RAD:
                continue
        drawn.append(i)
    return np.array(drawn, dtype=int)


def _floors_m(result: RefineResult) -> Float[np.ndarray, " n"]:
    """Height of the floor under each frame, m; on stairs, that of the storey walked last."""
    floors = np.zeros(len(result.plan_from_cams))
    if result.storeys is None:
        return floors
    last = 0.0
    for i, storey in enumerate(result.storeys.of_frames):
        if storey != NO_STOREY:
            last = result.storeys.walked[int(storey)].floor_m
        floors[i] = last
    return floors


def scene_walls(
    floorplan: Floorplan,
    result: RefineResult,
    bounds: Float[np.ndarray, "2 3"],
    as_built: AsBuilt,
) -> tuple[SceneWall, ...]:
    """Faces of the plan near the scan and those that it tells of, and walls that the plan lacks."""
    judged = {w.face_idx: (n, w) for n, w in enumerate(as_built.walls, 1) if w.face_idx >= 0}
    low, high = bounds[0, :2] - _MARGIN_M, bounds[1, :2] + _MARGIN_M
    near = np.all(
        (floorplan.ends.max(axis=1) >= low) & (floorplan.ends.min(axis=1) <= high), axis=1
    )
    # What was seen through a window is further away than nearly all points, and in the table all the same.
    told = [f for f, (_, w) in judged.items() if as_built.verdict(w) is not Verdict.NOT_SEEN]
    near[told] = True
    shown = np.flatnonzero(near & (floorplan.lengths >= _LEAST_LENGTH_M)).tolist()
    of_plan = [_wall(floorplan, result, face, judged.get(face), as_built) for face in shown]
    # Of several storeys nothing tells the floor that a new wall stands on.
    new = _new_walls(as_built) if floorplan.storeys is None else ()
    return (*of_plan, *new)


def _new_walls(as_built: AsBuilt) -> Iterator[SceneWall]:
    """Walls that the plan does not draw; as faces they are numbered -1, -2 by their numbers in the table."""
    for number, wall in enumerate(as_built.walls, 1):
        if wall.face_idx < 0:
            yield SceneWall(
                face_idx=-number,
                ends=wall.ends,
                normal=wall.normal,
                heights=(0.0, WALL_HEIGHT_M.value),
                status="new",
                title=f"Wall No. {number}, which the plan lacks",
                rows=(("As built", in_words(wall, as_built.verdict(wall))),),
            )


def _wall(
    floorplan: Floorplan,
    result: RefineResult,
    face: int,
    judged: tuple[int, AsBuiltWall] | None,
    as_built: AsBuilt,
) -> SceneWall:
    """A face of the plan with its number in the table and its verdict, where it has one."""
    floor_m = _floor_m(floorplan, result, face)
    length = ("Length", formatting.length(float(floorplan.lengths[face])))
    status, title = "unseen", "A short wall of the plan, not judged"
    rows: tuple[tuple[str, str], ...] = (length,)
    if judged is not None:
        number, wall = judged
        verdict = as_built.verdict(wall)
        seen = ", not seen" if verdict is Verdict.NOT_SEEN else ""
        status, title = _STATUS[verdict], f"Wall No. {number} of the plan{seen}"
        rows = (("As built", in_words(wall, verdict)), ("Patches", str(wall.n_patches)), length)
    return SceneWall(
        face_idx=face,
        ends=floorplan.ends[face],
        normal=floorplan.normals[face],
        heights=(floor_m, floor_m + WALL_HEIGHT_M.value),
        status=status,
        title=title,
        rows=rows,
    )


def _floor_m(floorplan: Floorplan, result: RefineResult, face: int) -> float:
    """Height of the floor that a face stands on, m."""
    if floorplan.storeys is None or result.storeys is None:
        return 0.0
    return result.storeys.walked[int(floorplan.storeys[face])].floor_m


WIDTH_PX = 320
_QUALITY = 60


def frames_with_pictures(n_frames: int, max_pictures: int) -> Int[np.ndarray, " k"]:
    """Frames to show pictures of, evenly spread, first and last among them."""
    if max_pictures == 0:
        return np.zeros(0, dtype=int)
    return np.unique(np.linspace(0, n_frames - 1, min(n_frames, max_pictures)).round().astype(int))


def make_pictures(
    scan: Scan, plan_from_cams: Float[np.ndarray, "n 4 4"], max_pictures: int, runtime: Runtime
) -> dict[int, bytes]:
    """JPEGs by frame: colour, or nearness in grey where a frame has none; turned so that up is up."""
    chosen = frames_with_pictures(len(scan), max_pictures)
    turns = [quarter_turns(plan_from_cams[i]) for i in chosen]
    key = cache_key(scan.fingerprint, WIDTH_PX, _QUALITY, chosen.tolist(), turns)
    make = partial(_picture, scan, chosen, turns)
    found = runtime.map("pictures", key, len(chosen), make)
    return {int(i): item["jpeg"].tobytes() for i, item in zip(chosen, found, strict=True)}


def quarter_turns(plan_from_cam: Float[np.ndarray, "4 4"]) -> int:
    """Quarter turns, counter-clockwise, that bring what is up in the plan up in the image; 0 where the camera
    looks along it."""
    right, down = plan_from_cam[2, :2]  # heights of the camera's axes
    if np.hypot(right, down) < 0.3:
        return 0
    # Up in the image is -down: its angle from there, to the nearest quarter.
    return int(np.round(np.arctan2(right, -down) / (np.pi / 2))) % 4


def _picture(scan: Scan, chosen: Int[np.ndarray, " k"], turns: list[int], k: int) -> Arrays:
    frame = int(chosen[k])
    image = scan.files.color(frame)
    if image is None:
        image = depth_in_grey(scan.files.depth(frame))
    height = max(1, round(image.shape[0] * WIDTH_PX / image.shape[1]))
    if image.shape[1] > WIDTH_PX:
        image = cv2.resize(image, (WIDTH_PX, height), interpolation=cv2.INTER_AREA)
    buffer = io.BytesIO()
    turned = np.ascontiguousarray(np.rot90(image, turns[k]))
    Image.fromarray(turned).save(buffer, "JPEG", quality=_QUALITY)
    return {"jpeg": np.frombuffer(buffer.getvalue(), dtype=np.uint8)}


def depth_in_grey(depth: Float[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 3"]:
    """Near is white, far is dark, unknown is black."""
    known = np.isfinite(depth) & (depth > 0)
    if not known.any():
        return np.zeros((*depth.shape, 3), dtype=np.uint8)
    near, far = np.percentile(depth[known], [1, 99])
    share = np.clip((depth - near) / max(far - near, 1e-6), 0.0, 1.0)
    grey = np.where(known, 255 - 215 * share, 0).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)
