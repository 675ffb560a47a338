"""Pictures of the pages that a run makes, and a recording of `planfit view`, from synthetic scans alone.

    python docs/screens.py [--runs FOLDER] [--only recording|gallery]

Writes docs/images/screen_*.png and docs/images/view.webp, by real Chromium (`.ci/browser` installs it). The
runs are kept in a folder where one is named; else they are made anew, in about five minutes.
"""

import argparse
import io
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import planfit
from planfit.cli.view import ViewArguments, open_session
from planfit.runtime import Runtime
from planfit.synth import (
    CameraOptions,
    DriftOptions,
    SynthOptions,
    WalkOptions,
    make_scan,
    write_facap,
)
from planfit.viewer import ViewServer
from planfit.viewer.points import at_rim

sys.path.insert(0, str(Path(__file__).parent.parent / "benchmarks"))
from as_built_cases import make_case
from chromium import driven_chromium, set_size

IMAGES = Path(__file__).parent / "images"
MAX_RECORDING_BYTES, MAX_PICTURE_BYTES = 3_000_000, 160_000
FRAME_MS = 180
NEAR_M, APART_M = 0.12, 3.0
"""Corners of the plan that the cloud shows are pressed, so far apart."""
SIZE = (1000, 660)
DRIFTED = SynthOptions(
    walk=WalkOptions(n_frames=160),
    camera=CameraOptions(width_px=400, height_px=300),
    drift=DriftOptions(yaw_deg=0.3, translation_m=0.025),
)
WRONG_PLAN_SEED = 22
"""Of the buildings of benchmarks/as_built.py; one of those that rules were chosen on."""


def drifted_run(folder: Path) -> Path:
    """A scan that drifted, on the plan of its building; made where it is not there."""
    run, scan_folder = folder / "drifted", folder / "scan"
    if not (run / "report.html").exists():
        write_facap(scan_folder, make_scan(DRIFTED), lambda *_: None, 2)
        plan = planfit.read_floorplan(scan_folder / "floorplan.npy")
        scan, runtime = planfit.read_scan(scan_folder), Runtime(2, run / "cache")
        planfit.refine(scan, plan, runtime=runtime).save(run)
    return run


def wrong_plan_run(folder: Path) -> Path:
    """A scan on a plan with walls moved, left out, and drawn that were never built."""
    run = folder / "wrong_plan"
    if not (run / "report.html").exists():
        case = make_case(WRONG_PLAN_SEED, folder)
        planfit.refine(case.scan, case.plan, runtime=Runtime(2)).save(run)
    return run


class Page:
    """A page that is pressed and looked at."""

    def __init__(self, browser: Any, address: str) -> None:
        self.browser = browser
        browser.get(address)
        self.wait_for("document.getElementById('view').dataset.state === 'ready'")

    def run(self, script: str, *arguments: Any) -> Any:
        """What a script returns."""
        return self.browser.execute_script(script, *arguments)

    def wait_for(self, condition: str, seconds: float = 60) -> None:
        """Until it is true."""
        end = time.monotonic() + seconds
        while not self.run(f"return {condition}"):
            if time.monotonic() > end:
                raise TimeoutError(f"{condition}: {self.browser.get_log('browser')}")
            time.sleep(0.05)

    def settle(self) -> None:
        """Until what changed is drawn."""
        self.browser.execute_async_script(
            "const done = arguments[0]; setTimeout(() => requestAnimationFrame(() => "
            "requestAnimationFrame(done)), 260)"
        )

    def picture(self) -> Image.Image:
        """What the window shows."""
        return Image.open(io.BytesIO(self.browser.get_screenshot_as_png())).convert("RGB")

    def show(self, selector: str, block: str = "start") -> None:
        """Scroll to something."""
        self.run(f"document.querySelector('{selector}').scrollIntoView({{block: '{block}'}})")

    def unfold(self) -> None:
        """Open all sections."""
        self.run("document.querySelectorAll('details.section').forEach((s) => (s.open = true))")

    def press(self, selector: str) -> None:
        """Press a control."""
        self.run(f"document.querySelector('{selector}').click()")


class Recording:
    """Frames of a page, and how long each stands."""

    def __init__(self, page: Page) -> None:
        self.page, self.frames, self.times = page, [], []

    def take(self, ms: int = FRAME_MS) -> None:
        """As it is now."""
        self.frames.append(self.page.picture())
        self.times.append(ms)

    def hold(self, ms: int) -> None:
        """The last one stands so much longer."""
        self.times[-1] += ms

    def write(self, path: Path) -> None:
        """As an animated WebP, as good as its size allows."""
        for quality in (80, 60, 45, 30):
            self.frames[0].save(
                path, save_all=True, append_images=self.frames[1:], duration=self.times, loop=0,
                quality=quality, method=4,
            )  # fmt: skip
            if path.stat().st_size <= MAX_RECORDING_BYTES:
                break
        print(
            f"{path}: {path.stat().st_size / 1e6:.1f} MB, {len(self.frames)} frames, "
            f"{sum(self.times) / 1000:.0f} s, quality {quality}"
        )


