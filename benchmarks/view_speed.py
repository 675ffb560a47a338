"""How fast the report's 3D view opens, turns and finds a point, by the number of points.

    python benchmarks/view_speed.py [--points 1 2 10] [--json FILE]

Points (millions) lie on the walls and floor of rooms in a row, seen by 400 cameras, in one page as reports
are. Chromium without a GPU, WebGL by software. "first points" and "whole" are of the page's own clock; a turn
draws as many levels as keep to 30 ms, "all" is one picture of all points; "pick" is the search for the point
under a press.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path

import numpy as np
from chromium import driven_chromium, set_size

from planfit.geometry import se3
from planfit.report.html.page import page_of
from planfit.report.html.view_section import view_section
from planfit.report.scene.scene import Scene, SceneFrame, ScenePoints

N_FRAMES = 400
SIZE = (1200, 900)
_FRAME = SceneFrame("0", "", "", "", (0.6, 0.45), 0.0, False)


def make_scene(n_points: int) -> Scene:
    """Rooms of 5 x 4 m in a row; each camera sees a corner of its own."""
    rng = np.random.default_rng(0)
    rooms = np.repeat(np.arange(20), N_FRAMES // 20)
    poses = np.tile(np.eye(4), (N_FRAMES, 1, 1))
    poses[:, :3, 3] = np.stack([5.0 * rooms + 2.5, 2.0 + 0 * rooms, 1.5 + 0 * rooms], axis=1)
    each = n_points // N_FRAMES
    at = rng.uniform(size=(N_FRAMES, each, 3)) * [5.0, 4.0, 2.5]
    side = rng.integers(3, size=(N_FRAMES, each))
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
        each * np.arange(N_FRAMES + 1),
        np.tile(np.minimum(np.abs(at[..., 1] - 2.0), 0.5).reshape(-1), (2, 1)),
    )
    return Scene(
        bounds.mean(axis=0), bounds, 3.0, before, poses, points, (_FRAME,) * N_FRAMES,
        np.full(N_FRAMES, True), np.arange(0, N_FRAMES, 4), (), {},
    )  # fmt: skip


def measure(n_points: int, folder: Path) -> dict[str, float]:
    """Of one page, in a browser of its own."""
    begin = time.perf_counter()
    scene = make_scene(n_points)
    page = folder / "view.html"
    page.write_text(page_of("view", [view_section(scene)], scene), encoding="utf-8")
    found = {"points": n_points, "page_mb": page.stat().st_size / 1e6}
    found["written_s"] = time.perf_counter() - begin
    with driven_chromium() as browser:
        set_size(browser, *SIZE)
        browser.set_page_load_timeout(300)
        browser.get(page.as_uri())
        end = time.monotonic() + 300
        ready = "return document.getElementById('view').dataset.state"
        while browser.execute_script(ready) != "ready" and time.monotonic() < end:
            time.sleep(0.1)
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
            "return (performance.now() - begin) / 1000"
        )
    return found


def main() -> None:
    """A row for each size."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=float, nargs="+", default=[1, 2, 10])
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    rows = []
    for millions in arguments.points:
        with tempfile.TemporaryDirectory() as folder:
            row = measure(int(1e6 * millions), Path(folder))
        print(", ".join(f"{name} {value:.4g}" for name, value in row.items()), flush=True)
        rows.append(row)
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
