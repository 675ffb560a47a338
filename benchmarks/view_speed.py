"""How fast the report's 3D view opens, turns and finds a point, by the number of points.

    python benchmarks/view_speed.py [--points 1 2 10] [--frames 400 25000] [--served] [--json FILE]

Points (millions) lie on the walls and floor of rooms in a row, seen by cameras, in one page as reports are;
with `--served`, in a folder as of a run that `planfit view` serves, with its panel, a plan and the way on it.
Chromium without a GPU, WebGL by software. "first points" and "whole" are of the page's own clock; a turn
draws as many levels as keep to 30 ms, "all" is one picture of all points; "pick" is the search for the point
under a press; "ready" is until view and panel are, from asking for the page on; "state", "plan" and "shape"
are what the panel asks for; "frame" is from the slider to that frame's image; "heap" is of JavaScript.
"""

import argparse
import itertools
import json
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, cast
from urllib.request import urlopen

import numpy as np
from chromium import driven_chromium, set_size

from planfit.export.cloud import write_ply
from planfit.floorplan import Floorplan
from planfit.geometry import se3
from planfit.geometry.camera import Camera
from planfit.report.html.page import page_of
from planfit.report.html.view_section import view_section
from planfit.report.scene import Scene, SceneFrame, ScenePoints
from planfit.scan import Scan
from planfit.viewer import Session, ViewServer

N_ROOMS = 20
SIZE = (1200, 900)
_FRAME = SceneFrame("0", "", "", "", (0.6, 0.45), 0.0, False)