@contextmanager
def served(run: Path) -> Iterator[ViewServer]:
    """A run as `planfit view` serves it."""
    (run / "corrections.toml").unlink(missing_ok=True)
    with ViewServer(open_session(ViewArguments(run, workers=2))) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        try:
            yield server
        finally:
            server.session.wait()
            server.shutdown()
            thread.join()


def record(run: Path) -> None:
    """Turn, before and after, wipe, colours, three pairs of points, solve again; on a copy of the run."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "run"
        shutil.copytree(run, copy)
        _record(copy)


def _record(run: Path) -> None:
    with driven_chromium() as browser, served(run) as server:
        set_size(browser, *SIZE)
        page = Page(browser, server.address)
        page.wait_for("document.getElementById('hand').dataset.ready === '1'")
        page.show(".view-tools")
        page.press("input[value=before]")
        page.settle()
        tape = Recording(page)
        _turn(page, tape, 24)
        tape.hold(500)
        page.press("input[value=after]")
        for _ in range(5):
            tape.take(110)
        page.settle()
        tape.take(900)
        page.press("input[value=wipe]")
        for share in np.linspace(0.95, 0.05, 18):
            page.run(
                "const w = document.querySelector('.view-wipe'); w.value = arguments[0];"
                "w.dispatchEvent(new Event('input'))",
                float(share),
            )
            page.settle()
            tape.take(140)
        page.press("input[value=after]")
        _color(page, 2)
        page.settle()
        tape.take(1300)
        _color(page, 0)
        _place_by_pairs(page, tape, server)
        tape.write(IMAGES / "view.webp")


def _turn(page: Page, tape: Recording, n: int) -> None:
    for _ in range(n):
        page.run("document.getElementById('view').view.orbit.turn(0.05, 0)")
        page.settle()
        tape.take()


def _color(page: Page, value: int) -> None:
    page.run(
        "const c = document.querySelector('.view-color'); c.value = arguments[0];"
        "c.dispatchEvent(new Event('change'))",
        value,
    )


def _place_by_pairs(page: Page, tape: Recording, server: ViewServer) -> None:
    """Corners of the building, in the cloud and on the plan."""
    floorplan = server.session.floorplan
    page.press(".hand-pairs")
    page.show(".hand-beside")
    page.settle()
    tape.take(900)
    corners = page.run(
        "const { scene } = document.getElementById('view').view;"
        "return scene.walls.flatMap((w) => [w.ends.slice(0, 2), w.ends.slice(2)]).map("
        "(e) => [e[0] + scene.origin[0], e[1] + scene.origin[1]])"
    )
    corners = np.unique(np.round(corners, 3), axis=0)
    middle, placed = corners.mean(axis=0), []
    for xy in corners[np.argsort(-np.linalg.norm(corners - middle, axis=1))]:
        at = page.run(
            "return document.getElementById('view').view.drawnAt([...arguments[0], 0.4])",
            xy.tolist(),
        )
        is_far = all(np.linalg.norm(xy - other) > APART_M for other in placed)
        if not is_far or _distance_m(page, at, xy) > NEAR_M:
            continue
        _click(page, ".view-stage canvas", at)
        page.settle()
        time.sleep(0.3)
        if "on the plan" not in page.run(
            "return document.querySelector('.hand-status').textContent"
        ):
            continue
        tape.take(600)
        on_plan = page.run(
            "const s = document.querySelector('.hand-plan svg'), r = s.getBoundingClientRect();"
            "const p = new DOMPoint(arguments[0][0], -arguments[0][1]).matrixTransform(s.getScreenCTM());"
            "return [p.x - r.left, p.y - r.top]",
            at_rim(floorplan, xy[None], {})[0].tolist(),
        )
        _click(page, ".hand-plan svg", on_plan)
        placed.append(xy)
        page.wait_for(f"document.querySelectorAll('.hand-list li').length === {len(placed)}")
        page.settle()
        tape.take(600)
        if len(placed) == 3:
            break
    tape.hold(800)
    page.press(".hand-solve")
    page.settle()
    tape.take(700)
    server.session.wait()
    if failed := server.session.state()["failed"]:
        raise RuntimeError(failed)
    page.browser.get(server.address)
    page.wait_for("document.getElementById('hand')?.dataset.ready === '1'")
    page.show(".hand-list", "center")
    page.settle()
    tape.take(2500)


def _distance_m(page: Page, at: list[float], xy: np.ndarray) -> float:
    """How far from a corner of the plan the point is that a press would take; infinite without one."""
    script = (
        "const { view } = document.getElementById('view'), taken = view.onPoint;"
        "let found = null; view.onPoint = (point) => (found = point);"
        "const r = view.canvas.getBoundingClientRect();"
        "view.pick({clientX: r.left + arguments[0][0], clientY: r.top + arguments[0][1]});"
        "view.onPoint = taken; return found && view.inPlan(found.point, found.frame)"
    )
    found = page.run(script, at)
    return np.inf if found is None else float(np.linalg.norm(np.array(found[:2]) - xy))


def _click(page: Page, selector: str, at: list[float]) -> None:
    page.run(
        "const e = document.querySelector(arguments[0]), r = e.getBoundingClientRect();"
        "const at = {clientX: r.left + arguments[1][0], clientY: r.top + arguments[1][1], bubbles: true};"
        "e.dispatchEvent(new PointerEvent('pointerdown', {...at, pointerId: 1, button: 0}));"
        "e.dispatchEvent(new PointerEvent('pointerup', {...at, pointerId: 1}));"
        "e.dispatchEvent(new MouseEvent('click', at))",
        selector, at,
    )  # fmt: skip


def save(name: str, image: Image.Image) -> None:
    """A picture of few colours, as small as a page of docs needs."""
    path = IMAGES / f"screen_{name}.png"
    for colors, share in ((256, 1.0), (128, 1.0), (96, 0.8), (64, 0.7)):
        small = image.copy()
        small.thumbnail(tuple(int(share * side) for side in image.size), Image.Resampling.LANCZOS)
        small.quantize(colors, dither=Image.Dither.NONE).save(path, optimize=True)
        if path.stat().st_size <= MAX_PICTURE_BYTES:
            break
    print(f"{path}: {path.stat().st_size / 1000:.0f} kB, {small.width} x {small.height} px")


def gallery(drift: Path, wrong: Path) -> None:
    """The report's parts, at a desk and on a phone."""
    with driven_chromium("--force-prefers-reduced-motion") as browser:
        set_size(browser, 1400, 900)
        page = Page(browser, (drift / "report.html").as_uri())
        page.settle()
        save("verdict", page.picture())
        set_size(browser, 400, 800)
        page.settle()
        save("verdict_phone", page.picture())
        set_size(browser, 1100, 760)
        page.show(".view-tools")
        page.press("input[value=wipe]")
        page.settle()
        save("wipe", page.picture())
        page.press("input[value=after]")
        _color(page, 2)
        page.press(".view-above")
        page.settle()
        save("distance", page.picture())
        set_size(browser, 390, 780)
        page = Page(browser, (drift / "report.html").as_uri())
        page.show(".view-tools")
        page.run("document.querySelector('[data-frame] button').click()")
        page.show(".view-stage")
        page.settle()
        save("phone", page.picture())
        set_size(browser, 1100, 860)
        page = Page(browser, (wrong / "report.html").as_uri())
        page.unfold()
        page.show("section.as-built")
        page.settle()
        save("as_built", page.picture())
        page.show(".view-tools")
        _color(page, 2)
        page.settle()
        save("wrong_plan", page.picture())


def dragging(run: Path) -> None:
    """The scan dragged over the plan, on a copy of the run."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "run"
        shutil.copytree(run, copy)
        with driven_chromium() as browser, served(copy) as server:
            set_size(browser, 1100, 760)
            page = Page(browser, server.address)
            page.wait_for("document.getElementById('hand').dataset.ready === '1'")
            page.press(".hand-drag")
            page.wait_for("document.querySelector('.hand-scan path') !== null")
            keys = [*["ArrowRight"] * 14, *["ArrowUp"] * 5, *["]"] * 12]
            page.run(
                "for (const key of arguments[0]) for (const kind of ['keydown', 'keyup'])"
                " document.querySelector('.hand-plan svg').dispatchEvent(new KeyboardEvent(kind, {key}))",
                keys,
            )
            page.wait_for("document.querySelectorAll('.hand-list li').length === 3")
            page.show(".hand-plan", "center")
            page.settle()
            save("drag", page.picture())


def main() -> None:
    """Runs, then the recording and the pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=Path, help="folder that keeps the runs")
    parser.add_argument("--only", choices=("recording", "gallery"))
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as made:
        folder = arguments.runs or Path(made)
        drift = drifted_run(folder)
        if arguments.only != "gallery":
            record(drift)
        if arguments.only != "recording":
            gallery(drift, wrong_plan_run(folder))
            dragging(drift)


if __name__ == "__main__":
    main()