def make_scene(n_points: int, n_frames: int) -> Scene:
    """Rooms of 5 x 4 m in a row, round whose middles cameras go, 2 cm a frame; each sees a corner of its own.
    Cameras that are drawn are 0.6 m apart, as reports draw them."""
    rng = np.random.default_rng(0)
    rooms = np.arange(n_frames) * N_ROOMS // n_frames
    poses = np.tile(np.eye(4), (n_frames, 1, 1))
    angle = np.arange(n_frames) * 0.02
    poses[:, 0, 3] = 5.0 * rooms + 2.5 + np.cos(angle)
    poses[:, 1, 3], poses[:, 2, 3] = 2.0 + np.sin(angle), 1.5
    each = n_points // n_frames
    at = rng.uniform(size=(n_frames, each, 3)) * [5.0, 4.0, 2.5]
    side = rng.integers(3, size=(n_frames, each))
    for axis, value in ((0, 0.0), (1, 4.0), (2, 0.0)):
        at[..., axis][side == axis] = value
    at += rng.normal(0, 0.005, at.shape)
    at[..., 0] += 5.0 * rooms[:, None]
    # As pixels follow each other, so that differences compress as those of images do.
    at = np.take_along_axis(at, np.argsort(at[..., 0], axis=1)[..., None], axis=1)
    in_cams = at - poses[:, None, :3, 3]
    colors = (90 + 40 * at + rng.normal(0, 8, at.shape)).clip(0, 255).astype(np.uint8)
    before = se3.make_transform(np.eye(3), np.array([0.2, 0.1, 0.0])) @ poses
    bounds = np.array([[0.0, 0.0, 0.0], [100.0, 4.0, 2.5]])
    points = ScenePoints(
        in_cams.reshape(-1, 3).astype(np.float32),
        colors.reshape(-1, 3),
        each * np.arange(n_frames + 1),
        np.tile(np.minimum(np.abs(at[..., 1] - 2.0), 0.5).reshape(-1), (2, 1)),
    )
    return Scene(
        bounds.mean(axis=0), bounds, 3.0, before, poses, points, (_FRAME,) * n_frames,
        np.arange(0, n_frames, max(4, n_frames // 830)), (), {},
    )  # fmt: skip


def measure(n_points: int, n_frames: int, is_served: bool, folder: Path) -> dict[str, float]:
    """Of one page, in a browser of its own."""
    begin = time.perf_counter()
    scene = make_scene(n_points, n_frames)
    page = folder / "report.html"
    page.write_text(page_of("view", [view_section(scene)], scene), encoding="utf-8")
    found = {"points": n_points, "frames": n_frames, "page_mb": page.stat().st_size / 1e6}
    found["written_s"] = time.perf_counter() - begin
    with ExitStack() as stack:
        address = page.as_uri()
        if is_served:
            server = stack.enter_context(served(folder, scene))
            address = server.address
            found |= answers(server)
        browser = stack.enter_context(driven_chromium())
        set_size(browser, *SIZE)
        browser.set_page_load_timeout(300)
        begin = time.monotonic()
        browser.get(address)
        ready = "document.getElementById('view').dataset.state === 'ready'"
        if is_served:
            ready += " && document.getElementById('hand').dataset.ready === '1'"
        while not browser.execute_script(f"return {ready}") and time.monotonic() < begin + 300:
            time.sleep(0.1)
        found["ready_s"] = time.monotonic() - begin
        found |= pictures_of(browser)
        found["heap_mb"] = browser.execute_script("return performance.memory.usedJSHeapSize / 1e6")
        if is_served:
            found |= panel_of(browser)
    return found


def pictures_of(browser: Any) -> dict[str, float]:
    """Of the 3D view."""
    found = {}
    for name, mark in (("first_s", "view-first"), ("whole_s", "view-whole")):
        found[name] = browser.execute_script(
            "return performance.getEntriesByName(arguments[0])[0].startTime / 1000", mark
        )
    # Whole pictures asked for one after the other while it turns.
    found["turning_fps"] = browser.execute_async_script(
        "const done = arguments[0], { view } = document.getElementById('view');"
        "let n = 0, begin = null; const paint = view.onPaint;"
        "view.onPaint = () => { n += 1; if (n === 5) begin = performance.now();"
        " if (n < 25) return requestAnimationFrame(() => view.orbit.turn(0.02, 0));"
        " view.onPaint = paint; done(20000 / (performance.now() - begin)); };"
        "view.orbit.turn(0.02, 0)"
    )
    time.sleep(1.0)
    found["all_s"] = browser.execute_async_script(
        "const done = arguments[0], { view } = document.getElementById('view');"
        "view.isMoving = false; view.paint(); setTimeout(() => done(view.paintMs / 1000))"
    )
    found["pick_s"] = browser.execute_script(
        "const { view } = document.getElementById('view'); let found;"
        "view.onPoint = (point) => (found = point); const r = view.canvas.getBoundingClientRect();"
        "const begin = performance.now();"
        "view.pick({clientX: r.left + r.width / 2, clientY: r.top + r.height / 2});"
        "const took = performance.now() - begin; view.onPoint = null; return took / 1000"
    )
    return found


def panel_of(browser: Any) -> dict[str, float]:
    """Of the panel: a frame chosen by the slider until its image is shown, the scan dragged over the plan."""
    found = {}
    found["frame_s"] = browser.execute_async_script(
        "const done = arguments[0], slider = document.querySelector('.view-frame');"
        "const image = document.querySelector('.hand-picture img'), begin = performance.now();"
        "image.addEventListener('load', () => done((performance.now() - begin) / 1000), { once: true });"
        "slider.value = slider.max / 2; slider.dispatchEvent(new Event('input'))"
    )
    found["drag_fps"] = browser.execute_async_script(
        "const done = arguments[0], svg = document.querySelector('.hand-plan svg');"
        "document.querySelector('.hand-drag').click(); svg.scrollIntoView({ block: 'center' });"
        "const begun = () => document.querySelector('.hand-scan path') ? step() : setTimeout(begun, 20);"
        "let n = 0, begin; const step = () => { if (n === 3) begin = performance.now(); n += 1;"
        " if (n === 23) return done(20000 / (performance.now() - begin));"
        " svg.dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowLeft' }));"
        " requestAnimationFrame(step); };"
        "begun()"
    )
    return found


class _Images:
    """Images of a made-up scan: one for all frames."""

    def color(self, frame_idx: int) -> np.ndarray:
        return np.full((240, 320, 3), 90 + frame_idx % 100, dtype=np.uint8)


@contextmanager
def served(folder: Path, scene: Scene) -> Iterator[ViewServer]:
    """A folder as of a run with this scene, served."""
    n_frames = len(scene.frames)
    rows = np.zeros((n_frames, 8))
    rows[:, 0], rows[:, 1:4], rows[:, 7] = np.arange(n_frames), scene.after[:, :3, 3], 1.0
    np.savetxt(folder / "trajectory.tum", rows, fmt="%.6f")
    counts = np.diff(scene.points.start)
    poses = np.repeat(np.arange(n_frames), counts)
    points = scene.points.points_cam + scene.after[poses, :3, 3]
    write_ply(folder / "cloud_after.ply", points, scene.points.colors)
    visits = [
        {"first_frames": [k, k + 20], "last_frames": [k + 900, k + 930], "after_m": 0.01, "kept_out_m": 0.02}
        for k in range(0, n_frames - 1000, 40)
    ]  # fmt: skip
    record = {
        "verdict": {
            "outcome": "refined",
            "visits": visits,
            "predicted_error_m": [0.0123] * n_frames,
        },
        "alignment": None,
        "plan_from_world_before": np.eye(4).tolist(),
    }
    (folder / "run.json").write_text(json.dumps(record))
    owner = {"inputs": {}, "results": ["run.json", "report.html"]}
    (folder / ".planfit.json").write_text(json.dumps(owner))
    ends = [
        [[[5 * k, 0], [5 * k + 5, 0]], [[5 * k + 5, 0], [5 * k + 5, 4]], [[5 * k + 5, 4], [5 * k, 4]]]
        for k in range(N_ROOMS)
    ]  # fmt: skip
    camera = Camera(320, 240, 260.0, 260.0, 159.5, 119.5)
    scan = Scan(
        name="made up",
        frame_ids=tuple(f"{k:05d}" for k in range(n_frames)),
        timestamps=np.arange(n_frames) / 30,
        cameras=(camera,) * n_frames,
        world_from_cams=scene.before,
        files=cast(Any, _Images()),
    )
    plan = Floorplan.from_segments(np.concatenate(ends).astype(float))
    with ViewServer(Session(folder, scan, plan, lambda _: None)) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def answers(server: ViewServer) -> dict[str, float]:
    """Seconds and megabytes of what the page waits for."""
    found = {}
    for name in ("state", "plan", "shape"):
        begin = time.perf_counter()
        with urlopen(f"{server.address}{name}") as answer:
            content = answer.read()
        found[f"{name}_s"] = time.perf_counter() - begin
        found[f"{name}_mb"] = len(content) / 1e6
    return found


def main() -> None:
    """A row for each size."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=float, nargs="+", default=[1, 2, 10])
    parser.add_argument("--frames", type=int, nargs="+", default=[400])
    parser.add_argument("--served", action="store_true", help="by planfit view")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    rows = []
    for n_frames, millions in itertools.product(arguments.frames, arguments.points):
        with tempfile.TemporaryDirectory() as folder:
            row = measure(int(1e6 * millions), n_frames, arguments.served, Path(folder))
        print(", ".join(f"{name} {value:.4g}" for name, value in row.items()), flush=True)
        rows.append(row)
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
